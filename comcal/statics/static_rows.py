# SPDX-License-Identifier: Apache-2.0
"""Every equation that the readings of a pose must satisfy, side by side.

Of poses in one kind of support: force and moment balance of what the feet carry (4 rows; none for a
hanging robot), six rows for every other cut, one row for every joint whose torque is known. Rows
are linear in link masses and first moments.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from comcal.measure.plan import NONE
from comcal.robot.frames import cross
from comcal.robot.tree import Array
from comcal.statics.balance import Balance, input_jacobian, moment_regressor, residual
from comcal.statics.cut_rows import Cut, cut_jacobian, cut_regressor, cut_residual
from comcal.statics.moves import moves_of, up_slopes
from comcal.statics.support import Carrier
from comcal.statics.torque_rows import joint_torques, torque_jacobian, torque_regressor

BALANCE_ROWS = 4
CUT_ROWS = 6


@dataclass(frozen=True)
class RowLayout:
    """Which equations a group of poses has, and in which order its inputs stand.

    Rows: balance, cuts, torques. Inputs: loaded wrenches (6 each), joint positions, wrenches at the
    cuts (6 each), torques, and for hanging poses the upward vector (3).

    Parameters
    ----------
    carrier : Carrier
    cuts : tuple of Cut
    torques : tuple of int
        Independent joints whose torque is known.
    n_joints : int
        Number of independent joints.
    """

    carrier: Carrier
    cuts: tuple[Cut, ...]
    torques: tuple[int, ...]
    n_joints: int

    @property
    def hangs(self) -> bool:
        """Whether the robot is held by something unknown."""
        return self.carrier.support == NONE

    @property
    def balance_rows(self) -> int:
        """Number of rows of the whole robot."""
        return 0 if self.hangs else BALANCE_ROWS

    @property
    def n_rows(self) -> int:
        """Number of equations of a pose."""
        return self.balance_rows + CUT_ROWS * len(self.cuts) + len(self.torques)

    @property
    def n_inputs(self) -> int:
        """Number of measured numbers of a pose."""
        return self.up_columns.stop

    @property
    def q_columns(self) -> slice:
        """Columns of the joint positions among the inputs."""
        start = 6 * len(self.carrier.sensors)
        return slice(start, start + self.n_joints)

    @property
    def cut_columns(self) -> slice:
        """Columns of the wrenches at the cuts."""
        start = self.q_columns.stop
        return slice(start, start + 6 * len(self.cuts))

    @property
    def torque_columns(self) -> slice:
        """Columns of the torques."""
        start = self.cut_columns.stop
        return slice(start, start + len(self.torques))

    @property
    def up_columns(self) -> slice:
        """Columns of the upward vector."""
        start = self.torque_columns.stop
        return slice(start, start + (3 if self.hangs else 0))

    def sensor_columns(self, sensor: str) -> slice | None:
        """Return the columns of a sensor's wrench, or None when it has no part in these poses."""
        if sensor in self.carrier.sensors:
            start = 6 * self.carrier.sensors.index(sensor)
            return slice(start, start + 6)
        for i, cut in enumerate(self.cuts):
            if cut.sensor == sensor:
                start = self.cut_columns.start + 6 * i
                return slice(start, start + 6)
        return None

    def cut_rows(self, i: int) -> slice:
        """Return the rows of cut *i*."""
        start = self.balance_rows + CUT_ROWS * i
        return slice(start, start + CUT_ROWS)

    @property
    def torque_rows(self) -> slice:
        """Rows of the torques."""
        return slice(self.n_rows - len(self.torques), self.n_rows)


@dataclass(frozen=True)
class Model:
    """What the equations are evaluated for.

    Parameters
    ----------
    mass : float
        Of what is carried [kg].
    h : array, shape (n_links, 3)
        First moments of the links in their own frames [kg m].
    masses : array, shape (n_links,)
        [kg]
    """

    mass: float
    h: Array
    masses: Array


def row_residual(
    layout: RowLayout, balance: Balance, cut_wrenches: Array, torques: Array, model: Model
) -> Array:
    """Return what is left of every equation, shape (N, n_rows) [N], [N m].

    Parameters
    ----------
    layout : RowLayout
    balance : Balance
        At the poses' inputs.
    cut_wrenches : array, shape (N, n_cuts, 6)
        Below on above, in and about each sensor's frame [N, N m].
    torques : array, shape (N, n_torques)
        Of parent on child about (along) +axis [N m], [N].
    model : Model
    """
    left = np.empty((len(balance.q), layout.n_rows))
    if not layout.hangs:
        left[:, :BALANCE_ROWS] = residual(balance, model.mass, model.h, model.masses)
    for i, cut in enumerate(layout.cuts):
        left[:, layout.cut_rows(i)] = cut_residual(
            balance, cut, cut_wrenches[:, i], model.h, model.masses
        )
    if layout.torques:
        expected = joint_torques(balance, moves_of(balance), model.h, model.masses)
        left[:, layout.torque_rows] = torques - expected[:, list(layout.torques)]
    return left


def row_jacobian(layout: RowLayout, balance: Balance, cut_wrenches: Array, model: Model) -> Array:
    """Return d(residual)/d(inputs), shape (N, n_rows, n_inputs); arguments as above."""
    n, q, up = len(balance.q), layout.q_columns, layout.up_columns
    B = np.zeros((n, layout.n_rows, layout.n_inputs))
    if not layout.hangs:
        by_wrench, by_joint = input_jacobian(balance, model.h, model.masses)
        B[:, :BALANCE_ROWS, : q.start] = by_wrench.reshape(n, BALANCE_ROWS, -1)
        B[:, :BALANCE_ROWS, q] = by_joint
    if not layout.cuts and not layout.torques:
        return B
    moves = moves_of(balance)
    slopes = up_slopes(balance, moves)
    for i, cut in enumerate(layout.cuts):
        by_wrench, by_cut, by_joint, by_up = cut_jacobian(
            balance, cut, cut_wrenches[:, i], moves, slopes, model.h, model.masses
        )
        rows, own = layout.cut_rows(i), layout.sensor_columns(cut.sensor)
        B[:, rows, : q.start] = by_wrench.reshape(n, CUT_ROWS, -1)
        B[:, rows, q] = by_joint
        B[:, rows, own] = by_cut
        B[:, rows, up] = by_up[:, :, : up.stop - up.start]
    if layout.torques:
        at = list(layout.torques)
        by_wrench, by_joint, by_up = torque_jacobian(balance, moves, slopes, model.h, model.masses)
        rows = layout.torque_rows
        B[:, rows, : q.start] = -by_wrench[:, at].reshape(n, len(at), -1)
        B[:, rows, q] = -by_joint[:, at]
        B[:, rows, layout.torque_columns] = np.eye(len(at))
        B[:, rows, up] = -by_up[:, at, : up.stop - up.start]
    return B


def row_regressor(
    layout: RowLayout, balance: Balance, direction: Array, links: Sequence[int] | None = None
) -> tuple[Array, Array]:
    """Return d(residual)/d(link masses) and d(residual)/d(first moments).

    Parameters
    ----------
    direction : array, shape (N, 3)
        Unit vector up in the root frame; that of *balance* or a steadier one.
    links : sequence of int, optional
        Only these links, in this order.

    Returns
    -------
    by_mass : array, shape (N, n_rows, n_links)
    by_moment : array, shape (N, n_rows, n_links, 3)
    """
    g, at, carried = balance.robot.gravity, balance.placements, balance.carrier.carried
    chosen = list(range(at.p.shape[1])) if links is None else list(links)
    n, n_links = len(at.p), len(chosen)
    by_mass = np.zeros((n, layout.n_rows, n_links))
    by_moment = np.zeros((n, layout.n_rows, n_links, 3))
    if not layout.hangs:
        by_mass[:, 0] = -g * carried[chosen]
        arms = np.swapaxes(cross(at.p[:, chosen], direction[:, None]), 1, 2)
        by_mass[:, 1:BALANCE_ROWS] = -g * arms * carried[chosen]
        by_moment[:, 1:BALANCE_ROWS] = moment_regressor(balance, direction, chosen)
    for i, cut in enumerate(layout.cuts):
        rows = layout.cut_rows(i)
        masses, moments = cut_regressor(balance, cut, direction)
        by_mass[:, rows], by_moment[:, rows] = masses[:, :, chosen], moments[:, :, chosen]
    if layout.torques:
        joints = list(layout.torques)
        masses, moments = torque_regressor(balance, moves_of(balance), direction, chosen)
        by_mass[:, layout.torque_rows] = -masses[:, joints]
        by_moment[:, layout.torque_rows] = -moments[:, joints]
    return by_mass, by_moment
