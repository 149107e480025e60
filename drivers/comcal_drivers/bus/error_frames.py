# SPDX-License-Identifier: Apache-2.0
"""What error frames say, in SocketCAN's numbering, and the one that marks lost frames.

A reader that loses frames puts an error frame "receive overflow" in their place, as a CAN
controller does. Joining by order then starts anew there, live as well as from the log.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from comcal_drivers.frames.batch import ERROR, EXTENDED, SENT, FrameBatch
from comcal_drivers.frames.batches import to_microseconds

# Classes of errors, bits of the identifier (linux/can/error.h).
CONTROLLER = 0x004
PROTOCOL = 0x008
ACKNOWLEDGE = 0x020
BUS_OFF = 0x040
BUS_ERROR = 0x080
RESTARTED = 0x100

# Controller problems, bits of data[1].
RECEIVE_OVERFLOW = 0x01
SEND_OVERFLOW = 0x02
WARNING = 0x0C
PASSIVE = 0x30
ACTIVE = 0x40


def gap_marker(t: float) -> FrameBatch:
    """Return the error frame that stands where frames were lost.

    Parameters
    ----------
    t : float
        When the loss was noticed [s].

    Returns
    -------
    FrameBatch
        One frame.
    """
    return error_frame(t, CONTROLLER, (0, RECEIVE_OVERFLOW))


def error_frame(t: float, classes: int, payload: tuple[int, ...] = ()) -> FrameBatch:
    """Return one error frame of 8 bytes.

    Parameters
    ----------
    t : float
        Time stamp [s].
    classes : int
        Bits such as :data:`BUS_OFF`.
    payload : tuple of int
        First bytes; the others are zero.

    Returns
    -------
    FrameBatch
        One frame.
    """
    return FrameBatch(
        t=to_microseconds(np.array([t])),
        ids=np.array([classes], np.uint32),
        lengths=np.array([8], np.uint8),
        data=np.frombuffer(bytes(payload).ljust(8, b"\0"), np.uint8).reshape(1, 8),
        kinds=np.array([ERROR], np.uint8),
    )


def is_gap(batch: FrameBatch) -> npt.NDArray[np.bool_]:
    """Return where frames are missing: lost by this program, the kernel or the adapter.

    Parameters
    ----------
    batch : FrameBatch

    Returns
    -------
    array of bool, shape (len(batch),)
        True for the error frames that stand in the place of what was lost.
    """
    return _is_of_class(batch, CONTROLLER) & ((batch.data[:, 1] & RECEIVE_OVERFLOW) != 0)


def bus_off_rows(batch: FrameBatch) -> npt.NDArray[np.bool_]:
    """Return which frames say that the controller has left the bus.

    Parameters
    ----------
    batch : FrameBatch

    Returns
    -------
    array of bool, shape (len(batch),)
    """
    return _is_of_class(batch, BUS_OFF)


def is_bus_off_after(batch: FrameBatch, before: bool) -> bool:
    """Return whether the controller is off the bus after these frames.

    Nothing comes from a controller that is off the bus, so any other frame means that it is back.

    Parameters
    ----------
    batch : FrameBatch
    before : bool
        Whether it was off the bus before them.

    Returns
    -------
    bool
    """
    received = ((batch.kinds & SENT) == 0) & ~is_gap(batch)
    if not received.any():
        return before
    return bool(bus_off_rows(batch)[np.flatnonzero(received)[-1]])


def _is_of_class(batch: FrameBatch, classes: int) -> npt.NDArray[np.bool_]:
    is_error = (batch.kinds & ERROR) != 0
    return is_error & ((batch.ids & ~EXTENDED & np.uint32(classes)) != 0)
