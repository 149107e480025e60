# SPDX-License-Identifier: Apache-2.0
"""What can be said about an effect and its parameters without physics: the kinds of the table."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

from comcal.robot.units import Dimension


class TargetKind(Enum):
    """What an effect sits at; the value names it in messages."""

    LINK = "link"
    JOINT = "joint"
    SENSOR = "sensor"
    FOOT = "foot"
    IMU = "imu"
    NONE = "nothing"


class Realisation(Enum):
    """How simulated data get an effect; rates of diagnosis are stated per class."""

    ENGINE = "engine"
    """By bodies, joints, contacts or forces in the physics engine."""
    SENSOR_FRAME = "sensor_frame"
    """By a sensor that is really mounted elsewhere in the simulated robot."""
    ACTUATOR = "actuator"
    """By a law at the motor that is stepped with the engine."""
    MODEL = "model"
    """By a formula on the readings, near what a diagnosis inverts."""
    NONE = "none"
    """Not at all: it exists in measured data, or in a model, only."""


class KeyKind(Enum):
    """What a parameter's value is."""

    NUMBER = "number"
    POSES = "poses"
    WORDS = "words"


@dataclass(frozen=True)
class Key:
    """One parameter of an effect.

    Parameters
    ----------
    name : str
    unit : str
        SI; ``1`` for ratios, empty for words and poses.
    kind : KeyKind
    required : bool
    least : float
        Smallest number allowed, in ``unit``.
    above : bool
        Whether it must be greater than ``least``, not equal.
    dimension : Dimension or None
        What ``unit`` measures; None where only SI may be written.
    """

    name: str
    unit: str
    kind: KeyKind = KeyKind.NUMBER
    required: bool = False
    least: float = -math.inf
    above: bool = False
    dimension: Dimension | None = None

    def allows(self, value: float) -> bool:
        """Whether a number is in the range."""
        return value > self.least if self.above else value >= self.least

    def range(self) -> str:
        """Return the range in words."""
        return f"{'above' if self.above else 'at least'} {self.least:g} {self.unit}".rstrip()

    def label(self) -> str:
        """Return ``mass [kg]``."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name


@dataclass(frozen=True)
class EffectSpec:
    """What can be said about an effect without physics.

    Parameters
    ----------
    name : str
    summary : str
        One line.
    targets : frozenset of TargetKind
    keys : mapping from str to Key
    realisation : Realisation
    has_all : bool
        Whether the target ``all`` is allowed.
    """

    name: str
    summary: str
    targets: frozenset[TargetKind]
    keys: Mapping[str, Key]
    realisation: Realisation
    has_all: bool = False
