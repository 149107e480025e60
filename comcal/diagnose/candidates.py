# SPDX-License-Identifier: Apache-2.0
"""Everything that could be the cause: each effect at each target, as columns of residuals."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from comcal.diagnose.linear import Linear
from comcal.effects.effect import Effect
from comcal.effects.registry import effects
from comcal.identify.unknowns import rigid_parts
from comcal.measure.columns import wrench_names
from comcal.measure.table import PoseTable
from comcal.robot.changes import ALL, Change, spec_of
from comcal.robot.changes_kinds import TargetKind
from comcal.robot.kinematics import place_links
from comcal.robot.model import Robot
from comcal.robot.tree import Array, JointType

NO_MASS = 1e-9
"""Carries a first moment where there is no mass [kg]."""
TURNING = (JointType.REVOLUTE, JointType.CONTINUOUS)
SAME_POINT = 1e-9
"""Distance of origins that are one [m]."""
STEP = 1e-4
"""Step of the derivatives, as a share of a fault."""


@dataclass(frozen=True)
class Candidate:
    """One effect at one target.

    Parameters
    ----------
    effect : Effect
    target : str
    keys : tuple of str
        Its parameters, in the order of the columns.
    poses : tuple of int or None
        Ids of the only poses in which it acts; None: all.
    log_prior : float
        Against that of a cause that acts in all poses.
    """

    effect: Effect
    target: str
    keys: tuple[str, ...]
    poses: tuple[int, ...] | None = None
    log_prior: float = 0.0

    @property
    def name(self) -> str:
        """``effect@target``, and the poses if there are only some."""
        name = f"{self.effect.name}@{self.target}" if self.target else self.effect.name
        return name if self.poses is None else f"{name} in pose {', '.join(map(str, self.poses))}"

    @property
    def fault(self) -> Array:
        """Size of a fault along each coordinate, shape (k,)."""
        return np.array([self.effect.fault[key] for key in self.keys], np.float64)

    def change(self, coordinates: Array) -> Change:
        """Return the change at *coordinates*: parameters, a stiffness by its inverse."""
        values = dict(zip(self.keys, map(float, coordinates), strict=True))
        if self.effect.moments:
            mass = values["mass"] = values["mass"] or NO_MASS
            values |= {key: values[key] / mass for key in self.effect.moments}
        if self.effect.inverse and not values[self.effect.inverse]:
            del values[self.effect.inverse]
        elif self.effect.inverse:
            values[self.effect.inverse] = 1.0 / values[self.effect.inverse]
        poses = {} if self.poses is None else {"poses": self.poses}
        return Change(self.effect.name, self.target, {**values, **poses})

    def columns(self, at: Linear) -> Array:
        """Return what each coordinate adds to the residuals, per unit, shape (n, k).

        Parameters
        ----------
        at : Linear
            The state that lacks the cause.
        """
        found = np.zeros((len(at.at.values), len(self.keys)))
        for k, size in enumerate(self.fault * STEP):
            step = np.zeros(len(self.keys))
            step[k] = size
            state = self.effect.correct(at.assumed, at.table, self.change(step))
            # Taking the cause back lowers the residuals by what it had added.
            found[:, k] = -at.moved(state) / size
        return found


def candidates(robot: Robot, table: PoseTable) -> tuple[Candidate, ...]:
    """Return every effect at every target that the readings could speak about.

    Parameters
    ----------
    robot : Robot
    table : PoseTable
    """
    return tuple(
        Candidate(effect, target, tuple(effect.fault))
        for effect in effects().values()
        if effect.fault
        for target in _targets(effect, robot, table)
    )


def _targets(effect: Effect, robot: Robot, table: PoseTable) -> Iterator[str]:
    spec = spec_of(effect.name)
    if TargetKind.NONE in spec.targets:
        yield ""
    if TargetKind.SENSOR in spec.targets:
        # Nothing is below the cut of a plate.
        known = robot.sensors if effect.name == "sole_mass" else wrench_names(robot)
        yield from (name for name in known if name in table.wrench)
    if TargetKind.LINK in spec.targets:
        links = _heaviest_of_each_body(robot)
        if effect.at_origin:
            links = _heaviest_at_each_point(robot, links)
        yield from (robot.tree.links[k].name for k in links)
    if TargetKind.JOINT in spec.targets:
        yield from robot.tree.joint_names
    if TargetKind.FOOT in spec.targets:
        yield from robot.feet
    if spec.has_all:
        yield ALL


def _heaviest_of_each_body(robot: Robot) -> list[int]:
    """Return one link of everything that fixed joints hold together: no reading sees the others."""
    best: dict[int, int] = {}
    for k, body in enumerate(rigid_parts(robot).tolist()):
        mass = robot.tree.links[k].mass
        if mass > 0.0 and (body not in best or mass > robot.tree.links[best[body]].mass):
            best[body] = k
    return sorted(best.values())


def _heaviest_at_each_point(robot: Robot, links: Sequence[int]) -> list[int]:
    """Return one of all links that turn about the same point: a force there is one on any of them.

    It has no moment about the axes between them. A sensor between them would feel it or not.
    """
    tree, body = robot.tree, rigid_parts(robot).tolist()
    cuts = {sensor.joint for sensor in robot.sensors.values()}
    at = place_links(tree, np.zeros((1, len(tree.joint_names)))).p[0]
    of_body = {part: part for part in body} | {body[k]: k for k in links}
    group = {part: part for part in body}
    for child, joint in enumerate(tree.joints, start=1):
        a, b = body[int(tree.parents[child])], body[child]
        if joint.kind not in TURNING or joint.name in cuts:
            continue
        away = at[[of_body[a], of_body[b]]] - at[child]
        if np.abs(away).max() < SAME_POINT:
            group[b] = group[a]
    best: dict[int, int] = {}
    for k in links:
        point = group[body[k]]
        if point not in best or tree.links[k].mass > tree.links[best[point]].mass:
            best[point] = k
    return sorted(best.values())
