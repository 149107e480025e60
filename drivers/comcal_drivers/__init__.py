# SPDX-License-Identifier: Apache-2.0
"""Adapters to real sensors and drives."""

from comcal_drivers.mf4_on_demand import install

# Here, because some modules import python-can through other packages before any of their own lines.
install()
