# SPDX-License-Identifier: Apache-2.0
"""The ROS 2 messages of a recording, encoded many at once.

Little-endian plain CDR (XCDR1), which every ROS 2 understands. All messages of one topic have the
same names in them, hence the same layout: the bytes before the numbers are built once and the
stamps and numbers of all samples are filled in by numpy. (A general encoder, message by message,
takes longer than a simulated robot needs to be measured.)
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from comcal.robot.tree import Array

_HEADER = """================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
_VECTOR = """================================================================================
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
"""

DEFINITIONS = {
    "geometry_msgs/msg/WrenchStamped": f"""std_msgs/Header header
geometry_msgs/Wrench wrench
{_HEADER}================================================================================
MSG: geometry_msgs/Wrench
geometry_msgs/Vector3 force
geometry_msgs/Vector3 torque
{_VECTOR}""",
    "sensor_msgs/msg/JointState": f"""std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
{_HEADER}""",
    "sensor_msgs/msg/Imu": f"""std_msgs/Header header
geometry_msgs/Quaternion orientation
float64[9] orientation_covariance
geometry_msgs/Vector3 angular_velocity
float64[9] angular_velocity_covariance
geometry_msgs/Vector3 linear_acceleration
float64[9] linear_acceleration_covariance
{_HEADER}================================================================================
MSG: geometry_msgs/Quaternion
float64 x 0
float64 y 0
float64 z 0
float64 w 1
{_VECTOR}""",
    "sensor_msgs/msg/Temperature": f"""std_msgs/Header header
float64 temperature
float64 variance
{_HEADER}""",
}
"""Message definitions in the format that MCAP calls ``ros2msg``, by type."""

WRENCH, JOINTS, IMU, TEMPERATURE = DEFINITIONS

_STAMP = 4
"""Where the stamp stands: after the encapsulation header."""
_PRECEDING_NUMBERS_OF_IMU = (0.0, 0.0, 0.0, 1.0, -1.0, *[0.0] * 8, 0.0, 0.0, 0.0, -1.0, *[0.0] * 8)
"""Unit quaternion and rates, both with covariance -1: by convention, not measured."""


@dataclass(frozen=True)
class Layout:
    """The bytes of one kind of message and where its numbers go.

    Parameters
    ----------
    template : bytes
        A whole message with zeros for stamp and numbers.
    runs : tuple of (int, int)
        Offset in the template and count of each run of float64 numbers.
    """

    template: bytes
    runs: tuple[tuple[int, int], ...]

    def encode(self, stamps_ns: Sequence[int], numbers: Array) -> list[bytes]:
        """Return one message per row.

        Parameters
        ----------
        stamps_ns : sequence of int, length n
            Times [ns], not negative.
        numbers : array, shape (n, sum of the counts of ``runs``)
        """
        n = len(stamps_ns)
        size = len(self.template)
        messages = np.tile(np.frombuffer(self.template, dtype=np.uint8), (n, 1))
        stamps = np.asarray(stamps_ns, dtype=np.int64)
        split = np.stack([stamps // 1_000_000_000, stamps % 1_000_000_000], axis=1)
        messages[:, _STAMP : _STAMP + 8] = split.astype("<u4").view(np.uint8)
        done = 0
        for offset, count in self.runs:
            chosen = np.ascontiguousarray(numbers[:, done : done + count], dtype="<f8")
            messages[:, offset : offset + 8 * count] = chosen.view(np.uint8).reshape(n, 8 * count)
            done += count
        whole = messages.tobytes()
        return [whole[i * size : (i + 1) * size] for i in range(n)]


class _Builder:
    """Grows a template; alignment counts from behind the encapsulation header."""

    def __init__(self, frame_id: str) -> None:
        self.bytes = bytearray(b"\x00\x01\x00\x00" + bytes(8))
        self.runs: list[tuple[int, int]] = []
        self.text(frame_id)

    def align(self, size: int) -> None:
        self.bytes += bytes(-(len(self.bytes) - 4) % size)

    def count(self, value: int) -> None:
        self.align(4)
        self.bytes += struct.pack("<I", value)

    def text(self, value: str) -> None:
        encoded = value.encode() + b"\0"
        self.count(len(encoded))
        self.bytes += encoded

    def numbers(self, count: int) -> None:
        """Leave a hole of float64 numbers."""
        self.align(8)
        self.runs.append((len(self.bytes), count))
        self.bytes += bytes(8 * count)

    def constants(self, values: Sequence[float]) -> None:
        self.align(8)
        self.bytes += struct.pack(f"<{len(values)}d", *values)

    def layout(self) -> Layout:
        return Layout(bytes(self.bytes), tuple(self.runs))


def wrench_layout(frame_id: str) -> Layout:
    """Return the layout of a WrenchStamped: six numbers, force then torque [N, N m]."""
    builder = _Builder(frame_id)
    builder.numbers(6)
    return builder.layout()


def joint_layout(names: Sequence[str], *, position: bool, effort: bool) -> Layout:
    """Return the layout of a JointState: positions [rad or m], then efforts [N m or N].

    Parameters
    ----------
    names : sequence of str
    position, effort : bool
        Whether the message has them; each takes as many numbers as there are names.
    """
    builder = _Builder("")
    builder.count(len(names))
    for name in names:
        builder.text(name)
    for present in (position, False, effort):  # velocity is never measured
        builder.count(len(names) if present else 0)
        if present and names:
            builder.numbers(len(names))
    return builder.layout()


def imu_layout(frame_id: str) -> Layout:
    """Return the layout of an Imu: three numbers, the specific force [m/s^2]."""
    builder = _Builder(frame_id)
    builder.constants(_PRECEDING_NUMBERS_OF_IMU)
    builder.numbers(3)
    builder.constants([0.0] * 9)
    return builder.layout()


def temperature_layout(frame_id: str) -> Layout:
    """Return the layout of a Temperature: one number [deg C]."""
    builder = _Builder(frame_id)
    builder.numbers(1)
    builder.constants([0.0])
    return builder.layout()
