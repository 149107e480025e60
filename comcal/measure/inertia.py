# SPDX-License-Identifier: Apache-2.0
"""The wrench that a moving robot's inertia adds to what its sensors feel.

Statics says F = -sum m_k g. A robot that moves is held up by F = sum m_k (a_k - g), and about a
point O by M_O = sum [(c_k - O) x m_k (a_k - g) + dL_k/dt], dL_k/dt = I_k w'_k + w_k x I_k w_k. What
statics neglects is therefore

    F_neglected = sum m_k a_k,    M_neglected = sum [(c_k - O) x m_k a_k + dL_k/dt]

over the links above the cut, with the standing foot at rest.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from comcal.measure.plan import DOUBLE
from comcal.measure.stance_load import stance_frames
from comcal.robot.frames import apply
from comcal.robot.kinematics import Placements, place_links
from comcal.robot.model import Foot, Robot
from comcal.robot.tree import Array

STEP = 1e-3
"""Step of the numerical derivatives along the motion [s]."""


@dataclass(frozen=True)
class InertialLoads:
    """Inertial force and moment of every link, N samples of one support.

    Parameters
    ----------
    force : array, shape (N, n_links, 3)
        ``m_k a_k`` [N], in the frame of the link at rest.
    moment : array, shape (N, n_links, 3)
        ``dL_k/dt`` about the CoM of link k [N m].
    com : array, shape (N, n_links, 3)
        CoM of link k [m].
    R_rest_root, p_rest : array, shape (N, 3, 3) and (N, 3)
        Maps the root frame to that of the link at rest: ``R_rest_root (p - p_rest)``.
    placements : Placements
    """

    force: Array
    moment: Array
    com: Array
    R_rest_root: Array
    p_rest: Array
    placements: Placements

    def wrench(
        self, is_above: npt.NDArray[np.bool_], R_root_frame: Array, p_root_frame: Array
    ) -> Array:
        """Return the neglected wrench of some links in and about a frame, shape (N, 6).

        Parameters
        ----------
        is_above : array of bool, shape (n_links,)
            The links that are carried.
        R_root_frame, p_root_frame : array, shape (N, 3, 3) and (N, 3)
            The frame in the root frame.
        """
        origin = apply(self.R_rest_root, p_root_frame - self.p_rest)
        force, moment = self.force[:, is_above], self.moment[:, is_above]
        lever = self.com[:, is_above] - origin[:, None]
        total = np.concatenate(
            [force.sum(axis=1), (moment + np.cross(lever, force)).sum(axis=1)], axis=1
        )
        R_frame_rest = np.swapaxes(self.R_rest_root @ R_root_frame, 1, 2)
        return np.concatenate(
            [apply(R_frame_rest, total[:, :3]), apply(R_frame_rest, total[:, 3:])], axis=1
        )


def inertial_loads(robot: Robot, q: Array, qd: Array, qdd: Array, rest: str) -> InertialLoads:
    """Return the inertial load of every link.

    Parameters
    ----------
    robot : Robot
        With a URDF.
    q, qd, qdd : array, shape (N, n_joints)
        Joint positions, velocities and accelerations, SI.
    rest : str
        The link that does not move: a standing foot, or the root.

    Notes
    -----
    Positions and rotations are differentiated twice along the motion
    q(s) = q + qd s + qdd s^2 / 2, by central differences: no Jacobian, and the centripetal terms
    come with it.
    """
    tree = robot.tree
    k = tree.link_index[rest]
    com: list[Array] = []
    R: list[Array] = []
    here = place_links(tree, q)
    for s in (-STEP, 0.0, STEP):
        placed = place_links(tree, q + qd * s + 0.5 * qdd * s**2)
        R_rest_root = np.swapaxes(placed.R[:, k], 1, 2)
        com.append(apply(R_rest_root[:, None], placed.coms - placed.p[:, k, None]))
        R.append(R_rest_root[:, None] @ placed.R)
    acceleration = (com[0] - 2.0 * com[1] + com[2]) / STEP**2
    before, after = (_rotation_vector(R[i] @ np.swapaxes(R[1], -1, -2)) for i in (0, 2))
    omega, alpha = (after - before) / (2.0 * STEP), (after + before) / STEP**2
    inertia = R[1] @ np.array([link.inertia for link in tree.links]) @ np.swapaxes(R[1], -1, -2)
    moment = apply(inertia, alpha) + np.cross(omega, apply(inertia, omega))
    return InertialLoads(
        tree.masses[:, None] * acceleration,
        moment,
        com[1],
        np.swapaxes(here.R[:, k], 1, 2),
        here.p[:, k],
        here,
    )


def _rotation_vector(R: Array) -> Array:
    """Return the rotation vector of small rotations, shape (..., 3), to third order."""
    return 0.5 * np.stack(
        [
            R[..., 2, 1] - R[..., 1, 2],
            R[..., 0, 2] - R[..., 2, 0],
            R[..., 1, 0] - R[..., 0, 1],
        ],
        axis=-1,
    )


def neglected_wrenches(
    robot: Robot, q: Array, qd: Array, qdd: Array, support: str
) -> tuple[dict[str, Array], Array]:
    """Return what statics neglects, in the channels of every sensor and plate.

    Parameters
    ----------
    robot : Robot
        With a URDF.
    q, qd, qdd : array, shape (N, n_joints)
        SI.
    support : str
        The same for all samples.

    Returns
    -------
    wrenches : dict from sensor or plate name to array, shape (N, 6)
        In and about its frame. Two feet share one load in a way that statics does not tell: each
        is given the whole, divided by the square root of their number, so that their independent
        errors add up to it.
    cop : array, shape (N, 2)
        By how much the centre of pressure misses the CoM, x and y of the stance frame [m]; zero
        where no foot stands.
    """
    feet = [f for f in robot.feet.values() if support in (DOUBLE, f.name)]
    rest = feet[0].link if feet else robot.tree.links[0].name
    loads = inertial_loads(robot, q, qd, qdd, rest)
    n = len(loads.com)
    everything = np.ones(len(robot.tree.links), dtype=np.bool_)
    cut = everything.copy()
    for foot in feet:
        if foot.sensor is not None:
            cut &= ~robot.below_cut[foot.sensor]
    R_stance_root, p_stance = stance_frames(robot, loads.placements, [feet] * n)
    R_root_stance = np.swapaxes(R_stance_root, 1, 2)
    wrenches: dict[str, Array] = {}
    for name, sensor in robot.sensors.items():
        stands = any(f.sensor == name for f in feet)
        is_above = cut if stands else robot.below_cut[name]
        shared = np.sqrt(len(feet)) if stands else 1.0
        wrenches[name] = loads.wrench(is_above, *loads.placements.joint(sensor.joint)) / shared
    for name, plate in robot.plates.items():
        under = [f for f in feet if f.name in plate.feet]
        if under:
            frame = (
                (R_root_stance, p_stance)
                if plate.frame == "world"
                else loads.placements.link(plate.frame)
            )
            shared = np.sqrt(len(feet) / len(under))
            wrenches[name] = loads.wrench(everything, *frame) / shared
    return wrenches, _pressure_error(robot, loads, feet, R_root_stance, p_stance)


def _pressure_error(
    robot: Robot, loads: InertialLoads, feet: list[Foot], R_root_stance: Array, p_stance: Array
) -> Array:
    """Return (-My, Mx) / (m g) of the neglected moment about the stance origin, shape (N, 2)."""
    weight = robot.tree.total_mass * robot.gravity
    if not feet or not weight > 0.0:
        return np.zeros((len(p_stance), 2))
    everything = np.ones(len(robot.tree.links), dtype=np.bool_)
    wrench = loads.wrench(everything, R_root_stance, p_stance)
    return np.column_stack([-wrench[:, 4], wrench[:, 3]]) / weight
