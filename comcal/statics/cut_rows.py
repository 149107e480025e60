# SPDX-License-Identifier: Apache-2.0
r"""Equilibrium of what hangs or stands below a cut that does not carry the robot.

Hip sensors, sensors of the foot in the air, of an arm: any cut besides those of the standing feet.
With B the links below it and above the cuts of standing feet, (m, S) their mass and first moment
about the root origin, and W_c the measured loads of standing feet in B, the wrench that B exerts on
the part above is

.. math:: W = \sum_c W_c - g\,(m f,\; S \times f)

six equations without any assumption about the direction of gravity but the measured one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from comcal.measure.plan import NONE
from comcal.robot.frames import cross, skew
from comcal.robot.model import Robot
from comcal.robot.tree import Array
from comcal.statics.balance import Balance, first_moments
from comcal.statics.moves import Moves, UpSlopes
from comcal.statics.support import Carrier
from comcal.statics.wrenches import wrench_transform


@dataclass(frozen=True)
class Cut:
    """One such sensor.

    Parameters
    ----------
    sensor : str
    link : int
        In whose frame it measures.
    below : array of bool, shape (n_links,)
        Links below the cut and above the cuts of standing feet.
    feet : tuple of int
        Carrying sensors whose loads enter below the cut.
    """

    sensor: str
    link: int
    below: npt.NDArray[np.bool_]
    feet: tuple[int, ...]


def cuts_of(robot: Robot, carrier: Carrier) -> tuple[Cut, ...]:
    """Return the cuts that add equations in one kind of support.

    Left out are sensors whose lower side holds a standing foot without a load of its own, and, of a
    hanging robot, sensors that carry the held root link.
    """
    found: list[Cut] = []
    for name, sensor in robot.sensors.items():
        if name in carrier.sensors:
            continue
        below = robot.below_cut[name]
        feet: list[int] = []
        known = not (carrier.support == NONE and below[0])
        for foot in (robot.feet[f] for f in carrier.feet):
            stands = bool(below[robot.tree.link_index[foot.link]])
            if foot.sensor in carrier.sensors:
                at = carrier.sensors.index(str(foot.sensor))
                frame = carrier.frames[at]
                known &= frame is not None and stands == bool(below[frame])
                if stands:
                    feet.append(at)
            else:
                known &= not stands
        if known:
            link = robot.tree.joint_index[sensor.joint] + 1
            found.append(Cut(name, link, below & carrier.carried, tuple(feet)))
    return tuple(found)


def cut_transform(balance: Balance, cut: Cut) -> Array:
    """Return what takes the cut's wrench to the root frame, shape (N, 6, 6)."""
    at = balance.placements
    return wrench_transform(at.R[:, cut.link], at.p[:, cut.link])


def cut_residual(
    balance: Balance, cut: Cut, wrench: Array, h: Array, masses: Array | None = None
) -> Array:
    """Return measured minus expected wrench, in and about the root frame, (N, 6) [N, N m].

    Parameters
    ----------
    wrench : array, shape (N, 6)
        What the part below exerts on the part above, in and about the sensor's frame.
    h : array, shape (n_links, 3)
        First moments of the links in their own frames [kg m].
    masses : array, shape (n_links,), optional
        By default the URDF's [kg].
    """
    g, f = balance.robot.gravity, balance.direction
    m = (balance.robot.tree.masses if masses is None else masses)[cut.below].sum()
    S = first_moments(balance, h, masses)[:, cut.below].sum(axis=1)
    loads = balance.wrench_each[:, list(cut.feet)].sum(axis=1)
    weight = g * np.concatenate([m * f, cross(S, f)], axis=1)
    return np.einsum("nij,nj->ni", cut_transform(balance, cut), wrench) - loads + weight


def cut_regressor(balance: Balance, cut: Cut, direction: Array) -> tuple[Array, Array]:
    """Return d(residual)/d(m_k), (N, 6, n_links), and d(residual)/d(h_k), (N, 6, n_links, 3).

    Parameters
    ----------
    direction : array, shape (N, 3)
        Unit vector up in the root frame.
    """
    at, g = balance.placements, balance.robot.gravity
    n, n_links = at.p.shape[:2]
    by_mass = np.zeros((n, 6, n_links))
    by_mass[:, :3] = direction[:, :, None]
    by_mass[:, 3:] = np.swapaxes(cross(at.p, direction[:, None]), 1, 2)
    by_moment = np.zeros((n, 6, n_links, 3))
    by_moment[:, 3:] = np.swapaxes(-skew(direction)[:, None] @ at.R, 1, 2)
    return g * by_mass * cut.below, g * by_moment * cut.below[:, None]


def cut_jacobian(
    balance: Balance,
    cut: Cut,
    wrench: Array,
    moves: Moves,
    up: UpSlopes,
    h: Array,
    masses: Array | None = None,
) -> tuple[Array, Array, Array, Array]:
    """Return the derivatives of :func:`cut_residual` with respect to what was measured.

    Returns
    -------
    by_wrench : array, shape (N, 6, n_sensors, 6)
        Each loaded wrench in its own sensor's frame.
    by_cut : array, shape (N, 6, 6)
        The wrench at the cut itself, in its sensor's frame.
    by_joint : array, shape (N, 6, n_joints)
    by_up : array, shape (N, 6, 3)
    """
    g, f = balance.robot.gravity, balance.direction
    m = (balance.robot.tree.masses if masses is None else masses) * cut.below
    s = first_moments(balance, h, masses) * cut.below[:, None]
    X = cut_transform(balance, cut)

    by_f = np.zeros((len(f), 6, 3))
    by_f[:, :3] = g * m.sum() * np.eye(3)
    by_f[:, 3:] = g * skew(s.sum(axis=1))
    by_wrench = np.einsum("nij,njsk->nisk", by_f, up.by_wrench)
    for k in cut.feet:
        by_wrench[:, :, k] -= balance.X[:, k]

    here = moves.beyond[:, cut.link][:, None] * np.einsum("nij,nj->ni", X, wrench)[:, None]
    for k in cut.feet:
        frame = balance.carrier.frames[k]
        here = here - moves.beyond[:, frame][:, None] * balance.wrench_each[:, k][:, None]
    per_joint = moves.of_wrenches(here)
    moved = moves.of_moments(moves.beyond @ m, moves.beyond @ s)
    per_joint[..., 3:] += g * cross(moved, f[:, None])
    by_joint = np.swapaxes(per_joint, 1, 2) @ moves.motion.drive + by_f @ up.by_joint
    return by_wrench, X, by_joint, by_f @ up.by_up
