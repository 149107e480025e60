# SPDX-License-Identifier: Apache-2.0
"""The scenario file: robot, errors, poses and effects of the study of hidden effects."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from ruamel.yaml import YAML

from comcal.effects.registry import effects
from comcal.measure.plan import DOUBLE, PlannedPose
from comcal.measure.plan_csv import read_plan
from comcal.robot.changes import ALL, names_of
from comcal.robot.changes_kinds import TargetKind
from comcal.robot.changes_table import EFFECTS
from comcal.robot.description import load_robot
from comcal.robot.kinematics import place_links
from comcal.robot.model import Robot, Tolerances
from comcal_sims.robots.biped14 import Biped14Parameters, UpperBody, double_pose, generate

FILE = Path(__file__).resolve().parents[1] / "hidden" / "scenario.yaml"
FORCES = ("cable_pull", "tether", "external_contact")
"""Effects that act at the origin of a link."""
SINGLE, CONTACT, PUBLISHED = "single", "contact", "published"

Pair = tuple[str, str]
"""Effect and target."""


@dataclass(frozen=True)
class Stage:
    """A robot as designed, the poses that are recorded, and the errors of its sensors.

    Parameters
    ----------
    robot : Robot
        Its tolerances are those of the scenario.
    poses : tuple of PlannedPose
        In the order of the recording.
    options : mapping
        Of the simulated source: noise of a sample, climate.
    """

    robot: Robot
    poses: tuple[PlannedPose, ...]
    options: Mapping[str, float]


@dataclass(frozen=True)
class Scenario:
    """The content of the scenario file, and the robot that it speaks of.

    Parameters
    ----------
    data : mapping
        As it stands in the file.
    robot : Robot
    plan : tuple of PlannedPose
        As shipped with the robot.
    """

    data: Mapping[str, Any]
    robot: Robot
    plan: tuple[PlannedPose, ...]

    @property
    def noise(self) -> Mapping[str, float]:
        """One sigma of the mean of a pose, by kind of reading."""
        return self.data["noise"]

    @property
    def samples(self) -> int:
        """Samples that make a mean."""
        return self.data["samples"]

    def fault(self, effect: str) -> Mapping[str, float]:
        """Return the size of a fault along each key: the registry's, or the scenario's own."""
        own = self.data["faults"].get(effect)
        return effects()[effect].fault if own is None else own

    def line(self, effect: str) -> str:
        """Return the line of the study in which an effect is hidden."""
        return self.data["effects"][effect]["line"]

    def stage(self, name: str) -> Stage:
        """Return the robot with one of the pose sets."""
        section = self.data["poses"][name]
        rng = np.random.default_rng(section["seed"])
        if "plan" in section:
            by_id = {pose.pose: pose for pose in self.plan}
            poses = [by_id[number] for number in section["plan"]]
        else:
            poses = [_upright(self.robot, row) for row in section["upright"]]
        # It stands in the first pose, wherever the others come to be.
        order = [0, *(1 + rng.permutation(len(poses) - 1))]
        names = self.robot.tree.joint_names
        sides = rng.choice([-1, 1], (len(poses), len(names)))
        ready = tuple(
            replace(poses[k], pose=i + 1, approach=dict(zip(names, side, strict=True)))
            for i, (k, side) in enumerate(zip(order, sides.tolist(), strict=True))
        )
        white = np.sqrt(self.samples)
        options = {key: self.noise[key] * white for key in ("ft_force", "ft_moment", "current")}
        options |= {"imu": self.noise["imu"] * white, "encoder": self.noise["encoder"]}
        return Stage(self.robot, ready, options | self.data["climates"][section["climate"]])

    def single_effects(self) -> tuple[str, ...]:
        """Return the registered effects that are hidden in all poses of a recording."""
        return tuple(name for name in effects() if self.line(name) in (SINGLE, CONTACT))

    def pairs(self) -> tuple[Pair, ...]:
        """Return every one of them at every target."""
        return tuple(
            (name, target) for name in self.single_effects() for target in targets(self.robot, name)
        )

    def general(self, pair: Pair) -> frozenset[Pair]:
        """Return the pairs of which *pair* is a special case."""
        wider = self.data["special_cases"].get(pair[0], ())
        return frozenset((effect, pair[1]) for effect in wider)


def targets(robot: Robot, effect: str) -> tuple[str, ...]:
    """Return where an effect can sit in a robot, ``all`` among them."""
    spec = EFFECTS[effect]
    found = [
        name
        for kind in TargetKind
        if kind in spec.targets
        for name in (robot.tree.joint_names if kind is TargetKind.JOINT else names_of(robot, kind))
    ]
    if effect in FORCES:
        found = [name for name in found if name in _points(robot)]
    return tuple([*found, ALL] if spec.has_all else found)


def _points(robot: Robot) -> frozenset[str]:
    """Return the heaviest of all links that share their origin in any posture.

    A force at that point is a force on any of them, unless a sensor lies between.
    """
    tree, rng = robot.tree, np.random.default_rng(0)
    at = place_links(tree, rng.uniform(-1.0, 1.0, (3, len(tree.joint_names)))).p
    cuts = [tree.subtree(sensor.joint) for sensor in robot.sensors.values()]
    best: dict[tuple[object, ...], int] = {}
    for k, link in enumerate(tree.links):
        beyond = tuple(k in np.arange(len(tree.links))[cut] for cut in cuts)
        key = (*np.round(at[:, k].ravel(), 9).tolist(), *beyond)
        if key not in best or link.mass > tree.links[best[key]].mass:
            best[key] = k
    return frozenset(tree.links[k].name for k in best.values())


def _upright(robot: Robot, row: list[float]) -> PlannedPose:
    x, y, z, ahead, left, right = row
    upper = UpperBody(l_shoulder=left, r_shoulder=right)
    q = double_pose(Biped14Parameters(), x, y, z, ahead=ahead, upper=upper)
    return PlannedPose(0, np.array([q[name] for name in robot.tree.joint_names]), DOUBLE)


@cache
def scenario() -> Scenario:
    """Read the scenario file and generate its robot."""
    data = YAML(typ="safe").load(FILE)
    with tempfile.TemporaryDirectory() as scratch:
        path = generate(Path(scratch) / data["robot"])
        robot = load_robot(path)
        plan = read_plan(path.with_name("plan.csv"), robot.tree.joint_names)
    return Scenario(data, replace(robot, tolerances=tolerances(data["tolerances"])), plan)


def tolerances(families: Mapping[str, float]) -> Tolerances:
    """Return healthy spreads by family as robot.yaml states them."""
    other = {k: v for k, v in families.items() if k not in ("link_mass", "link_com", "link_length")}
    return Tolerances(
        link_mass=families["link_mass"],
        link_com=families["link_com"],
        link_length=families["link_length"],
        other=other,
    )
