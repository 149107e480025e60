# SPDX-License-Identifier: Apache-2.0
"""Parity residuals: balances that readings must satisfy, however two feet share the load.

Per pose, in this order: equilibrium of what the feet carry (force and moment about P, axes of P);
six rows for every other force sensor; one for every joint torque that statics explains, given the
measured load of the feet; closure of two standing feet (roll, pitch, height of one sole against the
other); tilt of the IMU. The split between two feet never enters: it is not determined by statics.

The direction of gravity comes from the floor and the standing feet through the joint angles, not
from the forces: a sloping floor, a turned sensor and a wrong angle then look different.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from comcal.measure.plan import NONE
from comcal.measure.table import PoseTable
from comcal.predict.assumed import Assumed, Load
from comcal.predict.inertial import inertial_wrenches
from comcal.predict.standing import Standing, standing_at, world_axes
from comcal.robot.frames import apply, cross, rotation_from_rpy
from comcal.robot.kinematics import Placements, place_links
from comcal.robot.tree import Array
from comcal.statics.balance import Balance, balance_at, first_moments
from comcal.statics.cut_rows import cut_residual, cuts_of
from comcal.statics.moves import moves_of
from comcal.statics.support import Carrier, carrier_of, hanging_carrier
from comcal.statics.torque_rows import joint_torques, motor_torque_factors, readable_joints

EQUILIBRIUM = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")


@dataclass(frozen=True)
class Row:
    """What one residual is about.

    Parameters
    ----------
    kind : str
        ``equilibrium``, ``sensor``, ``torque``, ``closure`` or ``imu``.
    of : str
        Sensor or joint; empty for the others.
    axis : str
    unit : str
    """

    kind: str
    of: str
    axis: str
    unit: str

    @property
    def name(self) -> str:
        """Such as ``equilibrium My`` or ``torque l_knee``."""
        return " ".join(part for part in (self.kind, self.of, self.axis) if part)


@dataclass(frozen=True)
class Parity:
    """Residuals of every pose of a table, one after the other.

    Parameters
    ----------
    values : array, shape (n,)
        NaN where a reading is missing.
    pose : array of int, shape (n,)
        Row of the table.
    row : tuple of Row, length n
    """

    values: Array
    pose: npt.NDArray[np.intp]
    row: tuple[Row, ...]


def parity(assumed: Assumed, table: PoseTable, displaced: Array | None = None) -> Parity:
    """Return the parity residuals of all poses of *table*.

    Parameters
    ----------
    assumed : Assumed
    table : PoseTable
    displaced : array, shape (N, n_links, 3), optional
        How far the origins of links lie from where the tree has them, axes of the root [m].

    Returns
    -------
    Parity
        In the order of supports, poses, rows: the same for every table with the same supports.

    Raises
    ------
    ConfigError
        If a support names no foot of the robot, or a standing foot has neither sensor nor plate.
    """
    values: list[Array] = []
    poses: list[npt.NDArray[np.intp]] = []
    rows: list[Row] = []
    for support in sorted(set(table.support)):
        index = np.flatnonzero([s == support for s in table.support])
        labels: list[Row] = []
        columns: list[Array] = []
        away = None if displaced is None else displaced[index]
        for label, column in _residuals(assumed, table.select(index), support, away):
            labels += label
            columns.append(column)
        if columns:
            block = np.concatenate(columns, axis=1)
            values.append(block.ravel())
            poses.append(np.repeat(index, block.shape[1]))
            rows += labels * len(index)
    if not values:
        return Parity(np.zeros(0), np.zeros(0, np.intp), ())
    return Parity(np.concatenate(values), np.concatenate(poses), tuple(rows))


def _residuals(
    assumed: Assumed, table: PoseTable, support: str, displaced: Array | None
) -> Iterator[tuple[list[Row], Array]]:
    """Yield blocks of labels and residuals, shape (N, k), of poses in one support."""
    robot = assumed.robot
    balance, carrier, standing = placed(assumed, table, support, displaced)
    h = robot.tree.masses[:, None] * robot.tree.coms
    if standing is not None:
        labels = [Row("equilibrium", "", a, "N" if a[0] == "F" else "N m") for a in EQUILIBRIUM]
        yield labels, _equilibrium(assumed, balance, standing, h, table)
    for cut in cuts_of(robot, carrier):
        if cut.sensor in table.wrench:
            cut = replace(cut, feet=(*cut.feet, *_loads_below(balance.carrier, cut.below)))
            left = cut_residual(balance, cut, table.wrench[cut.sensor], h)
            X = balance.placements.R[:, cut.link], balance.placements.p[:, cut.link]
            labels = [
                Row("sensor", cut.sensor, a, "N" if a[0] == "F" else "N m") for a in EQUILIBRIUM
            ]
            yield labels, _about(left, *X)
    names = robot.tree.joint_names
    joints = np.flatnonzero(readable_joints(robot, carrier))
    measured = _torques(assumed, table)
    if joints.size and np.isfinite(measured[:, joints]).any():
        expected = joint_torques(balance, moves_of(balance), h)
        labels = [Row("torque", names[j], "", "N m") for j in joints]
        yield labels, (measured - expected)[:, joints]
    if standing is not None and standing.closure is not None:
        labels = [
            Row("closure", "", "roll", "rad"),
            Row("closure", "", "pitch", "rad"),
            Row("closure", "", "height", "m"),
        ]
        yield labels, standing.closure
    if standing is not None and robot.imu_link is not None and np.isfinite(table.imu).any():
        labels = [Row("imu", "", "roll", "rad"), Row("imu", "", "pitch", "rad")]
        yield labels, _imu(assumed, table, balance, standing)


def placed(
    assumed: Assumed, table: PoseTable, support: str, displaced: Array | None = None
) -> tuple[Balance, Carrier, Standing | None]:
    """Place poses of one support, with loads from outside among those of the feet.

    *displaced* as in :func:`parity`.

    Returns
    -------
    balance : Balance
        Gravity points where floor and feet, or the IMU of a hanging robot, say.
    carrier : Carrier
        What holds the robot, without the loads from outside.
    standing : Standing or None
        None for a hanging robot.
    """
    robot = assumed.robot
    hangs = support == NONE
    carrier = hanging_carrier(robot) if hangs else carrier_of(robot, support)
    at = place_links(robot.tree, table.q)
    if displaced is not None:
        at = replace(at, p=at.p + displaced)
    standing = None if hangs else standing_at(assumed, table, carrier, at)
    up = _up(assumed, table, at, standing)
    return _balance(assumed, table, carrier, at, standing, up), carrier, standing


def _up(assumed: Assumed, table: PoseTable, at: Placements, standing: Standing | None) -> Array:
    """Return an upward vector of every pose in the root frame, shape (N, 3)."""
    if standing is not None:
        roll, pitch = assumed.floor
        up_in_P = rotation_from_rpy([roll, pitch, 0.0])[2]
        return apply(standing.R_root_P, np.broadcast_to(up_in_P, (len(table), 3)))
    robot = assumed.robot
    tilt = np.nan_to_num(table.base_tilt)
    up = rotation_from_rpy(np.column_stack([tilt, np.zeros(len(tilt))]))[:, 2]
    if robot.imu_link is None:
        return up
    seen = np.isfinite(table.imu).all(axis=1, keepdims=True)
    by_imu = apply(at.link(robot.imu_link)[0] @ _imu_rotation(assumed), table.imu)
    if not seen.any():
        return up
    # Where others have the IMU's word, a pose without it is not simply upright.
    known = np.isfinite(table.base_tilt).all(axis=1, keepdims=True)
    return np.where(seen, by_imu, np.where(known, up, np.nan))


def _imu_rotation(assumed: Assumed) -> Array:
    """Return R_link_imu."""
    roll, pitch = assumed.imu_tilt
    return rotation_from_rpy([roll, pitch, 0.0])


def _balance(
    assumed: Assumed,
    table: PoseTable,
    carrier: Carrier,
    at: Placements,
    standing: Standing | None,
    up: Array,
) -> Balance:
    """Place the robot; outside loads join the loads of the feet, as wrenches on their links."""
    nan = np.full((len(table), 6), np.nan)
    w = [table.wrench.get(sensor, nan) for sensor in carrier.sensors]
    sensors, frames = list(carrier.sensors), list(carrier.frames)
    for i, load in enumerate(assumed.loads):
        sensors.append(f"load {i}")
        frames.append(load.link)
        # What acts below the cut of a foot that stands goes into the ground: no sensor feels it.
        felt = float(carrier.carried[load.link])
        w.append(felt * _load_wrench(load, table, at, standing, up))
    for link, wrench in _inertial(assumed, table, carrier):
        sensors.append(f"load of inertia {link}")
        frames.append(link)
        w.append(wrench)
    loads = np.stack(w, axis=1) if w else np.zeros((len(table), 0, 6))
    with_loads = replace(carrier, sensors=tuple(sensors), frames=tuple(frames))
    return balance_at(assumed.robot, with_loads, table.q, loads, up, placements=at)


def _inertial(assumed: Assumed, table: PoseTable, carrier: Carrier) -> Iterator[tuple[int, Array]]:
    """Yield the carried links that move, with minus what their inertia demands, shape (N, 6)."""
    robot = assumed.robot
    if not assumed.inertia:
        return
    rest = robot.feet[carrier.feet[0]].link if carrier.feet else robot.tree.links[0].name
    wrenches = inertial_wrenches(robot, table, rest)
    if wrenches is None:
        return
    for link in np.flatnonzero(carrier.carried & wrenches.any(axis=(0, 2))):
        yield int(link), -assumed.inertia * wrenches[:, link]


def _load_wrench(
    load: Load, table: PoseTable, at: Placements, standing: Standing | None, up: Array
) -> Array:
    """Return a load in and about its link's frame, shape (N, 6); zero in poses without it."""
    R_root_link, p = at.R[:, load.link], at.p[:, load.link]
    n = len(table)
    force: Array = np.broadcast_to(load.force, (n, 3))
    R_root_P = world_axes(up) if standing is None else standing.R_root_P
    if standing is not None:
        point = p + apply(R_root_link, load.point) - standing.p_root_P
        x = apply(np.swapaxes(R_root_P, 1, 2), point)
        force = force - (x - load.anchor) @ load.stiffness.T
    elif load.poses is None:
        force = np.zeros((n, 3))  # who hangs a robot up takes cables off, and nothing else touches
    in_link = apply(np.swapaxes(R_root_link, 1, 2), apply(R_root_P, force))
    if load.poses is not None:
        in_link = in_link * np.array([[float(pose in load.poses)] for pose in table.pose])
    return np.concatenate([in_link, cross(load.point, in_link)], axis=1)


def _loads_below(carrier: Carrier, below: npt.NDArray[np.bool_]) -> tuple[int, ...]:
    return tuple(
        s
        for s, (name, frame) in enumerate(zip(carrier.sensors, carrier.frames, strict=True))
        if name.startswith("load ") and frame is not None and below[frame]
    )


def _equilibrium(
    assumed: Assumed, balance: Balance, standing: Standing, h: Array, table: PoseTable
) -> Array:
    """Return what is left of the balance of the carried links about P, shape (N, 6)."""
    g, f = assumed.robot.gravity, balance.direction
    carried = balance.carrier.carried
    mass = float(assumed.robot.tree.masses[carried].sum())
    S = first_moments(balance, h).sum(axis=1)
    force, moment = balance.F - g * mass * f, balance.M - g * cross(S, f)
    left = _about(np.concatenate([force, moment], axis=1), standing.R_root_P, standing.p_root_P)
    if assumed.internal_torque:
        left[:, 4] += assumed.internal_torque * _internal_torque(assumed, table)
    return left


def _internal_torque(assumed: Assumed, table: PoseTable) -> Array:
    """Return M_2 of Muscolo 2017 (10): the sum of all joint torques about +y, (N,) [N m]."""
    return np.nansum(_torques(assumed, table), axis=1)


def _about(wrench: Array, R: Array, p: Array) -> Array:
    """Take wrenches about the root origin to a frame at R, p in the root frame, (N, 6)."""
    force, moment = wrench[:, :3], wrench[:, 3:] - cross(p, wrench[:, :3])
    Rt = np.swapaxes(R, 1, 2)
    return np.concatenate([apply(Rt, force), apply(Rt, moment)], axis=1)


def _torques(assumed: Assumed, table: PoseTable) -> Array:
    """Return measured joint torques, by motor currents where nothing better is there, (N, nj)."""
    by_current = table.current * motor_torque_factors(assumed.robot)
    return np.where(np.isfinite(table.torque), table.torque, by_current)


def _imu(assumed: Assumed, table: PoseTable, balance: Balance, standing: Standing) -> Array:
    """Return how the IMU's up leans against the expected one, about x and y of P, (N, 2) [rad]."""
    robot = assumed.robot
    link = robot.tree.link_index[str(robot.imu_link)]
    up = apply(balance.placements.R[:, link], apply(_imu_rotation(assumed), table.imu))
    up = up / np.linalg.norm(up, axis=1, keepdims=True)
    lean = cross(balance.direction, up)
    return apply(np.swapaxes(standing.R_root_P, 1, 2), lean)[:, :2]
