# SPDX-License-Identifier: Apache-2.0
"""Measuring: the ports to whatever moves and measures a robot, still windows, session folder."""
