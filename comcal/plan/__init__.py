# SPDX-License-Identifier: Apache-2.0
"""Informative sets of balanced poses: which poses a robot should take, before it moves."""
