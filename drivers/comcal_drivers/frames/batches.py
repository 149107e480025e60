# SPDX-License-Identifier: Apache-2.0
"""Cut batches of frames and put them together again."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from comcal_drivers.frames.batch import FrameBatch

CLASSIC, LONG = 8, 64
"""Widths of ``FrameBatch.data``: 64 as soon as one payload is longer than 8 bytes."""


def take(
    batch: FrameBatch, rows: slice | npt.NDArray[np.intp] | npt.NDArray[np.bool_]
) -> FrameBatch:
    """Return some frames of a batch.

    Parameters
    ----------
    batch : FrameBatch
    rows : slice, array of int or array of bool, shape (len(batch),)
        Which ones, in which order.

    Returns
    -------
    FrameBatch
        As wide as *batch*.
    """
    return FrameBatch(
        t=batch.t[rows],
        ids=batch.ids[rows],
        lengths=batch.lengths[rows],
        data=batch.data[rows],
        kinds=batch.kinds[rows],
    )


def concatenate(batches: Iterable[FrameBatch]) -> FrameBatch:
    """Return the frames of several batches, one after the other.

    Parameters
    ----------
    batches : iterable of FrameBatch
        In order; none at all gives an empty batch.

    Returns
    -------
    FrameBatch
        As wide as the widest.
    """
    parts = list(batches)
    if len(parts) == 1:
        return parts[0]
    width = max((part.data.shape[1] for part in parts), default=CLASSIC)
    if not parts:
        return empty_batch(0, width)
    return FrameBatch(
        t=np.concatenate([part.t for part in parts]),
        ids=np.concatenate([part.ids for part in parts]),
        lengths=np.concatenate([part.lengths for part in parts]),
        data=np.concatenate([widened(part.data, width) for part in parts]),
        kinds=np.concatenate([part.kinds for part in parts]),
    )


def empty_batch(n: int, width: int = CLASSIC) -> FrameBatch:
    """Return *n* frames without stamp, identifier and payload, to be filled in.

    Parameters
    ----------
    n : int
    width : int
        Bytes per payload, 8 or 64.

    Returns
    -------
    FrameBatch
    """
    return FrameBatch(
        t=np.full(n, np.nan),
        ids=np.zeros(n, np.uint32),
        lengths=np.zeros(n, np.uint8),
        data=np.zeros((n, width), np.uint8),
        kinds=np.zeros(n, np.uint8),
    )


def widened(data: npt.NDArray[np.uint8], width: int) -> npt.NDArray[np.uint8]:
    """Return payloads with zero columns added until there are *width* bytes.

    Parameters
    ----------
    data : array of uint8, shape (n, k)
    width : int
        At least k.

    Returns
    -------
    array of uint8, shape (n, width)
        *data* itself where nothing is missing.
    """
    if data.shape[1] == width:
        return data
    wide = np.zeros((data.shape[0], width), np.uint8)
    wide[:, : data.shape[1]] = data
    return wide


def to_microseconds(t: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Round time stamps to a microsecond, the resolution of text logs.

    All frames pass here when they enter, live or from a log, so that a replay of what was
    logged repeats the live run to the last bit.

    Parameters
    ----------
    t : array, shape (n,)
        Time stamps [s]; NaN stays NaN.

    Returns
    -------
    array, shape (n,)
        The nearest doubles to whole microseconds [s].
    """
    return np.round(t, 6).astype(np.float64, copy=False)
