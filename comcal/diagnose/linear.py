# SPDX-License-Identifier: Apache-2.0
"""Parity residuals, and how they follow everything that an effect can change.

Most effects change readings, masses, first moments, origins of joints or loads: their columns are
sums of elementary ones, each found once. Whatever else an effect changes is differenced directly.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np

from comcal.diagnose.link_loads import LinkLoads, link_loads
from comcal.diagnose.readings import by_copy, reading_slopes, stacked
from comcal.effects.effect import State
from comcal.measure.table import PoseTable
from comcal.predict.anchors import link_places
from comcal.predict.assumed import Assumed, Load
from comcal.predict.parity import Parity, parity
from comcal.robot.kinematics import place_links
from comcal.robot.model import Robot
from comcal.robot.tree import Array

READINGS = {"q", "current", "torque", "imu", "wrench"}
LENGTH_STEP, ANGLE_STEP = 1e-6, 1e-6


@dataclass(frozen=True)
class Linear:
    """Residuals about a state, and their elementary derivatives, found when first asked for.

    Parameters
    ----------
    assumed : Assumed
    table : PoseTable
    """

    assumed: Assumed
    table: PoseTable

    @cached_property
    def _known(self) -> dict[tuple[str, int], Array]:
        return {}

    @cached_property
    def at(self) -> Parity:
        """Residuals of the state itself."""
        return parity(self.assumed, self.table)

    @cached_property
    def slopes(self) -> Array:
        """With respect to the readings of a pose, shape (n, size)."""
        return reading_slopes(self.assumed, self.table, self.at)

    @cached_property
    def readings(self) -> Array:
        """Readings of the state, shape (N, size)."""
        return stacked(self.table)

    @cached_property
    def places(self) -> Array:
        """Origins of all links in P, shape (N, n_links, 3) [m]; NaN of a hanging robot."""
        return link_places(self.assumed, self.table)

    @cached_property
    def links(self) -> LinkLoads:
        """With respect to masses of, and wrenches on, all links."""
        return link_loads(self.assumed, self.table, self.at)

    @cached_property
    def _by_origin(self) -> Array:
        """With respect to the origin of each joint in its parent link, (n_joints, n, 3).

        All that lies beyond a joint moves with its origin and turns with nothing: poses in which
        one joint has moved along one axis stand one after the other in one table.
        """
        tree, n, joints = (
            self.assumed.robot.tree,
            len(self.table),
            len(self.assumed.robot.tree.joints),
        )
        R = place_links(tree, self.table.q).R
        away = np.zeros((joints, 3, n, len(tree.links), 3))
        for k, joint in enumerate(tree.joints):
            axes = np.moveaxis(R[:, tree.link_index[joint.parent]], 2, 0)
            away[k][:, :, tree.subtree(joint.name)] = LENGTH_STEP * axes[:, :, None]
        copies = 3 * joints
        ahead = parity(
            self.assumed,
            self.table.select(np.tile(np.arange(n), copies)),
            away.reshape(copies * n, len(tree.links), 3),
        )
        moved = by_copy(ahead, n, copies) - self.at.values
        return np.nan_to_num(moved / LENGTH_STEP).reshape(joints, 3, -1).swapaxes(1, 2)

    def sloped(self, axis: int) -> Array:
        """Return how residuals move per radian of the floor's roll or pitch, shape (n,)."""
        return self._elementary("floor", axis)

    def moved(self, state: State) -> Array:
        """Return by how much the residuals move to first order when the state does, shape (n,).

        Parameters
        ----------
        state : State
            A little away from this one.
        """
        assumed, table = state
        found = np.zeros(len(self.at.values))
        if table is not self.table:
            if not _differs(self.table, table) <= READINGS:
                return self._directly(state)
            shift = np.nan_to_num(stacked(table) - self.readings)
            found += np.einsum("nr,nr->n", self.slopes, shift[self.at.pose])
        if assumed is not self.assumed:
            rest = self._by_parts(assumed)
            found += self._directly((assumed, self.table)) if rest is None else rest
        return found

    def _directly(self, state: State) -> Array:
        return np.nan_to_num(parity(*state).values - self.at.values)

    def _by_parts(self, assumed: Assumed) -> Array | None:
        """Return the move of what is assumed from elementary columns; None: it has others."""
        changed = _differs(self.assumed, assumed)
        found = np.zeros(len(self.at.values))
        if "robot" in changed:
            part = self._of_robot(assumed.robot)
            if part is None:
                return None
            found += part
        if "loads" in changed:
            part = self._of_loads(assumed.loads)
            if part is None:
                return None
            found += part
        for name in ("floor", "imu_tilt"):
            if name in changed:
                delta = getattr(assumed, name) - getattr(self.assumed, name)
                found += sum(self._elementary(name, k) * delta[k] for k in range(2))
        return found if changed <= {"robot", "loads", "floor", "imu_tilt"} else None

    def _of_robot(self, robot: Robot) -> Array | None:
        old = self.assumed.robot
        if _differs(old, robot) != {"tree"} or not _differs(old.tree, robot.tree) <= {
            "links",
            "joints",
        }:
            return None
        found = np.zeros(len(self.at.values))
        for k, (a, b) in enumerate(zip(old.tree.links, robot.tree.links, strict=True)):
            if a is b:
                continue
            delta = np.array([b.mass - a.mass, *(b.mass * b.com - a.mass * a.com)])
            found += self.links.by_weight[:, k] @ delta
        for k, (a, b) in enumerate(zip(old.tree.joints, robot.tree.joints, strict=True)):
            if a is b:
                continue
            turn = b.T_parent_joint[:3, :3] - a.T_parent_joint[:3, :3]
            if _differs(a, b) != {"T_parent_joint"} or turn.any():
                return None
            shift = b.T_parent_joint[:3, 3] - a.T_parent_joint[:3, 3]
            found += self._by_origin[k] @ shift
        return found

    def _of_loads(self, loads: tuple[Load, ...]) -> Array | None:
        n = len(self.assumed.loads)
        if loads[:n] != self.assumed.loads or any(load.point.any() for load in loads[n:]):
            return None
        found = np.zeros(len(self.at.values))
        for load in loads[n:]:
            force = self._force(load)[self.at.pose]
            found += np.sum(self.links.by_force[:, load.link] * force, axis=1)
        return found

    def _force(self, load: Load) -> Array:
        """Return a load in axes of P, shape (N, 3) [N]."""
        away = np.nan_to_num(self.places[:, load.link] - load.anchor)
        force = load.force - away @ load.stiffness.T
        if load.poses is None:
            return force * ~np.isnan(self.places[:, :1, 0])
        return force * np.array([[float(pose in load.poses)] for pose in self.table.pose])

    def _elementary(self, kind: str, k: int) -> Array:
        """Return one elementary column, shape (n,)."""
        if (kind, k) not in self._known:
            step, make = _MOVES[kind]
            ahead = parity(make(self.assumed, k, step), self.table).values
            self._known[kind, k] = np.nan_to_num((ahead - self.at.values) / step)
        return self._known[kind, k]


def _differs(a: object, b: object) -> set[str]:
    """Return the fields of a dataclass that are not the same object in both."""
    return {f.name for f in fields(a) if getattr(a, f.name) is not getattr(b, f.name)}  # type: ignore[arg-type]


def _sloped(assumed: Assumed, k: int, step: float) -> Assumed:
    return replace(assumed, floor=assumed.floor + step * np.eye(2)[k])


def _turned(assumed: Assumed, k: int, step: float) -> Assumed:
    return replace(assumed, imu_tilt=assumed.imu_tilt + step * np.eye(2)[k])


_MOVES: dict[str, tuple[float, Callable[[Assumed, int, float], Assumed]]] = {
    "floor": (ANGLE_STEP, _sloped),
    "imu_tilt": (ANGLE_STEP, _turned),
}
