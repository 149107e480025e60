# SPDX-License-Identifier: Apache-2.0
"""Batches to compare and to make up."""

from __future__ import annotations

from collections.abc import Callable

import can
import numpy as np
import pytest

from comcal_drivers.frames.batch import FrameBatch


def _assert_same(found: FrameBatch, expected: FrameBatch) -> None:
    np.testing.assert_array_equal(found.t, expected.t)
    np.testing.assert_array_equal(found.ids, expected.ids)
    np.testing.assert_array_equal(found.lengths, expected.lengths)
    np.testing.assert_array_equal(found.kinds, expected.kinds)
    width = max(found.data.shape[1], expected.data.shape[1])
    for batch in (found, expected):
        assert [a.dtype for a in (batch.t, batch.ids, batch.lengths, batch.data, batch.kinds)] == [
            np.float64,
            np.uint32,
            np.uint8,
            np.uint8,
            np.uint8,
        ]
        assert not batch.data[:, 8:].any() or batch.lengths.max() > 8
    np.testing.assert_array_equal(_wide(found, width), _wide(expected, width))


def _wide(batch: FrameBatch, width: int) -> np.ndarray:
    return np.pad(batch.data, ((0, 0), (0, width - batch.data.shape[1])))


@pytest.fixture(scope="session")
def assert_same() -> Callable[[FrameBatch, FrameBatch], None]:
    """Two batches hold the same frames, to the last bit."""
    return _assert_same


def _messages(count: int, *, classic: bool = False) -> list[can.Message]:
    rng = np.random.default_rng(count)
    found: list[can.Message] = []
    for k in range(count):
        kind = int(rng.integers(0, 10))
        extended = kind in (1, 2)
        size = int(rng.choice([0, 3, 6, 8, 8, 8]))
        is_fd = kind == 3 and not classic
        message = can.Message(
            timestamp=round(1.7e9 + 0.001 * k + 1e-6 * int(rng.integers(0, 900)), 6),
            arbitration_id=int(rng.integers(0, 2**29 if extended else 2**11)),
            is_extended_id=extended,
            data=rng.bytes(int(rng.choice([12, 64])) if is_fd else size),
            is_fd=is_fd,
            is_rx=kind != 4,
            channel="can0",
        )
        if kind == 5 and not classic:
            message.is_remote_frame = True
            message.data = bytearray()
        if kind == 6 and not classic:
            message.is_error_frame = True
            message.arbitration_id = 0x80
            message.data = bytearray(8)
            message.dlc = 8
        found.append(message)
    return found


@pytest.fixture(scope="session")
def messages() -> Callable[..., list[can.Message]]:
    """Messages of every kind; *classic* ones only of 11 and 29 bits with up to 8 bytes."""
    return _messages
