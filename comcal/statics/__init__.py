# SPDX-License-Identifier: Apache-2.0
"""The moment balance, written once over arrays."""
