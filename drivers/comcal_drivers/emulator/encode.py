# SPDX-License-Identifier: Apache-2.0
"""Signals to payloads, many samples at once: the inverse of decoding, on cantools' layouts."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt
from cantools.database.can import Message, Signal

from comcal.robot.tree import Array

Bytes = npt.NDArray[np.uint8]
_FLOATS: Mapping[int, tuple[type[np.floating], type[np.unsignedinteger]]] = {
    16: (np.float16, np.uint16),
    32: (np.float32, np.uint32),
    64: (np.float64, np.uint64),
}


def raw_limits(signal: Signal) -> tuple[int, int]:
    """Return the smallest and largest integer that the bits of a signal can hold."""
    if signal.is_signed:
        return -(1 << (signal.length - 1)), (1 << (signal.length - 1)) - 1
    return 0, (1 << signal.length) - 1


def encode(message: Message, columns: Mapping[str, Array], n: int) -> Bytes:
    """Return the payloads of many samples of one message.

    Values are rounded to the nearest that the bits can say, and held at their limits: a converter
    that is driven beyond its range does not wrap. Integers wider than 53 bits are not exact.

    Parameters
    ----------
    message : cantools Message
    columns : mapping from signal name to array, shape (n,)
        In the units of the layout; signals that are not named are zero, NaN becomes zero. Names
        that are no signals of this message are passed over.
    n : int
        Number of samples.

    Returns
    -------
    array of uint8, shape (n, message.length)

    Notes
    -----
    Bits are numbered as in a DBC: bit b is that of value 2**(b % 8) in byte b // 8. A little-endian
    signal begins with its lowest bit there, a big-endian one with its highest.
    """
    bits = np.zeros((n, 8 * message.length), dtype=np.uint8)
    for signal in message.signals:
        if signal.name in columns:
            raw = _raw(signal, columns[signal.name])
            weights = np.arange(signal.length, dtype=np.uint64)
            bits[:, _positions(signal)] = (raw[:, None] >> weights) & np.uint64(1)
    return np.packbits(bits, axis=1, bitorder="little")


def raw_of(signal: Signal, payload: bytes) -> int:
    """Return the raw integer of a signal in one payload."""
    bits = np.unpackbits(np.frombuffer(payload, dtype=np.uint8), bitorder="little")
    raw = sum(int(bit) << k for k, bit in enumerate(bits[_positions(signal)]))
    is_negative = signal.is_signed and raw >> (signal.length - 1)
    return raw - (1 << signal.length) if is_negative else raw


def with_raw(signal: Signal, payload: bytes, raw: int) -> bytes:
    """Return a payload in which the raw integer of a signal is another one, the rest as it was."""
    bits = np.unpackbits(np.frombuffer(payload, dtype=np.uint8), bitorder="little")
    bits[_positions(signal)] = [(raw >> k) & 1 for k in range(signal.length)]
    return np.packbits(bits, bitorder="little").tobytes()


def _positions(signal: Signal) -> npt.NDArray[np.intp]:
    """Return where the bits of a signal lie, lowest first, shape (length,)."""
    if signal.byte_order == "little_endian":
        return np.arange(signal.start, signal.start + signal.length)
    # Counting from the highest bit of byte 0 on, a big-endian signal is one unbroken run.
    first = 8 * (signal.start // 8) + 7 - signal.start % 8
    run = np.arange(first + signal.length - 1, first - 1, -1)
    return 8 * (run // 8) + 7 - run % 8


def _raw(signal: Signal, values: Array) -> npt.NDArray[np.uint64]:
    """Return the bits of each value, right-aligned, shape (n,)."""
    scaled = (np.nan_to_num(values) - signal.offset) / signal.scale
    if signal.is_float:
        kind, word = _FLOATS[signal.length]
        limit = float(np.finfo(kind).max)
        return np.clip(scaled, -limit, limit).astype(kind).view(word).astype(np.uint64)
    low, high = raw_limits(signal)
    held = np.clip(np.rint(scaled), low, high)
    # 2**63 and more do not fit into int64, and less than 0 not into uint64.
    return held.astype(np.int64).view(np.uint64) if low < 0 else held.astype(np.uint64)
