# SPDX-License-Identifier: Apache-2.0
"""The state machine of CiA 402: what a status word means, and the way to Operation Enabled."""

from __future__ import annotations

from enum import Enum


class State(Enum):
    """States of the power drive system, by their names in the manuals."""

    NOT_READY = "Not Ready to Switch On"
    SWITCH_ON_DISABLED = "Switch On Disabled"
    READY = "Ready to Switch On"
    SWITCHED_ON = "Switched On"
    OPERATION_ENABLED = "Operation Enabled"
    QUICK_STOP = "Quick Stop Active"
    FAULT_REACTION = "Fault Reaction Active"
    FAULT = "Fault"
    UNKNOWN = "a state that CiA 402 does not know"


_PATTERNS = (
    (0x4F, 0x00, State.NOT_READY),
    (0x4F, 0x40, State.SWITCH_ON_DISABLED),
    (0x6F, 0x21, State.READY),
    (0x6F, 0x23, State.SWITCHED_ON),
    (0x6F, 0x27, State.OPERATION_ENABLED),
    (0x6F, 0x07, State.QUICK_STOP),
    (0x4F, 0x0F, State.FAULT_REACTION),
    (0x4F, 0x08, State.FAULT),
)

TARGET_REACHED = 1 << 10
ACKNOWLEDGED = 1 << 12
FOLLOWING_ERROR = 1 << 13

QUICK_STOP = 0x0002
SHUTDOWN = 0x0006
SWITCH_ON = 0x0007
ENABLE = 0x000F
NEW_SET_POINT = ENABLE | 1 << 4 | 1 << 5
"""Absolute target, at once: what was still to be done of an older one is dropped."""
FAULT_RESET = 0x0080

HOLDING_STOPS = frozenset({5, 6, 7, 8})
"""Values of 0x605A with which the drive keeps its position after a quick stop."""

POSITION_MODE = 1
"""Of 0x6060: profile position."""


def state_of(statusword: int) -> State:
    """Return the state that a status word (0x6041) reports."""
    for mask, value, state in _PATTERNS:
        if statusword & mask == value:
            return state
    return State.UNKNOWN


def towards_enabled(state: State) -> int | None:
    """Return the control word (0x6040) of the next step; None where only waiting helps.

    A fault is not on the way: whether it may be reset is for the caller to decide.
    """
    return {
        State.SWITCH_ON_DISABLED: SHUTDOWN,
        State.READY: SWITCH_ON,
        State.SWITCHED_ON: ENABLE,
        State.QUICK_STOP: ENABLE,
    }.get(state)
