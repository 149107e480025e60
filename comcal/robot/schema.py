# SPDX-License-Identifier: Apache-2.0
"""The keys of ``robot.yaml``, their types and their units.

Only the shape of the file is checked here; what needs the URDF is in ``description.py``.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Annotated, Any, Literal, cast

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    StringConstraints,
    model_validator,
)

from comcal.errors import ConfigError
from comcal.robot.units import Dimension, parse_quantity


def _in(dimension: Dimension) -> BeforeValidator:
    """Return the validator that brings a number or a text with a unit to SI."""

    def convert(value: object) -> float:
        return parse_quantity(value, dimension)

    return BeforeValidator(convert)


def _unit_axis(value: object) -> list[float]:
    """Return the unit vector of ``x``, ``-y``, ... or of three numbers."""
    if isinstance(value, str) and value in _AXES:
        return _AXES[value]
    if not isinstance(value, list):
        raise ConfigError(
            "an axis must be one of x, y, z, -x, -y, -z or three numbers",
            measured=f"got {str(cast('object', value))[:60]!r}",
        )
    vector = [parse_quantity(v, Dimension.RATIO) for v in cast("list[object]", value)]
    length = math.hypot(*vector)
    if len(vector) != 3 or length < _SMALLEST_AXIS:
        raise ConfigError("an axis must have three numbers that are not all zero")
    return [v / length for v in vector]


def _refuse(*names: str) -> Callable[[str], str]:
    """Return the validator that keeps reserved words from being used as names."""

    def check(name: str) -> str:
        if name in names:
            raise ConfigError(f"{name!r} has a meaning of its own and cannot be a name here")
        return name

    return check


_SMALLEST_AXIS = 1e-6
_AXES: dict[str, list[float]] = {
    sign + name: [factor * float(name == other) for other in "xyz"]
    for sign, factor in (("", 1.0), ("+", 1.0), ("-", -1.0))
    for name in "xyz"
}

Length = Annotated[float, _in(Dimension.LENGTH)]
Angle = Annotated[float, _in(Dimension.ANGLE)]
Mass = Annotated[float, _in(Dimension.MASS)]
Ratio = Annotated[float, _in(Dimension.RATIO)]
NonNegative = Field(ge=0.0)
Positive = Field(gt=0.0)
Vector = Annotated[list[Length], Field(min_length=3, max_length=3)]
Corner = Annotated[list[Length], Field(min_length=2, max_length=2)]

Text = Annotated[str, StringConstraints(strict=True, min_length=1, strip_whitespace=True)]
# Names become parts of CSV columns (ft.<sensor>.fx), so dots, commas and blanks are out.
Name = Annotated[str, StringConstraints(strict=True, pattern=r"^[A-Za-z_][A-Za-z0-9_\-]*$")]
FootName = Annotated[Name, AfterValidator(_refuse("double", "none"))]
EntryName = Annotated[Text, AfterValidator(_refuse("base"))]


class Section(BaseModel):
    """A map of ``robot.yaml``; keys that it does not know are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class BelowSection(Section):
    """What hangs below the cut: mass, and CoM in the frame of the sensor's joint."""

    mass: Annotated[Mass, NonNegative]
    com: Vector
    override: Annotated[bool, Field(strict=True)] = False


class SensorSection(Section):
    """One force/torque sensor."""

    joint: Text
    sense: Literal["on_robot", "on_ground"] = "on_robot"
    below: BelowSection | None = None


class FrameSection(Section):
    """A frame in a link, by URDF's ``xyz`` and ``rpy``."""

    xyz: Vector = Field(default_factory=lambda: [0.0, 0.0, 0.0])
    rpy: Annotated[list[Angle], Field(min_length=3, max_length=3)] = Field(
        default_factory=lambda: [0.0, 0.0, 0.0]
    )


class FootSection(Section):
    """One foot."""

    link: Text
    sensor: Text | None = None
    sole: Annotated[list[Corner], Field(min_length=3)] | None = None
    sole_frame: FrameSection | None = None
    ankle: Text | None = None


class PlateSection(Section):
    """One force plate under one or more feet."""

    frame: Text = "world"
    feet: Annotated[list[Text], Field(min_length=1)]


class MotorSection(Section):
    """The motor of one joint."""

    torque_constant: Annotated[float, _in(Dimension.TORQUE_CONSTANT), Positive]
    gear: Annotated[Ratio, Positive] = 1.0
    sign: Literal[1, -1] = 1


class ImuSection(Section):
    """Where the IMU sits."""

    link: Text


class NoiseFamilies(Section):
    """One standard error per family of channels."""

    ft_force: Annotated[float, _in(Dimension.FORCE), NonNegative] | None = None
    ft_moment: Annotated[float, _in(Dimension.MOMENT), NonNegative] | None = None
    encoder: Annotated[Angle, NonNegative] | None = None
    current: Annotated[float, _in(Dimension.CURRENT), NonNegative] | None = None
    torque: Annotated[float, _in(Dimension.MOMENT), NonNegative] | None = None
    imu: Annotated[float, _in(Dimension.ACCELERATION), NonNegative] | None = None
    com: Annotated[Length, NonNegative] | None = None


class NoiseSection(NoiseFamilies):
    """Standard errors of a pose mean, and their scatter between visits of one pose."""

    revisit: NoiseFamilies = NoiseFamilies()


class TolerancesSection(Section):
    """Healthy spread (one sigma) per family, named as the effects are.

    Families with forces and moments are split, as ``noise`` is.
    """

    link_mass: Annotated[Ratio, NonNegative] | None = None
    link_com: Annotated[Length, NonNegative] | None = None
    link_length: Annotated[Length, NonNegative] | None = None
    ft_bias_force: Annotated[float, _in(Dimension.FORCE), NonNegative] | None = None
    ft_bias_moment: Annotated[float, _in(Dimension.MOMENT), NonNegative] | None = None
    ft_gain: Annotated[Ratio, NonNegative] | None = None
    ft_crosstalk: Annotated[Ratio, NonNegative] | None = None
    ft_mounting: Annotated[Angle, NonNegative] | None = None
    ft_position: Annotated[Length, NonNegative] | None = None
    sole_mass: Annotated[Mass, NonNegative] | None = None
    joint_offset: Annotated[Angle, NonNegative] | None = None
    joint_compliance: Annotated[float, _in(Dimension.COMPLIANCE), NonNegative] | None = None
    backlash: Annotated[Angle, NonNegative] | None = None
    hysteresis: Annotated[Angle, NonNegative] | None = None
    joint_friction: Annotated[float, _in(Dimension.MOMENT), NonNegative] | None = None
    torque_constant: Annotated[Ratio, NonNegative] | None = None
    current_offset: Annotated[float, _in(Dimension.CURRENT), NonNegative] | None = None
    sole_compliance: Annotated[float, _in(Dimension.COMPLIANCE), NonNegative] | None = None
    ground_tilt: Annotated[Angle, NonNegative] | None = None
    imu_mounting: Annotated[Angle, NonNegative] | None = None
    foot_placement: Annotated[Length, NonNegative] | None = None
    foot_placement_angle: Annotated[Angle, NonNegative] | None = None
    cable_pull: Annotated[float, _in(Dimension.FORCE), NonNegative] | None = None
    timing_skew: Annotated[float, _in(Dimension.TIME), NonNegative] | None = None


class LimitsSection(Section):
    """Optional gate of the verdict."""

    com_error: Annotated[Length, Positive] | None = None
    mass_error: Annotated[Mass, Positive] | None = None


class ChainEntry(Section):
    """One joint and its link in a chain without URDF."""

    name: EntryName
    parent: Text | None = None
    axis: Annotated[list[float], BeforeValidator(_unit_axis)]


class RobotFile(Section):
    """The whole of ``robot.yaml``."""

    format: Literal["comcal-robot/1"]
    name: Text
    urdf: Text | None = None
    chain: Annotated[list[ChainEntry], Field(min_length=1)] | None = None
    gravity: Annotated[float, _in(Dimension.ACCELERATION), Field(gt=0.0, le=30.0)] = 9.81
    base: Literal["floating", "fixed"] = "floating"
    sensors: dict[Name, SensorSection] = Field(default_factory=dict)
    feet: dict[FootName, FootSection] = Field(default_factory=dict)
    plates: dict[Name, PlateSection] = Field(default_factory=dict)
    motors: dict[Text, MotorSection] = Field(default_factory=dict)
    imu: ImuSection | None = None
    noise: NoiseSection = NoiseSection()
    tolerances: TolerancesSection = TolerancesSection()
    sources: dict[Text, dict[str, Any]] = Field(default_factory=dict)
    commanders: dict[Text, dict[str, Any]] = Field(default_factory=dict)
    limits: LimitsSection = LimitsSection()

    @model_validator(mode="after")
    def _one_tree(self) -> RobotFile:
        if (self.urdf is None) == (self.chain is None):
            raise ConfigError(
                "the robot must have either `urdf:` or `chain:`",
                measured="both are there" if self.urdf else "neither is there",
            )
        return self
