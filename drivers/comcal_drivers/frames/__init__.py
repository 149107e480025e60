# SPDX-License-Identifier: Apache-2.0
"""Frames as columns, and every way in which they come: buses, logs, console text."""
