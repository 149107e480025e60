# SPDX-License-Identifier: Apache-2.0
"""Simulated robots and the worlds they stand in."""
