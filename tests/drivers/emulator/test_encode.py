# SPDX-License-Identifier: Apache-2.0
"""Encoding many samples at once gives what cantools gives one by one."""

from __future__ import annotations

import numpy as np
import pytest
from cantools.database.can import Message
from hypothesis import given, settings
from hypothesis import strategies as st

from comcal_drivers.decode.dbc import read_dbc
from comcal_drivers.devices.description import device_names, load_device
from comcal_drivers.emulator.encode import encode, raw_limits, raw_of, with_raw


def messages() -> dict[str, Message]:
    """All messages of all devices that carry signals."""
    found = dict[str, Message]()
    for name in device_names():
        for message in read_dbc(load_device(name).dbc).messages:
            if message.signals:
                found[f"{name}.{message.name}"] = message
    return found


MESSAGES = messages()


@pytest.mark.parametrize("name", MESSAGES)
@settings(max_examples=10)
@given(data=st.data())
def test_payloads_are_those_of_cantools(name: str, data: st.DataObject) -> None:
    message = MESSAGES[name]
    rows = 3
    columns = dict[str, np.ndarray]()
    for signal in message.signals:
        low, high = raw_limits(signal)
        raws = (
            st.floats(-1e6, 1e6, width=32)
            if signal.is_float
            else st.integers(max(low, -(2**52)), min(high, 2**52))
        )
        raw = np.array(data.draw(st.lists(raws, min_size=rows, max_size=rows)), dtype=np.float64)
        columns[signal.name] = raw * float(signal.scale) + float(signal.offset)
    made = encode(message, columns, rows)
    for row in range(rows):
        values = {name: float(column[row]) for name, column in columns.items()}
        assert made[row].tobytes() == message.encode(values, strict=False)


@pytest.mark.parametrize("name", MESSAGES)
@settings(max_examples=5)
@given(data=st.data())
def test_one_signal_changes_and_the_rest_stays(name: str, data: st.DataObject) -> None:
    message = MESSAGES[name]
    payload = data.draw(st.binary(min_size=message.length, max_size=message.length))
    signal = data.draw(st.sampled_from(message.signals))
    low, high = raw_limits(signal)
    raw = data.draw(st.integers(low, high))
    changed = with_raw(signal, payload, raw)
    assert raw_of(signal, changed) == raw
    assert with_raw(signal, changed, raw_of(signal, payload)) == payload
    others = [s for s in message.signals if s is not signal]
    assert all(raw_of(s, changed) == raw_of(s, payload) for s in others)


def test_a_driven_converter_stops_at_its_end_and_does_not_wrap() -> None:
    message = MESSAGES["ati_netcanoem.GAGES_ODD"]
    made = encode(message, {"sg1": np.array([1e9, -1e9, np.nan])}, 3)
    assert [row[:2].tobytes() for row in made] == [b"\x7f\xff", b"\x80\x00", b"\x00\x00"]
