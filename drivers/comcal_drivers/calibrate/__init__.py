# SPDX-License-Identifier: Apache-2.0
"""From raw values to wrenches, currents, torques and positions, with flags."""
