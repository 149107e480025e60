# SPDX-License-Identifier: Apache-2.0
"""Recordings as sources: where in a log the robot stood in the planned poses."""
