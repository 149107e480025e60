# SPDX-License-Identifier: Apache-2.0
"""The objects of CiA 301 and CiA 402 that comcal reads, and the signal names they get.

Manufacturers spell the names of these objects as they like ("Position Actual Value",
"PositionActualValue", "Position actual internal value"), so signals are named after the index: one
device description then fits the EDS of every drive.
"""

from __future__ import annotations

import re
from typing import NamedTuple


class ValueType(NamedTuple):
    """How the bits of a mapped value are to be read."""

    bits: int
    signed: bool = False
    is_float: bool = False


CONTROLWORD = 0x6040
STATUSWORD = 0x6041
QUICK_STOP_OPTION = 0x605A
ERROR_CODE = 0x603F
MODE = 0x6060
MODE_DISPLAY = 0x6061
POSITION = 0x6064
RATED_CURRENT = 0x6075
"""Unsigned 32 bit [mA]."""
RATED_TORQUE = 0x6076
"""Unsigned 32 bit [mN m]."""
TORQUE = 0x6077
"""Per mille of the rated torque, by CiA 402."""
CURRENT = 0x6078
"""Per mille of the rated current by CiA 402; mA on Maxon EPOS and EPOS2."""
TARGET_POSITION = 0x607A
PROFILE_VELOCITY = 0x6081
PROFILE_ACCELERATION = 0x6083
PROFILE_DECELERATION = 0x6084
VELOCITY_NOTATION = 0x608B
"""Power of ten on top of it."""
VELOCITY_DIMENSION = 0x608C
"""Unit of velocities in the older CiA 402; 0xA4 are revolutions of the motor per minute."""
VELOCITY_UNIT = 0x60A9
"""Unit of velocities in IEC 61800-7-201."""

DEVICE_NAME = 0x1008
IDENTITY = 0x1018

_SIGNALS: dict[int, tuple[str, ValueType]] = {
    ERROR_CODE: ("error_code", ValueType(16)),
    CONTROLWORD: ("controlword", ValueType(16)),
    STATUSWORD: ("statusword", ValueType(16)),
    MODE_DISPLAY: ("mode", ValueType(8, signed=True)),
    0x6062: ("position_demand", ValueType(32, signed=True)),
    POSITION: ("position", ValueType(32, signed=True)),
    0x606C: ("velocity", ValueType(32, signed=True)),
    0x6074: ("torque_demand", ValueType(16, signed=True)),
    TORQUE: ("torque", ValueType(16, signed=True)),
    CURRENT: ("current", ValueType(16, signed=True)),
    0x6079: ("voltage", ValueType(32)),
    0x60F4: ("following_error", ValueType(32, signed=True)),
}


def signal_name(index: int, subindex: int) -> str:
    """Return the name of a mapped object: ``position`` for 0x6064, else ``o2027_00``."""
    known = _SIGNALS.get(index)
    if known is not None and subindex == 0:
        return known[0]
    return f"o{index:04X}_{subindex:02X}"


def index_of_signal(name: str) -> tuple[int, int] | None:
    """Return index and subindex of the object that a signal is named after; None for others."""
    for index, (known, _) in _SIGNALS.items():
        if known == name:
            return index, 0
    match = re.fullmatch(r"o([0-9A-F]{4})_([0-9A-F]{2})", name)
    return None if match is None else (int(match[1], 16), int(match[2], 16))


def standard_type(index: int, subindex: int) -> ValueType | None:
    """Return the type that CiA 402 gives an object; None where it says nothing."""
    known = _SIGNALS.get(index)
    return known[1] if known is not None and subindex == 0 else None


def object_text(index: int, subindex: int) -> str:
    """Return an object as error messages write it: ``0x6064`` or ``0x1018:04``."""
    return f"0x{index:04X}" + (f":{subindex:02X}" if subindex else "")
