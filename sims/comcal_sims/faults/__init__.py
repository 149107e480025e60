# SPDX-License-Identifier: Apache-2.0
"""Changes put into the simulated robot, its motors and its sensors."""
