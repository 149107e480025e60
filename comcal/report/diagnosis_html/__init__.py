# SPDX-License-Identifier: Apache-2.0
"""A diagnosis as one HTML page: inline SVG, no scripts, nothing fetched from anywhere."""
