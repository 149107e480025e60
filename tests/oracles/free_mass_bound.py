# SPDX-License-Identifier: Apache-2.0
"""The Cramer-Rao bound where the mass of every body is unknown, with and without joint torques.

As :mod:`cramer_rao` it predicts *measurements*, from the kinematics of :mod:`forward_model`, and
differentiates them by complex steps; nothing of it comes from ``comcal.statics`` or
``comcal.identify``. Of each pose these are unknown: the true angles, the direction of gravity in
the root frame and, on two feet, the wrench of the first sensor. What lies below the cuts is known.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from forward_model import Complex, Joint, Real, place

from comcal.robot.model import Robot

STEP = 1e-30
"""Imaginary step of the derivatives, exact to rounding."""


@dataclass(frozen=True)
class Skeleton:
    """What the bound needs of a robot.

    Parameters
    ----------
    joints : list of Joint
        Fixed and turning ones, in the order of the links they lead to.
    beyond : array of bool, shape (n_links, n_links)
        ``beyond[i, k]``: link k is link i or hangs on it.
    sensor_link : mapping from sensor name to int
        Link in whose frame it measures.
    below : mapping from sensor name to array of bool, shape (n_links,)
        Links below its cut.
    free : tuple of int
        Links whose mass and first moment are unknown.
    """

    gravity: float
    names: tuple[str, ...]
    joints: list[Joint]
    beyond: np.ndarray
    sensor_link: Mapping[str, int]
    below: Mapping[str, np.ndarray]
    free: tuple[int, ...]
    masses: Real
    moments: Real


def skeleton_of(robot: Robot, free: tuple[int, ...]) -> Skeleton:
    """Return the skeleton of a robot without mimics and sliding joints."""
    tree = robot.tree
    angle = {name: i for i, name in enumerate(tree.joint_names)}
    joints = [
        Joint(j.parent, j.child, j.T_parent_joint[:3, :3], j.T_parent_joint[:3, 3], j.axis, at)
        for j in tree.joints
        for at in [angle.get(j.name, -1)]
    ]
    return Skeleton(
        robot.gravity,
        tuple(link.name for link in tree.links),
        joints,
        tree.descendants,
        {s.name: tree.joint_index[s.joint] + 1 for s in robot.sensors.values()},
        robot.below_cut,
        free,
        tree.masses,
        tree.masses[:, None] * tree.coms,
    )


@dataclass(frozen=True)
class Stood:
    """What is true in a pose.

    Parameters
    ----------
    loaded : tuple of str
        Sensors of the standing feet.
    q : array, shape (n_joints,)
    up : array, shape (3,)
        Against gravity, in the root frame.
    first : array, shape (6,)
        Wrench of the first loaded sensor [N, N m].
    """

    loaded: tuple[str, ...]
    q: Real
    up: Real
    first: Real


def information(
    bones: Skeleton,
    poses: list[Stood],
    theta: Real,
    sigma: tuple[float, float, float],
    torque_sigma: float | None = None,
) -> Real:
    """Return what poses tell of masses and first moments, once their own unknowns are fitted away.

    Parameters
    ----------
    theta : array, shape (4 n_free,)
        Masses [kg] of the free links, then their first moments [kg m].
    sigma : tuple of float
        Of forces [N], moments [N m] and angles [rad].
    torque_sigma : float, optional
        Of every joint torque [N m]; without it they are not measured.

    Returns
    -------
    array, shape (4 n_free, 4 n_free)
    """
    F = np.zeros((len(theta), len(theta)))
    for pose in poses:
        n_local = len(pose.q) + 2 + 6 * (len(pose.loaded) - 1)
        x = np.concatenate([np.zeros(n_local), theta])
        J = measured(bones, pose, x + 1j * STEP * np.eye(len(x)), n_local).imag.T / STEP
        wrench = np.repeat(sigma[:2], 3)
        sigmas = [np.full(len(pose.q), sigma[2]), *[wrench] * len(bones.sensor_link)]
        sigmas.append(np.full(len(pose.q), torque_sigma or np.inf))
        J /= np.concatenate(sigmas)[:, None]
        own, rest = J[:, :n_local], J[:, n_local:]
        basis, _ = np.linalg.qr(own / np.linalg.norm(own, axis=0))
        rest = rest - basis @ (basis.T @ rest)
        F += rest.T @ rest
    return F


def measured(bones: Skeleton, pose: Stood, x: Complex, n_local: int) -> Complex:
    """Return angles, wrenches of all sensors and joint torques, shape (B, n).

    ``x`` holds what is added to the angles, two tilts of gravity, what is added to the wrench of
    the first of two feet, then masses and first moments of the free links.
    """
    n_q, n_free = len(pose.q), len(bones.free)
    q = pose.q + x[:, :n_q]
    frames = list(place_all(bones, q))
    e1 = np.cross(pose.up, np.eye(3)[np.argmin(np.abs(pose.up))])
    e1 /= np.linalg.norm(e1)
    e2 = np.cross(pose.up, e1)
    u = pose.up + x[:, n_q, None] * e1 + x[:, n_q + 1, None] * e2
    u = u / np.sqrt(np.sum(u * u, axis=1))[:, None]

    masses = np.tile(bones.masses.astype(complex), (len(x), 1))
    h = np.tile(bones.moments.astype(complex), (len(x), 1, 1))
    masses[:, bones.free] = x[:, n_local : n_local + n_free]
    h[:, bones.free] = x[:, n_local + n_free :].reshape(len(x), n_free, 3)
    p = np.stack([at for _, at in frames], axis=1)
    S = masses[:, :, None] * p + np.stack(
        [_apply(R, h[:, k]) for k, (R, _) in enumerate(frames)], 1
    )

    carried = ~np.any([bones.below[s] for s in pose.loaded], axis=0)
    F, M = _weight(bones, masses, S, u, carried)  # what the ground has to bear, about the root
    loads = dict[str, tuple[Complex, Complex]]()
    wrenches = dict[str, Complex]()
    for sensor in pose.loaded:
        k = bones.sensor_link[sensor]
        R, at = frames[k]
        if sensor == pose.loaded[-1]:
            f, m = F, M - np.cross(at, F)
        else:
            w = pose.first + x[:, n_q + 2 : n_q + 8]
            f, m = _apply(R, w[:, :3]), _apply(R, w[:, 3:])
        loads[sensor] = f, m + np.cross(at, f)
        F, M = F - f, M - loads[sensor][1]
        wrenches[sensor] = _in_frame(R, f, m)
    for sensor, k in bones.sensor_link.items():
        if sensor not in loads:
            R, at = frames[k]
            f, m = _weight(bones, masses, S, u, bones.below[sensor])
            wrenches[sensor] = _in_frame(R, -f, -(m - np.cross(at, f)))
    torques = np.zeros((len(x), n_q), complex)
    for k, joint in enumerate(bones.joints, start=1):
        if joint.angle >= 0:
            f, m = _weight(bones, masses, S, u, bones.beyond[k] & carried)
            for sensor, (f_s, m_s) in loads.items():
                if bones.beyond[k][bones.sensor_link[sensor]]:
                    f, m = f - f_s, m - m_s
            R, at = frames[k]
            axis = R @ joint.axis
            torques[:, joint.angle] = np.sum(axis * (m - np.cross(at, f)), axis=1)
    return np.concatenate([q, *(wrenches[s] for s in bones.sensor_link), torques], axis=1)


def place_all(bones: Skeleton, q: Complex) -> list[tuple[Complex, Complex]]:
    """Return rotation (B, 3, 3) and origin (B, 3) of every link in the root frame, by number."""
    frames = place(_Named(dict.fromkeys(bones.names, 0.0), bones.joints), q)
    return [frames[name] for name in bones.names]


@dataclass(frozen=True)
class _Named:
    """As much of a machine as :func:`forward_model.place` looks at."""

    masses: dict[str, float]
    joints: list[Joint]


def _weight(
    bones: Skeleton, masses: Complex, S: Complex, u: Complex, counted: np.ndarray
) -> tuple[Complex, Complex]:
    """Return force and moment about the root origin that hold some links, (B, 3) each."""
    f = bones.gravity * masses[:, counted].sum(axis=1)[:, None] * u
    return f, bones.gravity * np.cross(S[:, counted].sum(axis=1), u)


def _in_frame(R: Complex, f: Complex, m: Complex) -> Complex:
    back = np.swapaxes(R, 1, 2)
    return np.concatenate([_apply(back, f), _apply(back, m)], axis=1)


def _apply(R: Complex, v: Complex) -> Complex:
    return (R @ v[..., None])[..., 0]
