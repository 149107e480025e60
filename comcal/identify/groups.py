# SPDX-License-Identifier: Apache-2.0
"""The poses of a session, sorted by what holds them and by which readings they have."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Flag, auto

import numpy as np
import numpy.typing as npt

from comcal.errors import NotFiniteError
from comcal.identify.torque_readings import TorqueReadings, torque_readings
from comcal.identify.unknowns import unknowns_of
from comcal.measure.plan import NONE
from comcal.measure.table import PoseTable
from comcal.robot.frames import rotation_from_rpy
from comcal.robot.model import Base, Robot
from comcal.robot.tree import Array
from comcal.statics.balance import Balance, balance_at
from comcal.statics.cut_rows import Cut, cuts_of
from comcal.statics.static_rows import RowLayout
from comcal.statics.support import (
    Carrier,
    hanging_carrier,
    loaded_wrenches,
    measured_supports,
)
from comcal.statics.torque_rows import motor_torque_factors, readable_joints


class Rows(Flag):
    """Which equations are used beside the balance of what the feet carry."""

    BALANCE = 0
    TORQUES = auto()
    """Joint torques, from ``tau.*`` or motor currents."""
    CUTS = auto()
    """Sensors that do not carry the robot: foot in the air, hips, arms."""
    IDLE_CUTS = auto()
    """Those of them below which nothing is unknown, such as the sole of the foot in the air."""


@dataclass(frozen=True)
class Group:
    """Poses of one kind of support with the same readings: inputs and their covariances.

    The inputs of a pose stand in the order of its ``layout``.

    Parameters
    ----------
    layout : RowLayout
    rows : tuple of int
        Row numbers in the pose table.
    where : tuple of str
        The same for messages.
    w : array, shape (N, n_sensors, 6)
        Loaded wrenches, ground on robot, in and about each sensor's frame [N, N m].
    q : array, shape (N, n_joints)
        [rad] or [m]
    cov : array, shape (N, n_inputs, n_inputs)
    below_mass : float
        Mass below the loaded cuts [kg]: part of the robot, not of what is carried.
    cut_wrenches : array, shape (N, n_cuts, 6)
        Below on above, in and about each sensor's frame [N, N m].
    torques : array, shape (N, n_torques)
        Of parent on child about (along) +axis [N m], [N].
    up : array, shape (N, 3), or None
        Upward vector of hanging poses, in the frame of ``up_link``.
    shared : mapping from name to array, shape (N or 1, n_inputs, k)
        What one standard deviation of an error that all poses share does to the inputs; errors of
        one name are the same in every group. Not contained in ``cov``.
    """

    layout: RowLayout
    rows: tuple[int, ...]
    where: tuple[str, ...]
    w: Array
    q: Array
    cov: Array
    below_mass: float
    cut_wrenches: Array
    torques: Array
    up: Array | None = None
    up_link: int = 0
    shared: Mapping[str, Array] = field(default_factory=dict[str, Array])

    @property
    def carrier(self) -> Carrier:
        """What holds the robot."""
        return self.layout.carrier

    @property
    def inputs(self) -> Array:
        """What was measured, shape (N, n_inputs)."""
        n = len(self.q)
        cuts = self.cut_wrenches.reshape(n, 6 * len(self.layout.cuts))
        loads = self.w.reshape(n, 6 * len(self.carrier.sensors))
        parts = [loads, self.q, cuts, self.torques]
        return np.concatenate(parts if self.up is None else [*parts, self.up], axis=1)

    def balance_at(self, robot: Robot, inputs: Array) -> Balance:
        """Place the robot at *inputs*, shape (N, n_inputs)."""
        w, q = self.split(inputs)
        up = None if self.up is None else inputs[:, self.layout.up_columns]
        return balance_at(robot, self.carrier, q, w, up, self.up_link)

    def split(self, inputs: Array) -> tuple[Array, Array]:
        """Return loaded wrenches and angles of an input array of this group's layout."""
        at, n = self.layout.q_columns, len(self.carrier.sensors)
        return inputs[:, : at.start].reshape(len(inputs), n, 6), inputs[:, at]

    def others(self, inputs: Array) -> tuple[Array, Array]:
        """Return wrenches at the cuts and torques of an input array of this group's layout."""
        wrenches = inputs[:, self.layout.cut_columns]
        wrenches = wrenches.reshape(len(inputs), len(self.layout.cuts), 6)
        return wrenches, inputs[:, self.layout.torque_columns]

    def select(self, keep: npt.ArrayLike) -> Group:
        """Return the group of some of its poses; *keep* has one truth value per pose."""
        mask = np.asarray(keep, dtype=np.bool_)
        chosen = np.flatnonzero(mask)
        return replace(
            self,
            rows=tuple(self.rows[i] for i in chosen),
            where=tuple(self.where[i] for i in chosen),
            w=self.w[mask],
            q=self.q[mask],
            cov=self.cov[mask],
            cut_wrenches=self.cut_wrenches[mask],
            torques=self.torques[mask],
            up=None if self.up is None else self.up[mask],
            shared={k: v if len(v) == 1 else v[mask] for k, v in self.shared.items()},
        )


def groups_of(robot: Robot, table: PoseTable, rows: Rows = Rows.BALANCE) -> tuple[Group, ...]:
    """Split a table by support, and by which of the readings asked for are there.

    Hanging poses carry no whole-robot rows: they are left out unless torques or cuts are asked for
    and some are there. Poses without a wrench whose CoM is given instead are left out.

    Raises
    ------
    ConfigError, MissingColumnError, NotFiniteError, DataError
        If the wrench or the error of a loaded sensor is not known, or no direction of gravity of a
        hanging pose.
    """
    torques = torque_readings(robot, table) if Rows.TORQUES in rows else None
    groups: list[Group] = []
    for carrier, index in _held(robot, table, hanging=rows is not Rows.BALANCE):
        groups.extend(_groups_of_support(robot, table, rows, torques, carrier, index))
    return tuple(groups)


def _held(
    robot: Robot, table: PoseTable, *, hanging: bool
) -> Iterator[tuple[Carrier, npt.NDArray[np.intp]]]:
    yield from measured_supports(robot, table)
    hung = np.flatnonzero([support == NONE for support in table.support])
    if hanging and hung.size:
        yield hanging_carrier(robot), hung


def _groups_of_support(
    robot: Robot,
    table: PoseTable,
    rows: Rows,
    torques: TorqueReadings | None,
    carrier: Carrier,
    index: npt.NDArray[np.intp],
) -> Iterator[Group]:
    """Yield a group for every pattern of readings that are there, in the order of their poses."""
    cuts = tuple(
        cut
        for cut in cuts_of(robot, carrier)
        if cut.sensor in table.wrench and (Rows.CUTS in rows or _is_idle(robot, cut, rows))
    )
    there = np.zeros((len(index), 0), np.bool_)
    if torques is not None:
        there = torques.known[index] & readable_joints(robot, carrier)
    has_cut = np.array([_whole(table, cut.sensor)[index] for cut in cuts], np.bool_)
    pattern = np.concatenate([there, has_cut.reshape(len(cuts), len(index)).T], axis=1)
    n_joints = table.q.shape[1]
    _, first, member = np.unique(pattern, axis=0, return_index=True, return_inverse=True)
    for k in np.argsort(first):
        chosen = pattern[first[k]]
        joints = np.flatnonzero(chosen[: there.shape[1]])
        has = chosen[there.shape[1] :]
        used = tuple(cut for cut, is_there in zip(cuts, has, strict=True) if is_there)
        layout = RowLayout(carrier, used, tuple(int(j) for j in joints), n_joints)
        if layout.n_rows:
            yield _group(robot, table, torques, layout, index[member.ravel() == k])


def _is_idle(robot: Robot, cut: Cut, rows: Rows) -> bool:
    return Rows.IDLE_CUTS in rows and not cut.below[list(unknowns_of(robot).links)].any()


def _whole(table: PoseTable, sensor: str) -> npt.NDArray[np.bool_]:
    """Return in which poses a sensor has all channels, each with an error, shape (N,)."""
    variance = np.einsum("nii->ni", table.wrench_cov[sensor])
    return np.asarray(
        np.isfinite(table.wrench[sensor]).all(axis=1) & (variance > 0.0).all(axis=1), np.bool_
    )


def _group(
    robot: Robot,
    table: PoseTable,
    torques: TorqueReadings | None,
    layout: RowLayout,
    index: npt.NDArray[np.intp],
) -> Group:
    n, part = len(index), table.select(index)
    carrier = layout.carrier
    cov = np.zeros((n, layout.n_inputs, layout.n_inputs))
    w = np.zeros((n, 0, 6))
    if carrier.sensors:
        w, w_cov = loaded_wrenches(carrier, part)
        for s in range(w.shape[1]):
            at = slice(6 * s, 6 * s + 6)
            cov[:, at, at] = w_cov[:, s]
    _fill_diagonal(cov, layout.q_columns, part.q_cov)
    for cut in layout.cuts:
        at = layout.sensor_columns(cut.sensor)
        cov[:, at, at] = part.wrench_cov[cut.sensor]
    wrenches = [part.wrench[cut.sensor] for cut in layout.cuts]
    shared = _tares(table, layout)
    joints = np.array(layout.torques, dtype=np.intp)
    values = np.zeros((n, joints.size))
    if torques is not None and joints.size:
        values = torques.value[np.ix_(index, joints)]
        _fill_diagonal(cov, layout.torque_columns, torques.variance[np.ix_(index, joints)])
        shared |= torques.shared(index, layout)
    up, up_link, up_var = None, 0, np.zeros((n, 0))
    if layout.hangs:
        up, up_link, up_var = _upward(robot, part)
    shared |= _shared_roots(robot, part, layout)
    _fill_diagonal(cov, layout.up_columns, up_var)
    return Group(
        layout=layout,
        rows=tuple(int(i) for i in index),
        where=tuple(table.where(int(i)) for i in index),
        w=w,
        q=part.q,
        cov=cov,
        below_mass=float(robot.tree.masses[~carrier.carried].sum()),
        cut_wrenches=np.stack(wrenches, axis=1) if wrenches else np.zeros((n, 0, 6)),
        torques=values,
        up=up,
        up_link=up_link,
        shared=shared,
    )


def _fill_diagonal(cov: Array, at: slice, variance: Array) -> None:
    columns = np.arange(at.start, at.stop)
    cov[:, columns, columns] = variance


def _tares(table: PoseTable, layout: RowLayout) -> dict[str, Array]:
    """Return what a standard deviation of each tare does: one error for all poses of a sensor."""
    roots: dict[str, Array] = {}
    sensors: Sequence[str] = (*layout.carrier.sensors, *(cut.sensor for cut in layout.cuts))
    for sensor in sensors:
        cov = table.tare_cov.get(sensor, np.zeros((6, 6)))
        if cov.any():
            value, vector = np.linalg.eigh(cov)
            root = np.zeros((1, layout.n_inputs, 6))
            root[0, layout.sensor_columns(sensor)] = vector * np.sqrt(np.clip(value, 0.0, None))
            roots[f"tare {sensor}"] = root
    return roots


def _shared_roots(robot: Robot, table: PoseTable, layout: RowLayout) -> dict[str, Array]:
    """Return what a standard deviation of each error in ``table.shared`` does to the inputs."""
    roots: dict[str, Array] = {}
    from_current = ~np.isfinite(table.torque)
    factor = np.nan_to_num(motor_torque_factors(robot))
    by_imu = robot.imu_link is not None and bool(np.isfinite(table.imu).all())
    for name, shift in table.shared.items():
        root = np.zeros((len(table), layout.n_inputs))
        for sensor in (*layout.carrier.sensors, *(cut.sensor for cut in layout.cuts)):
            root[:, layout.sensor_columns(sensor)] = shift.wrench[sensor]
        root[:, layout.q_columns] = shift.q
        torque = np.where(from_current, shift.current * factor, shift.torque)
        root[:, layout.torque_columns] = torque[:, list(layout.torques)]
        if layout.hangs and by_imu:
            root[:, layout.up_columns] = shift.imu
        roots[name] = root[:, :, None]
    return roots


def _upward(robot: Robot, table: PoseTable) -> tuple[Array, int, Array]:
    """Return what says where up is in hanging poses, its link, and its variances.

    The IMU where it is; else the tilt of the base; a base that is fixed stands upright.
    """
    tilt = table.base_tilt
    if robot.imu_link is not None and np.isfinite(table.imu).all():
        return table.imu, robot.tree.link_index[robot.imu_link], table.imu_var
    if robot.base is Base.FIXED:
        tilt = np.nan_to_num(tilt)
    if not np.isfinite(tilt).all():
        i = int(np.argmax(~np.isfinite(tilt).all(axis=1)))
        raise NotFiniteError(
            "nothing says where up is in a pose in which the robot is held",
            where=table.where(i),
            next_step="give imu.ax .ay .az, or base.roll and base.pitch",
        )
    R = np.stack([rotation_from_rpy([roll, pitch, 0.0]) for roll, pitch in tilt])
    spread = np.full((len(tilt), 3), float(robot.noise.encoder) ** 2)
    return R[:, 2, :], 0, spread
