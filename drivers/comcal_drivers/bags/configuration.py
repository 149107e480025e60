# SPDX-License-Identifier: Apache-2.0
"""What ``sources.bag`` of robot.yaml may say. Every key is optional.

::

    sources:
      bag:
        topics:                       # what is not named here is found by type and name
          l_foot: /ft/left            # a sensor or plate: WrenchStamped
          joints: /joint_states       # JointState; a list where several topics share the joints
          currents: /motor_currents   # JointState whose effort holds amperes
          imu: null                   # Imu; null: do not read
          temperature.l_foot: /temp   # Temperature
        clock: l_foot                 # whose samples make the rows; default: the first wrench
        effort: ignore                # of `joints`: torque [N m], current [A] or ignore
        stamps: auto                  # header, log, or auto: header if all topics share a clock
        timeout: 0.1                  # older values do not count [s]; 60 s for temperatures
        joint_names: {l_knee: LeftKnee}     # names in the messages, where they differ
        units: {moment: N mm, angle: deg}   # of the messages, where they are not SI
        arrival: 0.05                 # a pose is reached when every joint is this near [rad or m]
        stay: 0.5                     # shorter visits are passing through [s]
        order: planned                # any: the poses come in another order than in the plan
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from comcal.errors import ConfigError
from comcal.robot.locate import LocatedYaml, read_yaml
from comcal.robot.model import Robot
from comcal.robot.units import UNITS, Dimension, parse_quantity
from comcal.robot.validate import did_you_mean, validate_file

SECTION = ("sources", "bag")
JOINTS, CURRENTS, IMU, TEMPERATURE = "joints", "currents", "imu", "temperature."
"""Channels beside the wrenches; the last one is followed by the name of a sensor."""


def _quantity(dimension: Dimension) -> BeforeValidator:
    return BeforeValidator(lambda value: parse_quantity(value, dimension))


def _factor(dimension: Dimension) -> BeforeValidator:
    """Return the validator that turns the name of a unit into its factor to SI."""

    def convert(unit: object) -> float:
        units = UNITS[dimension]
        if not isinstance(unit, str) or unit not in units:
            raise ConfigError(
                f"{unit!r} is not a unit of {dimension.value}",
                next_step=did_you_mean(str(unit), list(units)),
            )
        return units[unit]

    return BeforeValidator(convert)


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class UnitsSection(_Section):
    """Factors from the numbers in the messages to SI; written as units."""

    force: Annotated[float, _factor(Dimension.FORCE)] = 1.0
    moment: Annotated[float, _factor(Dimension.MOMENT)] = 1.0
    angle: Annotated[float, _factor(Dimension.ANGLE)] = 1.0
    length: Annotated[float, _factor(Dimension.LENGTH)] = 1.0
    current: Annotated[float, _factor(Dimension.CURRENT)] = 1.0
    torque: Annotated[float, _factor(Dimension.MOMENT)] = 1.0
    acceleration: Annotated[float, _factor(Dimension.ACCELERATION)] = 1.0


Topics = str | list[str] | None
Time = Annotated[float, _quantity(Dimension.TIME), Field(gt=0.0)]


class BagSection(_Section):
    """The whole of ``sources.bag``."""

    topics: dict[str, Topics] = Field(default_factory=dict)
    clock: str | None = None
    effort: Literal["current", "torque", "ignore"] | None = None
    stamps: Literal["auto", "header", "log"] = "auto"
    timeout: Time = 0.1
    joint_names: dict[str, str] = Field(default_factory=dict)
    units: UnitsSection = UnitsSection()
    arrival: Annotated[float, _quantity(Dimension.ANGLE), Field(gt=0.0)] = 0.05
    stay: Annotated[float, _quantity(Dimension.TIME), Field(ge=0.0)] = 0.5
    order: Literal["planned", "any"] = "planned"


def read_configuration(options: Mapping[str, object] | None, robot: Robot) -> BagSection:
    """Check ``sources.bag`` against its schema and the robot.

    Parameters
    ----------
    options : mapping or None
        As parsed from robot.yaml.
    robot : Robot

    Raises
    ------
    ConfigError
        If a key, channel, joint or unit is unknown or a value is out of range. The message names
        the line and what was probably meant.
    """
    located = _located(dict(options or {}), robot)
    section = validate_file(located, BagSection)
    channels = [
        *robot.sensors,
        *robot.plates,
        JOINTS,
        CURRENTS,
        IMU,
        *(TEMPERATURE + name for name in (*robot.sensors, *robot.plates)),
    ]
    for channel, topic in section.topics.items():
        _known("channel", channel, channels, located, ("topics", channel))
        if isinstance(topic, list) and channel not in (JOINTS, CURRENTS):
            raise ConfigError(
                f"channel {channel!r} can have one topic only",
                where=located.where("topics", channel),
                measured=f"it has {len(topic)}",
                next_step="give the one to read",
            )
        if channel == JOINTS and not topic:
            raise ConfigError(
                "joint positions cannot be left out",
                where=located.where("topics", channel),
                next_step="give the topic that has them, or remove the line",
            )
    if section.clock is not None:
        _known("channel", section.clock, channels, located, ("clock",))
    for joint in section.joint_names:
        _known("joint", joint, robot.tree.joint_names, located, ("joint_names", joint))
    if section.effort == "current" and section.topics.get(CURRENTS):
        raise ConfigError(
            "motor currents come from two places",
            where=located.where("effort"),
            next_step=f"remove `effort: current` or the topic of {CURRENTS}",
        )
    return section


def _known(
    kind: str,
    name: str,
    names: list[str] | tuple[str, ...],
    located: LocatedYaml,
    path: tuple[str, ...],
) -> None:
    if name not in names:
        raise ConfigError(
            f"the robot has no {kind} {name!r}",
            where=located.where(*path),
            next_step=did_you_mean(name, list(names)),
        )


def _located(options: dict[str, Any], robot: Robot) -> LocatedYaml:
    """Return the section with the lines on which its keys stand in robot.yaml."""
    path = robot.yaml_path
    if path is None or not path.is_file():
        return LocatedYaml(path or Path("robot.yaml"), options, {})
    depth = len(SECTION)
    lines = {
        key[depth:]: line for key, line in read_yaml(path).lines.items() if key[:depth] == SECTION
    }
    return LocatedYaml(path, options, lines)
