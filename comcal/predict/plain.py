# SPDX-License-Identifier: Apache-2.0
"""The readings that the robot would have given had nothing pulled at it: what a solver can use.

The balance of a calibration knows feet, joints and links, and nothing else. Of what is assumed of
the surroundings, it needs

- loads from outside, and what inertia demands: their wrench is taken up by a standing foot instead.
  That is exact: without them, that wrench would have come from the floor, every joint in between
  would have held it, and how two feet share a load enters no balance;
- the tilt of an IMU: it says where up is while the robot hangs, so its reading is turned back;
- not the slope of the floor, nor soles that give way: the forces themselves say where up is, pose
  by pose, and P is attached to the soles, whatever these stand on;
- not the term M_2 of Muscolo 2017 (10): internal torques cancel in the balance of the whole robot.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from comcal.errors import ConfigError
from comcal.measure.table import PoseTable
from comcal.predict.assumed import Assumed
from comcal.predict.parity import placed
from comcal.robot.frames import rotation_from_rpy
from comcal.robot.tree import Array
from comcal.statics.balance import Balance
from comcal.statics.cut_rows import cut_transform, cuts_of
from comcal.statics.moves import moves_of
from comcal.statics.support import Carrier
from comcal.statics.torque_rows import joint_torques, motor_torque_factors


def plain_readings(assumed: Assumed, table: PoseTable) -> PoseTable:
    """Return the readings as they would be with a straight IMU and no load from outside.

    Parameters
    ----------
    assumed : Assumed
        The robot and its surroundings.
    table : PoseTable
        Readings as they are understood: errors of sensors, angles and motors are undone.

    Returns
    -------
    PoseTable
        To be solved with ``assumed.robot`` alone. A CoM or CoP that is given stays as it is.
    """
    roll, pitch = assumed.imu_tilt
    R_link_imu = rotation_from_rpy([roll, pitch, 0.0])
    table = replace(table, imu=table.imu @ R_link_imu.T)
    assumed = replace(assumed, imu_tilt=np.zeros(2))
    if not assumed.loads and not assumed.inertia:
        return table
    wrench = {sensor: w.copy() for sensor, w in table.wrench.items()}
    torque = np.zeros(table.torque.shape)
    for support in sorted(set(table.support)):
        index = np.flatnonzero([s == support for s in table.support])
        try:
            balance, carrier, _ = placed(assumed, table.select(index), support)
        except ConfigError:  # neither sensor nor plate: the CoM has to be given, and stays
            continue
        moved = _taken_up_by_a_foot(balance, carrier)
        if carrier.sensors and carrier.sensors[0] in wrench:
            first = moved.wrench_each[:, :1, :, None]
            wrench[carrier.sensors[0]][index] += np.linalg.solve(moved.X[:, :1], first)[:, 0, :, 0]
        for sensor, change in _at_cuts(balance, moved, carrier).items():
            if sensor in wrench:
                wrench[sensor][index] += change
        h = np.zeros((len(assumed.robot.tree.links), 3))
        held = [joint_torques(b, moves_of(b), h) for b in (moved, _loads_alone(balance, carrier))]
        torque[index] = held[0] - held[1]
    factor = motor_torque_factors(assumed.robot)
    current = np.divide(torque, factor, out=np.zeros_like(torque), where=np.isfinite(factor))
    return replace(
        table, wrench=wrench, torque=table.torque + torque, current=table.current + current
    )


def _loads_alone(balance: Balance, carrier: Carrier) -> Balance:
    """Return the balance with the loads from outside and none of the feet."""
    each = balance.wrench_each.copy()
    each[:, : len(carrier.sensors)] = 0.0
    return replace(balance, wrench_each=each)


def _taken_up_by_a_foot(balance: Balance, carrier: Carrier) -> Balance:
    """Return the balance in which the first standing sensor carries all loads from outside."""
    n = len(carrier.sensors)
    each = np.zeros_like(balance.wrench_each[:, :n])
    each[:, :1] = balance.wrench_each[:, n:].sum(axis=1)[:, None]
    return replace(
        balance, carrier=carrier, w=balance.w[:, :n], X=balance.X[:, :n], wrench_each=each
    )


def _at_cuts(balance: Balance, moved: Balance, carrier: Carrier) -> dict[str, Array]:
    """Return what the readings of sensors that do not carry the robot change by, (N, 6) each."""
    n, changes = len(carrier.sensors), dict[str, Array]()
    links = np.array(balance.carrier.frames[n:], np.intp)
    for cut in cuts_of(balance.robot, carrier):
        below = n + np.flatnonzero(cut.below[links])
        change = -balance.wrench_each[:, below].sum(axis=1)
        if 0 in cut.feet:
            change = change + moved.wrench_each[:, 0]
        X = cut_transform(balance, cut)
        changes[cut.sensor] = np.linalg.solve(X, change[:, :, None])[:, :, 0]
    return changes
