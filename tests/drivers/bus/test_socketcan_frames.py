# SPDX-License-Identifier: Apache-2.0
"""The kernel's frames as bytes; the socket itself is tested in tests/drivers/guest."""

from __future__ import annotations

import can
import numpy as np
from can.interfaces.socketcan.socketcan import build_can_frame
from hypothesis import given, settings
from hypothesis import strategies as st

from comcal_drivers.bus.socketcan import unpack
from comcal_drivers.frames.messages import pack


@st.composite
def messages(draw: st.DrawFn) -> can.Message:
    kind = draw(st.sampled_from(["data", "remote", "fd", "error"]))
    extended = kind != "error" and draw(st.booleans())
    size = draw(st.sampled_from([0, 5, 8, 12, 64])) if kind == "fd" else draw(st.integers(0, 8))
    return can.Message(
        timestamp=draw(st.integers(0, 2 * 10**15)) / 1e6,
        arbitration_id=draw(st.integers(0, (1 << (29 if extended else 11)) - 1)),
        is_extended_id=extended,
        is_remote_frame=kind == "remote",
        is_error_frame=kind == "error",
        is_fd=kind == "fd",
        dlc=size,
        data=None if kind == "remote" else draw(st.binary(min_size=size, max_size=size)),
        is_rx=draw(st.booleans()),
    )


@settings(max_examples=80)
@given(st.lists(messages(), min_size=1, max_size=6))
def test_frames_of_the_kernel_are_those_that_an_independent_implementation_builds(sent):
    stamps = np.array([m.timestamp for m in sent])
    own = np.array([not m.is_rx for m in sent])
    read = unpack(tuple(bytes(build_can_frame(m)) for m in sent), stamps, own)
    expected = pack(sent)
    for column in ("t", "ids", "lengths", "kinds"):
        np.testing.assert_array_equal(getattr(read, column), getattr(expected, column))
        assert getattr(read, column).dtype == getattr(expected, column).dtype
    width = min(read.data.shape[1], expected.data.shape[1])
    np.testing.assert_array_equal(read.data[:, :width], expected.data[:, :width])
    assert not read.data[:, width:].any()
