# SPDX-License-Identifier: Apache-2.0
"""Messages of python-can to columns and back."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from operator import attrgetter
from typing import TYPE_CHECKING, TypeVar

import numpy as np
import numpy.typing as npt

from comcal_drivers.frames.batch import ERROR, EXTENDED, FD, REMOTE, SENT, FrameBatch
from comcal_drivers.frames.batches import CLASSIC, LONG, concatenate, to_microseconds

if TYPE_CHECKING:
    from can import Message

Scalar = TypeVar("Scalar", bound=np.generic)


def pack(messages: Iterable[Message]) -> FrameBatch:
    """Return messages as columns.

    Parameters
    ----------
    messages : iterable of can.Message
        In the order in which they came.

    Returns
    -------
    FrameBatch
        Stamps are rounded to a microsecond. The length of a remote request is the one that it asks
        for; an error frame keeps the error class as identifier.
    """
    rows = list(messages)
    if not rows:
        return concatenate(())

    def column(name: str, kind: type[Scalar]) -> npt.NDArray[Scalar]:
        return np.fromiter(map(attrgetter(name), rows), kind, len(rows))

    payloads = [message.data for message in rows]
    sizes = np.fromiter(map(len, payloads), np.uint8, len(rows))
    width = CLASSIC if sizes.max() <= CLASSIC else LONG
    joined = np.frombuffer(b"".join(payloads), np.uint8)
    if joined.size == len(rows) * width:
        data = joined.reshape(-1, width).copy()
    else:
        data = np.zeros((len(rows), width), np.uint8)
        data[np.arange(width) < sizes[:, None]] = joined
    is_error = column("is_error_frame", np.bool_)
    is_remote = column("is_remote_frame", np.bool_)
    ids = column("arbitration_id", np.uint32)
    ids |= EXTENDED * (column("is_extended_id", np.bool_) & ~is_error)
    kinds = np.zeros(len(rows), np.uint8)
    kinds[is_error] |= ERROR
    kinds[is_remote] |= REMOTE
    kinds[column("is_fd", np.bool_)] |= FD
    kinds[~column("is_rx", np.bool_)] |= SENT
    return FrameBatch(
        t=to_microseconds(column("timestamp", np.float64)),
        ids=ids,
        lengths=np.where(is_remote, column("dlc", np.uint8), sizes) if is_remote.any() else sizes,
        data=data,
        kinds=kinds,
    )


def to_messages(batch: FrameBatch, channel: str | int | None = None) -> Iterator[Message]:
    """Yield the frames of a batch as messages of python-can.

    Parameters
    ----------
    batch : FrameBatch
    channel : str or int, optional
        What the messages shall say of where they came from.

    Yields
    ------
    can.Message
        A stamp of NaN becomes 0, python-can's word for none.
    """
    from can import Message

    stamps = np.nan_to_num(batch.t, nan=0.0).tolist()
    ids = (batch.ids & ~EXTENDED).tolist()
    extended = (batch.ids >= EXTENDED).tolist()
    for row, (length, kind) in enumerate(
        zip(batch.lengths.tolist(), batch.kinds.tolist(), strict=True)
    ):
        is_remote = bool(kind & REMOTE)
        yield Message(
            timestamp=stamps[row],
            arbitration_id=ids[row],
            is_extended_id=extended[row],
            is_remote_frame=is_remote,
            is_error_frame=bool(kind & ERROR),
            channel=channel,
            dlc=length,
            data=None if is_remote else batch.data[row, :length].tobytes(),
            is_fd=bool(kind & FD),
            is_rx=not kind & SENT,
        )
