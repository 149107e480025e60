# SPDX-License-Identifier: Apache-2.0
"""The names of the columns of ``poses.csv``, as data.

A robot fixes the list: one column of each joint family per independent joint, one of each wrench
channel per sensor or plate. ``se.``, ``sd.`` and ``slope.`` stand before the name of any measured
column, ``cov.<sensor>.<a>.<b>`` between two channels of one sensor.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from enum import Enum
from itertools import combinations

from comcal.robot.model import Robot
from comcal.robot.tree import JointType

FORCES = ("fx", "fy", "fz")
MOMENTS = ("tx", "ty", "tz")
CHANNELS = FORCES + MOMENTS


class Family(Enum):
    """What kind of thing a column holds."""

    PLAIN = "plain"
    APPROACH = "approach"
    JOINT = "q"
    JOINT_VELOCITY = "qd"
    JOINT_ACCELERATION = "qdd"
    CURRENT = "i"
    TORQUE = "tau"
    WRENCH = "ft"
    COVARIANCE = "cov"
    COM = "com"
    COP = "cop"
    IMU = "imu"
    TEMPERATURE = "temperature"
    STANDARD_ERROR = "se"
    DEVIATION = "sd"
    SLOPE = "slope"


@dataclass(frozen=True)
class Column:
    """One known column.

    Parameters
    ----------
    name : str
    family : Family
    unit : str
        SI unit of the numbers; empty for words, ids and signs.
    target : str
        Joint, sensor or, for ``se.``, ``sd.`` and ``slope.``, the measured column meant.
    noise : str
        The field of :class:`~comcal.robot.model.Noise` that holds its standard error, if any.
    """

    name: str
    family: Family
    unit: str = ""
    target: str = ""
    noise: str = ""


PLAIN = {
    "pose": "",
    "configuration": "",
    "tilt": "rad",
    "revisit": "",
    "heading": "rad",
    "stance": "",
    "condition": "",
    "support": "",
    "floor.roll": "rad",
    "floor.pitch": "rad",
    "base.roll": "rad",
    "base.pitch": "rad",
    "t": "s",
    "com.frame": "",
    "n": "",
    "use": "",
}
"""Columns that stand for themselves, with their units."""

WORDS = ("configuration", "revisit", "stance", "condition", "support", "com.frame")
"""Columns that hold words."""


def wrench_names(robot: Robot) -> tuple[str, ...]:
    """Return the names a wrench column may carry: sensors, then plates."""
    return (*robot.sensors, *robot.plates)


def known_columns(robot: Robot) -> dict[str, Column]:
    """Return every column that ``poses.csv`` of *robot* may have, by name."""
    columns = [Column(name, Family.PLAIN, unit) for name, unit in PLAIN.items()]
    measured = _measured_columns(robot)
    columns += measured
    for joint in robot.tree.joints:
        if joint.name in robot.tree.joint_names:
            unit = _position_unit(joint.kind)
            columns += [
                Column(f"approach.{joint.name}", Family.APPROACH, "", joint.name),
                Column(f"qd.{joint.name}", Family.JOINT_VELOCITY, f"{unit}/s", joint.name),
                Column(f"qdd.{joint.name}", Family.JOINT_ACCELERATION, f"{unit}/s^2", joint.name),
            ]
    for column in measured:
        columns += [
            Column(f"se.{column.name}", Family.STANDARD_ERROR, column.unit, column.name),
            Column(f"sd.{column.name}", Family.DEVIATION, column.unit, column.name),
            Column(f"slope.{column.name}", Family.SLOPE, f"{column.unit}/s", column.name),
        ]
    for sensor in wrench_names(robot):
        for a, b in combinations(CHANNELS, 2):
            unit = f"{_channel_unit(a)}*{_channel_unit(b)}"
            columns += [
                Column(f"cov.{sensor}.{a}.{b}", Family.COVARIANCE, unit, sensor),
                Column(f"cov.{sensor}.{b}.{a}", Family.COVARIANCE, unit, sensor),
            ]
    return {column.name: column for column in columns}


def _measured_columns(robot: Robot) -> list[Column]:
    columns: list[Column] = []
    for joint in robot.tree.joints:
        if joint.name in robot.tree.joint_names:
            position, effort = _position_unit(joint.kind), _effort_unit(joint.kind)
            columns += [
                Column(f"q.{joint.name}", Family.JOINT, position, joint.name, "encoder"),
                Column(f"tau.{joint.name}", Family.TORQUE, effort, joint.name, "torque"),
                Column(f"i.{joint.name}", Family.CURRENT, "A", joint.name, "current"),
            ]
    for sensor in wrench_names(robot):
        columns += [
            Column(f"ft.{sensor}.{c}", Family.WRENCH, _channel_unit(c), sensor, channel_noise(c))
            for c in CHANNELS
        ]
        columns.append(Column(f"temperature.{sensor}", Family.TEMPERATURE, "degC", sensor))
    columns += [Column(f"com.{axis}", Family.COM, "m", noise="com") for axis in "xyz"]
    columns += [Column(f"cop.{axis}", Family.COP, "m", noise="com") for axis in "xy"]
    columns += [Column(f"imu.{a}", Family.IMU, "m/s^2", noise="imu") for a in ("ax", "ay", "az")]
    columns.append(Column("temperature", Family.TEMPERATURE, "degC"))
    return columns


def _position_unit(kind: JointType) -> str:
    return "m" if kind is JointType.PRISMATIC else "rad"


def _effort_unit(kind: JointType) -> str:
    return "N" if kind is JointType.PRISMATIC else "N*m"


def _channel_unit(channel: str) -> str:
    return "N" if channel in FORCES else "N*m"


def channel_noise(channel: str) -> str:
    """Return the field of :class:`~comcal.robot.model.Noise` of a wrench channel."""
    return "ft_force" if channel in FORCES else "ft_moment"


@dataclass(frozen=True)
class Header:
    """A header row, understood.

    Parameters
    ----------
    index : mapping from column name to int
        Position of every known column.
    columns : mapping from name to Column
        The known columns that are there.
    unknown : mapping from column name to str
        The others, with the name that was probably meant (or an empty text).
    """

    index: Mapping[str, int]
    columns: Mapping[str, Column]
    unknown: Mapping[str, str]

    def of(self, family: Family) -> tuple[Column, ...]:
        """Return the columns of one family, in the order of the file."""
        return tuple(c for c in self.columns.values() if c.family is family)


def understand(header: Sequence[str], robot: Robot) -> Header:
    """Sort the names of a header row into known and unknown ones.

    Parameters
    ----------
    header : sequence of str
    robot : Robot
    """
    known = known_columns(robot)
    return Header(
        {name: i for i, name in enumerate(header) if name in known},
        {name: known[name] for name in header if name in known},
        {name: near_miss(name, known) for name in header if name not in known},
    )


def near_miss(name: str, known: Iterable[str]) -> str:
    """Return the known name that *name* was probably meant to be, or an empty text.

    Examples
    --------
    >>> near_miss("q.l_kne", ["q.l_knee", "q.r_knee", "tau.l_knee"])
    'q.l_knee'
    """
    by_lower = {k.lower(): k for k in known}
    near = get_close_matches(name.lower(), by_lower, n=1, cutoff=0.8)
    return by_lower[near[0]] if near else ""
