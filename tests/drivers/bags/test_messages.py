# SPDX-License-Identifier: Apache-2.0
"""The decoder against ``rosbags``, which shares no code with it."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore

from comcal.measure import cdr
from comcal_drivers.bags.messages import Decoder, Message

ENCODINGS = ("ros1", "cdr_le", "cdr_be")
TEXT = st.text(max_size=6)
NUMBER = st.floats(allow_nan=False)


def content_of(store: Any, kind: str, data: st.DataObject, ros1: bool) -> Any:
    """Draw a message of a type."""

    def numbers(n: int) -> list[float]:
        return data.draw(st.lists(NUMBER, min_size=n, max_size=n))

    def vector() -> Any:
        return store.types["geometry_msgs/msg/Vector3"](*numbers(3))

    stamp = store.types["builtin_interfaces/msg/Time"](
        data.draw(st.integers(0, 2**31 - 1)), data.draw(st.integers(0, 10**9 - 1))
    )
    frame = data.draw(TEXT)
    seq = [data.draw(st.integers(0, 2**32 - 1))] if ros1 else []
    header = store.types["std_msgs/msg/Header"](*seq, stamp, frame)
    make = store.types[kind]
    if kind == cdr.WRENCH:
        return make(header, store.types["geometry_msgs/msg/Wrench"](vector(), vector()))
    if kind == cdr.TEMPERATURE:
        return make(header, *numbers(2))
    if kind == cdr.IMU:
        turn = store.types["geometry_msgs/msg/Quaternion"](*numbers(4))
        nine = [np.array(numbers(9)) for _ in range(3)]
        return make(header, turn, nine[0], vector(), nine[1], vector(), nine[2])
    names = data.draw(st.lists(TEXT, max_size=4))
    return make(header, names, *(np.array(numbers(data.draw(st.integers(0, 3)))) for _ in range(3)))


def serialized(store: Any, content: Any, encoding: str) -> bytes:
    if encoding == "ros1":
        return bytes(store.serialize_ros1(content, content.__msgtype__))
    little = encoding == "cdr_le"
    return bytes(store.serialize_cdr(content, content.__msgtype__, little_endian=little))


def expected(content: Any) -> tuple[int, str, tuple[str, ...], list[float]]:
    stamp = content.header.stamp
    names: tuple[str, ...] = ()
    if content.__msgtype__ == cdr.JOINTS:
        names = tuple(content.name)
        values: Sequence[float] = [*content.position, *content.effort]
    elif content.__msgtype__ == cdr.IMU:
        values = vars(content.linear_acceleration).values()
    elif content.__msgtype__ == cdr.WRENCH:
        force, torque = content.wrench.force, content.wrench.torque
        values = [force.x, force.y, force.z, torque.x, torque.y, torque.z]
    else:
        values = [content.temperature]
    values = [x for x in values if not isinstance(x, str)]
    return stamp.sec * 10**9 + stamp.nanosec, content.header.frame_id, names, list(values)


def decoder(encoding: str) -> tuple[Any, Decoder]:
    if encoding == "ros1":
        store = get_typestore(Stores.ROS1_NOETIC)
        return store, Decoder(store.deserialize_ros1, is_ros1=True)
    store = get_typestore(Stores.ROS2_HUMBLE)
    return store, Decoder(store.deserialize_cdr, is_ros1=False)


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("kind", cdr.DEFINITIONS)
def test_every_message_is_decoded_to_the_last_bit(kind: str, encoding: str) -> None:
    store, mine = decoder(encoding)

    @settings(max_examples=25)
    @given(st.data())
    def check(data: st.DataObject) -> None:
        content = content_of(store, kind, data, encoding == "ros1")
        found = mine.decode("/topic", kind, 5, serialized(store, content, encoding))
        stamp, frame, names, values = expected(content)
        assert (found.topic, found.log_ns, found.stamp_ns) == ("/topic", 5, stamp)
        assert (found.shape.frame, found.shape.names) == (frame, names)
        assert found.numbers == np.array(values, dtype="<f8").tobytes()
        assert sum(found.shape.counts) == len(values)
        if kind == cdr.JOINTS:
            assert found.shape.counts == (len(content.position), len(content.effort))

    check()


def joint_message(encoding: str, mine: Decoder, store: Any, *args: Any) -> Message:
    names, position = args
    time = store.types["builtin_interfaces/msg/Time"](1, 2)
    seq = [0] if encoding == "ros1" else []
    content = store.types[cdr.JOINTS](
        store.types["std_msgs/msg/Header"](*seq, time, ""),
        names,
        np.array(position),
        np.zeros(0),
        np.zeros(0),
    )
    return mine.decode("/j", cdr.JOINTS, 0, serialized(store, content, encoding))


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_senders_keep_their_shape_and_never_take_that_of_another(encoding: str) -> None:
    """Same length, other names: as bytes, the messages differ in a few letters only."""
    store, mine = decoder(encoding)
    left, right = (["hip_l", "knee_l"], ["hip_r", "knee_r"])
    found = [
        joint_message(encoding, mine, store, names, [float(k), 1.0])
        for k, names in enumerate([left, right, left, right, left])
    ]
    assert [m.shape.names for m in found] == [tuple(n) for n in (left, right, left, right, left)]
    assert found[0].shape is found[2].shape is found[4].shape
    assert found[1].shape is found[3].shape is not found[0].shape
    assert [struct.unpack("<2d", m.numbers)[0] for m in found] == [0.0, 1.0, 2.0, 3.0, 4.0]


@pytest.mark.parametrize("encoding", ["ros1", "cdr_le"])
def test_a_message_that_is_cut_short_is_refused(encoding: str) -> None:
    store, mine = decoder(encoding)
    time = store.types["builtin_interfaces/msg/Time"](1, 2)
    seq = [0] if encoding == "ros1" else []
    header = store.types["std_msgs/msg/Header"](*seq, time, "frame")
    whole = serialized(store, store.types[cdr.TEMPERATURE](header, 1.0, 2.0), encoding)
    assert struct.unpack("<d", mine.decode("/t", cdr.TEMPERATURE, 0, whole).numbers) == (1.0,)
    for size in (10, 14, 20, len(whole) - 1):
        with pytest.raises(ValueError, match="too short"):
            mine.decode("/t", cdr.TEMPERATURE, 0, whole[:size])
