# SPDX-License-Identifier: Apache-2.0
"""An emulated node on a SocketCAN bus where there is none; tests/drivers/guest has one."""

from __future__ import annotations

import pytest

from comcal.errors import HardwareError
from comcal_drivers.emulator.socketcan_adapter import SocketcanAdapter


def test_an_interface_that_is_not_there_names_the_commands_that_make_one() -> None:
    with pytest.raises(
        HardwareError, match="ip link add can99 type vcan && sudo ip link set can99"
    ):
        SocketcanAdapter("can99")
