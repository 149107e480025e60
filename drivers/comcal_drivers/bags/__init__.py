# SPDX-License-Identifier: Apache-2.0
"""Recordings of ROS 1 and ROS 2, and our own raw samples, as a source: ``--source bag:FILE``."""
