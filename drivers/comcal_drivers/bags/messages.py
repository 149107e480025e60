# SPDX-License-Identifier: Apache-2.0
"""The four messages, decoded as fast as they come.

Most messages of a sender differ in their stamps and numbers only: frame, names and counts, hence
the places of the numbers, are found out once, and then merely compared. Whatever is not
little-endian CDR or ROS 1 is left to ``rosbags``.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from comcal.measure import cdr

NANOSECONDS = 1_000_000_000
_ENCAPSULATION = b"\x00\x01"
_STAMP = 4
_FRAME = 12
"""Where stamp and frame begin: behind the encapsulation in CDR, behind ``seq`` in ROS 1."""
_BEFORE_ACCELERATION = 4 + 9 + 3 + 9
"""Numbers of an Imu before those that are read: orientation and rates with their covariances."""
_NUMBERS = {cdr.WRENCH: 6, cdr.IMU: 3, cdr.TEMPERATURE: 1}
_unpack_stamp = struct.Struct("<iI").unpack_from
_unpack_count = struct.Struct("<I").unpack_from


@dataclass(frozen=True, eq=False)
class Shape:
    """What messages of one sender have in common; compared by identity.

    Parameters
    ----------
    kind : str
        Message type, such as ``sensor_msgs/msg/Imu``.
    frame : str
        Of the header.
    names : tuple of str
        Of joints.
    counts : tuple of int
        Numbers in each field that is read: of a JointState position and effort, else one field.
    """

    kind: str
    frame: str
    names: tuple[str, ...]
    counts: tuple[int, ...]


class Message(NamedTuple):
    """A message: when, from whom, and its numbers, field after field, as little-endian float64."""

    topic: str
    log_ns: int
    stamp_ns: int
    shape: Shape
    numbers: bytes


class _Template(NamedTuple):
    """A shape, the bytes between the numbers, and where the numbers are that are read."""

    shape: Shape
    fixed: tuple[tuple[int, int, bytes], ...]
    read: tuple[tuple[int, int], ...]


class Decoder:
    """Decodes the messages of one file.

    Parameters
    ----------
    general : callable
        Decodes any message, given its bytes and its type.
    is_ros1 : bool
    """

    def __init__(self, general: Callable[[bytes, str], Any], *, is_ros1: bool) -> None:
        self._general = general
        self._is_ros1 = is_ros1
        self._templates: dict[tuple[str, int], _Template] = {}
        self._shapes: dict[tuple[str, tuple[Any, ...]], Shape] = {}

    def decode(self, topic: str, kind: str, log_ns: int, raw: bytes) -> Message:
        """Return a message.

        Parameters
        ----------
        topic, kind : str
        log_ns : int
            When it was written [ns].
        raw : bytes

        Raises
        ------
        ValueError
            If it is too short, or not of this type.
        """
        key = topic, len(raw)
        template = self._templates.get(key)
        if template is None or not all(raw[a:b] == same for a, b, same in template.fixed):
            if not self._is_ros1 and raw[:2] != _ENCAPSULATION:
                return self._slowly(topic, kind, log_ns, raw)
            template = self._templates[key] = self._learn(topic, kind, raw)
        sec, nanosec = _unpack_stamp(raw, _STAMP)
        if len(template.read) == 1:
            ((a, b),) = template.read
            numbers = raw[a:b]
        else:
            numbers = b"".join(raw[a:b] for a, b in template.read)
        return Message(topic, log_ns, sec * NANOSECONDS + nanosec, template.shape, numbers)

    def _learn(self, topic: str, kind: str, raw: bytes) -> _Template:
        """Find out where the numbers of a message are."""
        walk = _Walk(raw, self._is_ros1)
        frame = walk.text()
        names: tuple[str, ...] = ()
        holes: list[tuple[int, int]] = []
        if kind == cdr.JOINTS:
            names = tuple(walk.text() for _ in range(walk.count()))
            holes = [walk.numbers(walk.count()) for _ in range(3)]
            read = (holes[0], holes[2])
        elif kind == cdr.IMU:
            holes = [walk.numbers(_BEFORE_ACCELERATION), walk.numbers(3), walk.numbers(9)]
            read = (holes[1],)
        else:
            holes = [walk.numbers(_NUMBERS[kind])]
            read = (holes[0],)
            if kind == cdr.TEMPERATURE:
                holes.append(walk.numbers(1))
        begins = [_FRAME, *(end for _, end in holes)]
        ends = [*(start for start, _ in holes), len(raw)]
        fixed = tuple((a, b, raw[a:b]) for a, b in zip(begins, ends, strict=True) if b > a)
        shape = self._shape(topic, kind, frame, names, tuple((b - a) // 8 for a, b in read))
        if not self._is_ros1:
            fixed = ((0, len(_ENCAPSULATION), _ENCAPSULATION), *fixed)
        return _Template(shape, fixed, read)

    def _slowly(self, topic: str, kind: str, log_ns: int, raw: bytes) -> Message:
        content = self._general(raw, kind)
        names: tuple[str, ...] = ()
        if kind == cdr.JOINTS:
            names = tuple(map(str, content.name))
            fields = [content.position, content.effort]
        elif kind == cdr.IMU:
            fields = [_vector(content.linear_acceleration)]
        elif kind == cdr.WRENCH:
            fields = [(*_vector(content.wrench.force), *_vector(content.wrench.torque))]
        else:
            fields = [(content.temperature,)]
        frame, counts = str(content.header.frame_id), tuple(map(len, fields))
        shape = self._shape(topic, kind, frame, names, counts)
        numbers = b"".join(np.asarray(field, dtype="<f8").tobytes() for field in fields)
        stamp = int(content.header.stamp.sec) * NANOSECONDS + int(content.header.stamp.nanosec)
        return Message(topic, log_ns, stamp, shape, numbers)

    def _shape(
        self, topic: str, kind: str, frame: str, names: tuple[str, ...], counts: tuple[int, ...]
    ) -> Shape:
        """Return the one shape of these properties."""
        key = topic, (kind, frame, names, counts)
        if key not in self._shapes:
            self._shapes[key] = Shape(kind, frame, names, counts)
        return self._shapes[key]


class _Walk:
    """Goes through the bytes of a message behind its stamp."""

    def __init__(self, raw: bytes, is_ros1: bool) -> None:
        self._raw = raw
        self._is_ros1 = is_ros1
        self._at = _FRAME

    def count(self) -> int:
        """Return the length that comes next."""
        self._align(4)
        if self._at + 4 > len(self._raw):
            raise ValueError("the message is too short")
        (count,) = _unpack_count(self._raw, self._at)
        self._at += 4
        return count

    def text(self) -> str:
        """Return the text that comes next."""
        size = self.count()
        text = self._raw[self._at : self._at + size]
        self._skip(size)
        return text.decode() if self._is_ros1 else text[:-1].decode()

    def numbers(self, count: int) -> tuple[int, int]:
        """Return where so many float64 begin and end."""
        if count:
            self._align(8)
        start = self._at
        self._skip(8 * count)
        return start, self._at

    def _skip(self, size: int) -> None:
        self._at += size
        if self._at > len(self._raw):
            raise ValueError("the message is too short")

    def _align(self, size: int) -> None:
        """CDR aligns, counted from behind the encapsulation; ROS 1 does not."""
        if not self._is_ros1:
            self._at += -(self._at - _STAMP) % size


def _vector(v: Any) -> tuple[float, float, float]:
    return v.x, v.y, v.z
