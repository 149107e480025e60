# SPDX-License-Identifier: Apache-2.0
"""Generated robots: a description in Python, written out as URDF, robot.yaml and plan.csv."""
