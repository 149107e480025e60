# SPDX-License-Identifier: Apache-2.0
"""``comcal check``: what comcal understands of a robot, and whether it can be used."""

from __future__ import annotations

import math
import os
import platform
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from importlib import metadata

from comcal.robot.description import load_robot
from comcal.robot.findings import Finding, Level
from comcal.robot.health import check_health
from comcal.robot.model import Foot, Robot, Sensor
from comcal.robot.soles import place_at_zero
from comcal.workflow.source_checks import check_sources

ENGINES = {"pybullet": "sim", "mujoco": "mujoco"}
"""Optional physics engines, and the extra of comcal that installs each."""


class Verdict(Enum):
    """Whether a robot can be used."""

    USABLE = "usable"
    USABLE_WITH_WARNINGS = "usable_with_warnings"
    NOT_USABLE = "not_usable"


@dataclass(frozen=True)
class Cut:
    """Where a sensor cuts the robot.

    Parameters
    ----------
    sensor : Sensor
    foot : str
        The foot that it belongs to; empty when it belongs to none.
    links : tuple of str
        What hangs below the cut, on the side of the foot.
    mass : float or None
        Of these links, or as ``below:`` in robot.yaml states it [kg]; None when not known.
    height : float or None
        Of the sensor's origin above the sole, along the sole's normal, at q = 0 [m]; None without
        a foot or without geometry.
    """

    sensor: Sensor
    foot: str
    links: tuple[str, ...]
    mass: float | None
    height: float | None


@dataclass(frozen=True)
class Engine:
    """An optional physics engine.

    Parameters
    ----------
    name : str
    version : str or None
        None when it is not installed.
    remedy : str
        How to get it; empty when it is there.
    """

    name: str
    version: str | None
    remedy: str


@dataclass(frozen=True)
class CheckResult:
    """What was understood, what was found, and what is installed."""

    robot: Robot
    cuts: tuple[Cut, ...]
    findings: tuple[Finding, ...]
    engines: tuple[Engine, ...]
    sources: Mapping[str, Sequence[str]] = field(default_factory=dict[str, Sequence[str]])
    """What sources understand of their options, line by line."""

    def count(self, level: Level) -> int:
        """Return the number of findings of one level."""
        return sum(finding.level is level for finding in self.findings)

    @property
    def total_mass(self) -> float | None:
        """Of all links [kg]; None for chains without URDF."""
        return _known(self.robot.tree.total_mass)

    @property
    def verdict(self) -> Verdict:
        """Errors make a robot unusable, warnings do not."""
        if self.count(Level.ERROR):
            return Verdict.NOT_USABLE
        return Verdict.USABLE_WITH_WARNINGS if self.count(Level.WARNING) else Verdict.USABLE


def check_robot(path: str | os.PathLike[str]) -> CheckResult:
    """Load a robot and check it.

    Parameters
    ----------
    path : path-like
        Of its ``robot.yaml``.

    Raises
    ------
    ConfigError
        If ``robot.yaml`` is missing or wrong, the options of its sources included.
    UrdfError
        If the URDF is missing or wrong.
    """
    robot = load_robot(path)
    sources, of_sources = check_sources(robot)
    return CheckResult(
        robot=robot,
        cuts=tuple(_cut(robot, sensor) for sensor in robot.sensors.values()),
        findings=(*check_health(robot), *of_sources),
        engines=tuple(_engine(name) for name in ENGINES),
        sources=sources,
    )


def _cut(robot: Robot, sensor: Sensor) -> Cut:
    """Describe the cut of one sensor."""
    below = robot.below_cut[sensor.name]
    foot = next((f for f in robot.feet.values() if f.sensor == sensor.name), None)
    mass = float(robot.tree.masses[below].sum()) if sensor.below is None else sensor.below.mass
    return Cut(
        sensor=sensor,
        foot=foot.name if foot else "",
        links=tuple(
            link.name for link, is_below in zip(robot.tree.links, below, strict=True) if is_below
        ),
        mass=_known(mass),
        height=_height(robot, sensor, foot) if foot and robot.tree.geometry_known else None,
    )


def _height(robot: Robot, sensor: Sensor, foot: Foot) -> float:
    """Return how far a sensor's origin is above its sole, along the sole's normal [m]."""
    placements = place_at_zero(robot.tree)
    R, p = placements.link(foot.link)
    sole = p[0] + R[0] @ foot.T_link_sole[:3, 3]
    normal = R[0] @ foot.T_link_sole[:3, 2]
    return float(normal @ (placements.joint(sensor.joint)[1][0] - sole))


def _engine(name: str) -> Engine:
    """Ask the installed distributions for an engine; importing it would take seconds."""
    try:
        return Engine(name, metadata.version(name), "")
    except metadata.PackageNotFoundError:
        pass
    if name == "pybullet" and (sys.version_info >= (3, 12) or platform.machine() != "x86_64"):
        here = f"Python {sys.version_info.major}.{sys.version_info.minor} on {platform.machine()}"
        return Engine(name, None, f"it has no package for {here}")
    return Engine(name, None, f"pip install 'comcal[{ENGINES[name]}]'")


def _known(value: float) -> float | None:
    """Return None for NaN, which stands for what a chain without URDF does not say."""
    return None if math.isnan(value) else value


def check_as_json(result: CheckResult) -> dict[str, object]:
    """Return the result as plain data, for ``--json``.

    Parameters
    ----------
    result : CheckResult

    Returns
    -------
    dict
        SI units; ``null`` where something is not known.
    """
    robot = result.robot
    return {
        "format": "comcal-check/1",
        "robot": robot.name,
        "verdict": result.verdict.value,
        "mass": result.total_mass,
        "gravity": robot.gravity,
        "base": robot.base.value,
        "links": [link.name for link in robot.tree.links],
        "joints": list(robot.tree.joint_names),
        "sensors": [
            {
                "sensor": cut.sensor.name,
                "joint": cut.sensor.joint,
                "sense": cut.sensor.sense.value,
                "foot": cut.foot or None,
                "below": {"links": list(cut.links), "mass": cut.mass, "height": cut.height},
            }
            for cut in result.cuts
        ],
        "feet": [
            {
                "foot": foot.name,
                "link": foot.link,
                "sensor": foot.sensor,
                "sole": None if foot.sole is None else foot.sole.tolist(),
                "ankle": foot.ankle,
            }
            for foot in robot.feet.values()
        ],
        "plates": [
            {"plate": plate.name, "frame": plate.frame, "feet": list(plate.feet)}
            for plate in robot.plates.values()
        ],
        "motors": [
            {
                "joint": motor.joint,
                "torque_per_ampere": motor.torque_constant * motor.gear * motor.sign,
            }
            for motor in robot.motors.values()
        ],
        "imu": robot.imu_link,
        "findings": [
            {
                "level": finding.level.value,
                "what": finding.what,
                "where": finding.where,
                "measured": finding.measured,
                "limit": finding.limit,
                "next_step": finding.next_step,
            }
            for finding in result.findings
        ],
        "engines": {engine.name: engine.version for engine in result.engines},
        "sources": {name: list(lines) for name, lines in result.sources.items()},
    }
