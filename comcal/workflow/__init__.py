# SPDX-License-Identifier: Apache-2.0
"""One orchestration per command: compute, do not print."""
