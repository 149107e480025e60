# SPDX-License-Identifier: Apache-2.0
"""Frames to the signals that they carry, as DBC files describe them."""
