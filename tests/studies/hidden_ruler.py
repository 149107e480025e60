# SPDX-License-Identifier: Apache-2.0
"""How large an effect is against noise and healthy spread, and how far from its strongest rival.

Size s: whitened norm of the rows with the effect minus those without, in exact readings of a
simulated robot: of the engine that also makes the data, or of plain statics where both agree.
Separation d: the norm that the strongest rival leaves of it in its best fit, with no parameter
beyond a few faults. Effects that contain the hidden one as a special case are no rivals; a force on
a link in one pose is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from hidden_columns import (
    BUILTIN,
    MUJOCO,
    Pair,
    cached_columns,
    keys_of,
    nominal,
    rows_of,
)
from hidden_scenario import Stage, scenario
from hidden_world import record, table_of

from comcal.measure.table import PoseTable
from comcal.robot.changes import ALL, Change

CONTACT = "external_contact"
Touch = tuple[str, str, int]
"""Effect, link and pose."""
FORCES = ("fx", "fy", "fz")
ANGLES = ("roll", "pitch", "yaw")


def spread(pair: Pair, key: str) -> float:
    """Return one healthy sigma of a parameter, zero where robots are healthy only without it."""
    effect, target = pair
    families, robot = scenario().data["tolerances"], scenario().robot
    if effect == "ft_bias":
        return families["ft_bias_force" if key in FORCES else "ft_bias_moment"]
    if effect == "foot_placement":
        return families["foot_placement_angle" if key in ANGLES else "foot_placement"]
    if key == "load_factor":
        return 0.0
    if effect == "link_mass":
        return families[effect] * robot.tree.links[robot.tree.link_index[target]].mass
    return families.get(effect, 0.0)


def noise_covariance(stage: Stage, table: PoseTable) -> np.ndarray:
    """Return the covariance of rows from the stated noise of readings, shape (n, n).

    One reading of all poses is moved at a time; readings of different poses are independent.
    """
    sizes, at = scenario().noise, rows_of(stage, table)
    moved = list[np.ndarray]()

    def by(size: float, **changed: object) -> None:
        ahead = rows_of(stage, replace(table, **changed))  # pyright: ignore[reportArgumentType]
        moved.append(np.nan_to_num(ahead.values - at.values))

    for k in range(table.q.shape[1]):
        unit = np.eye(table.q.shape[1])[k]
        by(1.0, q=table.q + sizes["encoder"] * unit)
        by(1.0, current=table.current + sizes["current"] * unit)
    for k in range(3):
        by(1.0, imu=table.imu + sizes["imu"] * np.eye(3)[k])
    for sensor, wrench in table.wrench.items():
        for k in range(6):
            size = sizes["ft_force" if k < 3 else "ft_moment"]
            by(1.0, wrench={**table.wrench, sensor: wrench + size * np.eye(6)[k]})
    M = np.array(moved)
    same = at.pose[:, None] == at.pose[None]
    return np.where(same, M.T @ M, 0.0)


@dataclass(frozen=True)
class Size:
    """How large an effect is.

    Parameters
    ----------
    s, d : float
    rival : Pair
        The strongest one.
    """

    s: float
    d: float
    rival: Pair


class Ruler:
    """Sizes in one pose set.

    Parameters
    ----------
    name : str
        Of the pose set.
    engine : str
        In which the robot stands.
    """

    def __init__(self, name: str, engine: str = BUILTIN) -> None:
        self.stage = scenario().stage(name)
        self.engine = engine
        self.rows, self._columns = cached_columns(name, engine)
        self._tables: dict[str, PoseTable] = {BUILTIN: nominal(self.stage)}
        cov = noise_covariance(self.stage, self._tables[BUILTIN])
        for pair, columns in self._columns.items():
            if pair[1] != ALL:
                sigma = np.array([spread(pair, key) for key in keys_of(pair)])
                root = np.nan_to_num(columns[:, sigma > 0.0]) * sigma[sigma > 0.0]
                cov = cov + root @ root.T
        self._cov = cov
        poses = tuple(pose.pose for pose in self.stage.poses)
        self._of_poses = cache(self._whitener)
        self._all = poses
        self._faults = dict[Pair, np.ndarray]()
        self._touches = dict[tuple[int, ...], dict[Touch, np.ndarray]]()

    def faults(self, pair: Pair, poses: tuple[int, ...] | None = None) -> np.ndarray:
        """Return the whitened columns of an effect, per fault, shape (m, k)."""
        if poses is not None and tuple(poses) != self._all:
            return self._faults_in(pair, tuple(poses))
        if pair not in self._faults:
            self._faults[pair] = self._faults_in(pair, self._all)
        return self._faults[pair]

    def touches(self, poses: tuple[int, ...] | None = None) -> Mapping[Touch, np.ndarray]:
        """Return the whitened columns, per fault, of forces at links in single poses, (m, 3)."""
        wanted = self._all if poses is None else tuple(poses)
        if wanted not in self._touches:
            found = dict[Touch, np.ndarray]()
            size = np.array(list(scenario().fault(CONTACT).values()))
            for link in scenario().robot.tree.links:
                pair = (CONTACT, link.name)
                if pair not in self._columns:
                    continue
                for pose in wanted:
                    here = np.array(self._all)[self.rows.pose] == pose
                    found[(*pair, pose)] = self._whitened(
                        np.where(here[:, None], self._columns[pair] * size, 0.0), wanted
                    )
            self._touches[wanted] = found
        return self._touches[wanted]

    def _faults_in(self, pair: Pair, poses: tuple[int, ...]) -> np.ndarray:
        fault = np.array(list(scenario().fault(pair[0]).values()))
        return self._whitened(self._columns[pair] * fault, poses)

    def reach(self, pair: Pair) -> float:
        """Return the size of an effect with all parameters at the size of a fault.

        Root mean square over all combinations of their signs.
        """
        return float(np.linalg.norm(self.faults(pair)))

    def blind(self, least: float) -> tuple[Pair, ...]:
        """Return the pairs that do not reach a size at their fault size."""
        return tuple(pair for pair in self.pairs if self.reach(pair) < least)

    @property
    def pairs(self) -> tuple[Pair, ...]:
        """All effects at all targets that these poses could be asked for."""
        return scenario().pairs()

    def difference(
        self, changes: Sequence[Change], engine: str = BUILTIN
    ) -> tuple[np.ndarray, tuple[int, ...]]:
        """Return whitened rows with changes minus without, and the poses that were stood in."""
        if engine not in self._tables:
            self._tables[engine] = nominal(self.stage, engine)
        without = self._tables[engine]
        table = table_of(self.stage, record(self.stage, changes, engine=engine, noise=False))
        stood = np.isin(without.pose, table.pose)
        before = rows_of(self.stage, without.select(stood))
        moved = rows_of(self.stage, table).values - before.values
        return self.whitened_of(moved, table.pose), table.pose

    def size(self, pair: Pair, changes: Sequence[Change], engine: str = BUILTIN) -> Size:
        """Return how large the changes of one effect are, and how far from its rivals."""
        x, poses = self.difference(changes, engine)
        d, rival = self.left(pair, x, poses)
        return Size(float(np.linalg.norm(x)), d, rival)

    def left(
        self,
        pair: Pair,
        x: np.ndarray,
        poses: tuple[int, ...] | None = None,
        beside: Sequence[Pair] = (),
    ) -> tuple[float, Pair]:
        """Return the norm that the strongest rival leaves of *x*, and which one that is.

        Parameters
        ----------
        pair : Pair
            The effect itself.
        x : array, shape (m,)
            What it does to the whitened rows.
        poses : tuple of int, optional
        beside : sequence of Pair
            Further effects that may take part in every fit.
        """
        general = scenario().general(pair)
        free = [self.faults(other, poses) for other in beside]
        best, strongest = np.inf, pair
        own = (
            (other, self.faults(other, poses))
            for other in self.pairs
            if other != pair and other not in general and other not in beside
        )
        touches = ((touch[:2], column) for touch, column in self.touches(poses).items())
        for other, column in (*own, *touches):
            A = scenario().data["rival"] * np.hstack([column, *free])
            # Least |x - A c|^2 + |c|^2: parameters beyond the size allowed cost as much as misfit.
            c = np.linalg.solve(A.T @ A + np.eye(A.shape[1]), A.T @ x)
            rest = float(np.sqrt(max(x @ x - x @ A @ c, 0.0)))
            if rest < best:
                best, strongest = rest, other
        return best, strongest

    def whitened_of(self, values: np.ndarray, poses: tuple[int, ...]) -> np.ndarray:
        """Whiten rows of some of the poses, in the order of their table, shape (n,) to (m,)."""
        at = np.full(len(self.rows.values), np.nan)
        at[np.isin(np.array(self._all)[self.rows.pose], poses)] = values
        return self._whitened(at[:, None], poses)[:, 0]

    def _whitener(self, poses: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
        used = np.isfinite(self.rows.values) & (np.diag(self._cov) > 0.0)
        used &= np.isin(np.array(self._all)[self.rows.pose], poses)
        part = self._cov[np.ix_(used, used)]
        scale = np.sqrt(np.diag(part))
        correlation = part / np.outer(scale, scale) + 1e-10 * np.eye(len(scale))
        return used, np.linalg.inv(scale[:, None] * np.linalg.cholesky(correlation))

    def _whitened(self, values: np.ndarray, poses: tuple[int, ...]) -> np.ndarray:
        used, W = self._of_poses(tuple(poses))
        return W @ np.nan_to_num(values[used])


@cache
def _ruler(name: str, engine: str) -> Ruler:
    return Ruler(name, engine)


def ruler(name: str, engine: str = BUILTIN) -> Ruler:
    """Return the ruler of a pose set in an engine."""
    return _ruler(name, engine if engine == MUJOCO else BUILTIN)
