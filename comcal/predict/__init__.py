# SPDX-License-Identifier: Apache-2.0
"""What a robot, as it is assumed to be, should have measured."""
