# SPDX-License-Identifier: Apache-2.0
"""The robot as it is described: ``robot.yaml``, URDF, kinematic tree, kinematics."""
