# SPDX-License-Identifier: Apache-2.0
"""Signals of many frames at once against cantools, frame by frame and bit by bit."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import can
import numpy as np
import pytest
from cantools.database import load_string
from cantools.database.can import Database, Message, Signal
from cantools.database.conversion import BaseConversion
from cantools.database.errors import DecodeError
from hypothesis import given, settings
from hypothesis import strategies as st

from comcal.errors import ConfigError
from comcal_drivers.decode.table import (
    DecodeTable,
    decode,
    table_from_dbc,
    table_from_messages,
)
from comcal_drivers.frames.batch import EXTENDED, FrameBatch
from comcal_drivers.frames.batches import concatenate, take
from comcal_drivers.frames.messages import pack

SCALES = [1, 1.0, 2, -3, 10**6, 2**30, 0.01, 0.1, 1e-6, 0.5, 2.0, 1e9, -0.25, 1 / 3]
OFFSETS = [0, 0.0, 5, -32768, 2**53, 1e15, 0.25, -273.15, 1e-3, 7.0]


def bits(number: float) -> bytes:
    return np.float64(number).tobytes()


def assert_equals_cantools(message: Message, payloads: list[bytes]) -> None:
    """Decode *payloads* with both; signals that cantools does not give must be NaN."""
    batch = frames_of(message, payloads)
    found = decode(table_from_messages([message]), batch)[number_of(message)]
    assert found.rows.tolist() == list(range(len(payloads)))
    for row, payload in enumerate(payloads):
        if len(payload) < message.length:
            assert found.bad[row]
            expected: dict[str, Any] = {}
        else:
            assert not found.bad[row]
            expected = message.decode(payload, decode_choices=False)
        for signal in message.signals:
            value = found.values[signal.name][row]
            if signal.name in expected and not math.isnan(float(expected[signal.name])):
                assert bits(value) == bits(float(expected[signal.name])), signal
            else:
                assert math.isnan(value), signal


def number_of(message: Message) -> int:
    return message.frame_id | (int(EXTENDED) if message.is_extended_frame else 0)


def frames_of(message: Message, payloads: list[bytes]) -> FrameBatch:
    return pack(
        can.Message(
            arbitration_id=message.frame_id,
            is_extended_id=message.is_extended_frame,
            data=payload,
            is_fd=len(payload) > 8,
        )
        for payload in payloads
    )


def dbc_start(first: int, is_big_endian: bool) -> int:
    return first ^ 7 if is_big_endian else first


@st.composite
def conversions(draw: st.DrawFn, is_float: bool) -> BaseConversion:
    choices = draw(st.sampled_from([None, None, {0: "off", 1: "on"}]))
    scale, offset = draw(st.sampled_from(SCALES)), draw(st.sampled_from(OFFSETS))
    if draw(st.booleans()):
        scale, offset = 1, 0
    return BaseConversion.factory(scale=scale, offset=offset, choices=choices, is_float=is_float)


@st.composite
def messages(draw: st.DrawFn) -> Message:
    """One message with signals of both byte orders, which may overlap one another."""
    length = draw(st.sampled_from([1, 2, 3, 6, 7, 8, 8, 8, 12, 16, 48, 64]))
    signals: list[Signal] = []
    for order in ("little_endian", "big_endian"):
        first = draw(st.integers(0, 16))
        while len(signals) < 12:
            is_float = draw(st.integers(0, 4)) == 0
            size = draw(st.sampled_from([16, 32, 64]) if is_float else st.integers(1, 64))
            if first + size > 8 * length:
                break
            signals.append(
                Signal(
                    name=f"S{len(signals)}",
                    start=dbc_start(first, order == "big_endian"),
                    length=size,
                    byte_order=order,
                    is_signed=draw(st.booleans()),
                    conversion=draw(conversions(is_float)),
                )
            )
            first += size + draw(st.sampled_from([0, 0, 1, 3, 8]))
    return Message(
        frame_id=draw(st.integers(0, 0x7FF)),
        name="M",
        length=length,
        signals=signals,
        is_extended_frame=draw(st.booleans()),
        strict=False,
        is_fd=length > 8,
    )


@given(messages(), st.integers(0, 2**32))
@settings(max_examples=150)
def test_any_message_decodes_to_the_bits_that_cantools_gives(message: Message, seed: int) -> None:
    rng = np.random.default_rng(seed)
    length = message.length
    payloads = [bytes(length), b"\xff" * length, b"\x80" + bytes(length - 1)]
    payloads += [rng.bytes(length) for _ in range(6)]
    if length == 8:
        payloads.append(rng.bytes(64))
    elif length < 8:
        payloads.append(rng.bytes(length + 1))
    payloads.append(rng.bytes(length - 1))
    assert_equals_cantools(message, payloads)


@pytest.mark.parametrize("size", range(1, 65))
@pytest.mark.parametrize("order", ["little_endian", "big_endian"])
def test_a_number_of_every_length_is_found_at_every_bit(size: int, order: str) -> None:
    rng = np.random.default_rng(size)
    for length, first in [(8, 64 - size), (16, 0), (16, 7), (16, 37), (64, 512 - size), (64, 441)]:
        for is_signed in (False, True):
            if first + size > 8 * length:
                continue
            signal = Signal(
                "S",
                dbc_start(first, order == "big_endian"),
                size,
                "big_endian" if order == "big_endian" else "little_endian",
                is_signed,
            )
            message = Message(1, "M", length, [signal], is_fd=length > 8)
            assert_equals_cantools(message, [rng.bytes(length) for _ in range(3)])


@pytest.mark.parametrize("size", [52, 54, 58, 62, 64])
@pytest.mark.parametrize(("scale", "offset"), [(3, -7), (5, 0.5), (7, 2**53 + 1)])
def test_long_integers_are_scaled_as_python_scales_them(
    size: int, scale: int, offset: float
) -> None:
    """In doubles, a raw value beyond 2^53 would be rounded before it is scaled, and after."""
    conversion = BaseConversion.factory(scale=scale, offset=offset, is_float=False)
    message = Message(1, "M", 8, [Signal("S", 0, size, conversion=conversion)])
    rng = np.random.default_rng(size)
    raw = [int(n) >> (64 - size) for n in rng.integers(0, 2**64, 50, np.uint64)]
    assert any(float(n) * scale + offset != float(n * scale + offset) for n in raw) or size < 54
    assert_equals_cantools(message, [n.to_bytes(8, "little") for n in raw])


def test_floats_may_be_infinite_or_no_number() -> None:
    message = Message(
        1,
        "M",
        8,
        [
            Signal("S", 0, 32, conversion=BaseConversion.factory(0.0, 1.0, None, is_float=True)),
            Signal("T", 32, 32, conversion=BaseConversion.factory(1e38, 0, None, is_float=True)),
        ],
    )
    numbers = [np.inf, -np.inf, np.nan, 3e38, 1e-45, -0.0]
    assert_equals_cantools(message, [2 * np.float32(n).tobytes() for n in numbers])


MULTIPLEXED = """VERSION ""
BU_: X
BO_ 256 M: 8 X
 SG_ plain : 56|8@1+ (1,0) [0|0] "" X
 SG_ mux M : 0|8@1+ (1,0) [0|0] "" X
 SG_ a m0 : 8|16@1- (0.1,0) [0|0] "N" X
 SG_ b m1 : 15|16@0- (0.01,1) [0|0] "N" X
 SG_ inner m2M : 8|4@1+ (1,0) [0|0] "" X
 SG_ c m1 : 16|16@1+ (1,0) [0|0] "" X
 SG_ d m3 : 32|16@1+ (2,0) [0|0] "" X
SG_MUL_VAL_ 256 a mux 0-0, 5-7;
SG_MUL_VAL_ 256 b mux 1-1;
SG_MUL_VAL_ 256 inner mux 2-2;
SG_MUL_VAL_ 256 c inner 1-1;
SG_MUL_VAL_ 256 d inner 3-4, 9-9;
"""


def multiplexed() -> Message:
    database = load_string(MULTIPLEXED, "dbc")
    assert isinstance(database, Database)
    return database.messages[0]


@given(st.integers(0, 2**32))
@settings(max_examples=20)
def test_multiplexed_signals_are_those_that_cantools_finds(seed: int) -> None:
    rng = np.random.default_rng(seed)
    outer, inner = [0, 1, 2, 2, 2, 2, 5, 6, 7], [0, 0, 1, 3, 4, 9, 2, 9, 9]
    payloads = [bytes([mux, first]) + rng.bytes(6) for mux, first in zip(outer, inner, strict=True)]
    rng.shuffle(payloads)
    assert_equals_cantools(multiplexed(), [*payloads, rng.bytes(3)])


def test_an_unknown_multiplexer_leaves_what_is_not_multiplexed() -> None:
    message = multiplexed()
    payload = bytes([200, 0, 0, 0, 0, 0, 0, 42])
    with pytest.raises(DecodeError):
        message.decode(payload)
    found = decode(table_from_messages([message]), frames_of(message, [payload]))[256]
    assert not found.bad[0]
    assert found.values["plain"][0] == 42
    assert all(np.isnan(found.values[name][0]) for name in ("a", "b", "c", "d", "inner"))


def test_the_point_of_a_scaled_multiplexer_is_cut_as_cantools_cuts_it() -> None:
    half = BaseConversion.factory(scale=0.5, offset=0, is_float=False)
    signals = [
        Signal("mux", 0, 8, conversion=half, is_multiplexer=True),
        Signal("a", 8, 8, multiplexer_ids=[1], multiplexer_signal="mux"),
        Signal("b", 8, 8, multiplexer_ids=[2], multiplexer_signal="mux"),
    ]
    message = Message(1, "M", 2, signals)
    assert_equals_cantools(message, [bytes([raw, 9]) for raw in (2, 3, 4, 5)])


def two_devices() -> Database:
    database = load_string(
        """VERSION ""
BU_: X
BO_ 0 First: 8 X
 SG_ a : 0|16@1- (0.1,0) [0|0] "N" X
BO_ 1 Second: 4 X
 SG_ b : 7|16@0- (0.1,0) [0|0] "N" X
BO_ 2147483649 Long: 4 X
 SG_ c : 7|16@0- (0.1,0) [0|0] "N" X
""",
        "dbc",
    )
    assert isinstance(database, Database)
    return database


def test_identifiers_are_relocated_and_those_of_29_bits_stay_apart() -> None:
    table = table_from_dbc(two_devices(), lambda number: number + (0x20 << 4))
    assert sorted(table.messages) == [0x200, 0x201, 0x201 | 1 << 31]
    assert table.id_of("Second") == 0x201
    assert table.id_of("Long") == 0x201 | 1 << 31
    with pytest.raises(KeyError):
        table.id_of("Third")
    batch = pack(
        [
            can.Message(arbitration_id=0x201, is_extended_id=True, data=bytes(4)),
            can.Message(arbitration_id=0x201, is_extended_id=False, data=bytes(4)),
            can.Message(arbitration_id=0x001, is_extended_id=False, data=bytes(4)),
        ]
    )
    found = decode(table, batch)
    assert {number: rows.rows.tolist() for number, rows in found.items()} == {
        0x200: [],
        0x201: [1],
        0x201 | 1 << 31: [0],
    }


def test_requests_and_error_frames_carry_no_signals() -> None:
    table = table_from_dbc(two_devices())
    batch = pack(
        [
            can.Message(is_extended_id=False, arbitration_id=1, is_remote_frame=True, dlc=4),
            can.Message(is_extended_id=False, arbitration_id=1, is_error_frame=True, data=bytes(8)),
            can.Message(is_extended_id=False, arbitration_id=1, data=bytes(4)),
        ]
    )
    assert decode(table, batch)[1].rows.tolist() == [2]


def stream(rng: np.random.Generator, frames: int) -> FrameBatch:
    return pack(
        can.Message(
            arbitration_id=int(rng.integers(0, 3)),
            is_extended_id=False,
            data=rng.bytes(int(rng.choice([8, 8, 8, 4, 2]))),
        )
        for _ in range(frames)
    )


@given(st.integers(0, 2**32), st.lists(st.integers(0, 60), max_size=5))
@settings(max_examples=30)
def test_decoding_does_not_depend_on_how_the_stream_is_cut(seed: int, cuts: list[int]) -> None:
    table = table_from_dbc(two_devices())
    batch = stream(np.random.default_rng(seed), 60)
    whole = decode(table, batch)
    edges = [0, *sorted(cuts), len(batch)]
    parts = [
        (begin, decode(table, take(batch, slice(begin, end)))) for begin, end in pairwise(edges)
    ]
    for number, all_of_it in whole.items():
        rows = np.concatenate([part[number].rows + begin for begin, part in parts])
        np.testing.assert_array_equal(rows, all_of_it.rows)
        for name, values in all_of_it.values.items():
            joined = np.concatenate([part[number].values[name] for _, part in parts])
            assert joined.tobytes() == values.tobytes()


def test_a_batch_of_long_frames_decodes_short_messages_alike() -> None:
    table = table_from_dbc(two_devices())
    batch = stream(np.random.default_rng(1), 40)
    wide = concatenate([batch, pack([can.Message(data=bytes(48), is_fd=True)])])
    assert wide.data.shape[1] == 64
    for number, found in decode(table, batch).items():
        for name, values in decode(table, wide)[number].values.items():
            assert values.tobytes() == found.values[name].tobytes()


@pytest.mark.parametrize(
    ("message", "words"),
    [
        (Message(1, "M", 16, [Signal("S", 0, 65)]), "65 bits"),
        (Message(1, "M", 1, [Signal("S", 4, 8)], strict=False), "beyond the end"),
    ],
)
def test_a_signal_that_cannot_be_decoded_is_refused_by_name(message: Message, words: str) -> None:
    with pytest.raises(ConfigError, match="message M, signal S") as caught:
        table_from_messages([message])
    assert words in str(caught.value)


def test_identifiers_that_meet_or_leave_the_bus_are_refused() -> None:
    with pytest.raises(ConfigError, match="First and Second"):
        table_from_dbc(two_devices(), lambda _: 5)
    with pytest.raises(ConfigError, match="0x1000"):
        table_from_dbc(two_devices(), lambda number: number + 0x1000)


def test_an_empty_table_decodes_nothing() -> None:
    assert decode(DecodeTable({}), stream(np.random.default_rng(0), 3)) == {}
