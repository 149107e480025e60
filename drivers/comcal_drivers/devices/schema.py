# SPDX-License-Identifier: Apache-2.0
"""The keys of ``sources.can`` in robot.yaml, their types and their units."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from comcal.robot.schema import Angle
from comcal.robot.units import Dimension, parse_quantity


def _seconds(value: object) -> float:
    return parse_quantity(value, Dimension.TIME)


Seconds = Annotated[float, BeforeValidator(_seconds), Field(gt=0.0)]
Angles = tuple[Angle, Angle, Angle]
Sign = Literal[1, -1]
Signs = tuple[Sign, Sign, Sign, Sign, Sign, Sign]
Positive = Annotated[float, Field(gt=0.0)]


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class BusSection(BaseModel):
    """A bus; keys that are not named here are handed to ``can.Bus``."""

    model_config = ConfigDict(extra="allow", frozen=True)

    interface: str
    channel: str | int = ""
    bitrate: int | None = Field(None, gt=0)


class DeviceSection(_Section):
    """What every device has."""

    bus: str
    device: str
    ids: dict[str, int] = Field(default_factory=dict)
    period: Seconds | None = None
    timeout: Seconds | None = None
    apart: Seconds | None = None
    counter_step: int | None = Field(None, ge=0)
    ignore_status: tuple[int, ...] = ()
    settings: dict[str, float] = Field(default_factory=dict)
    start: tuple[str, ...] | None = None


class SensorSection(DeviceSection):
    """A force/torque sensor."""

    matrix: list[list[float]] | str | None = None
    bias: list[float] | None = None
    scale: list[float] | float | None = None
    full_scale: list[float] | None = None
    counts_per_force: Positive | None = None
    counts_per_torque: Positive | None = None
    signs: Signs = (1, 1, 1, 1, 1, 1)
    rotate: Angles = (0.0, 0.0, 0.0)


class JointSection(DeviceSection):
    """A drive."""

    counts_per_turn: Positive | None = None
    gear: float | None = Field(None, gt=0.0)
    sign: Sign = 1
    zero: Angle = 0.0
    rated_current: Positive | None = None
    rated_torque: Positive | None = None
    ranges: dict[str, tuple[float, float]] = Field(default_factory=dict)
    eds: str | None = None
    dcf: str | None = None
    sync_period: Seconds | None = None


class ImuSection(DeviceSection):
    """The IMU."""

    rotate: Angles = (0.0, 0.0, 0.0)


class CanSection(_Section):
    """``sources.can``."""

    buses: dict[str, BusSection] = Field(min_length=1)
    sensors: dict[str, SensorSection] = Field(default_factory=dict)
    joints: dict[str, JointSection] = Field(default_factory=dict)
    imu: ImuSection | None = None
    clock: str | None = None


class SourcesSection(_Section):
    """``sources``, of which only this part is looked at here."""

    can: CanSection


class OptionsFile(_Section):
    """The part of robot.yaml that is looked at here."""

    sources: SourcesSection
