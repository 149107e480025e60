# SPDX-License-Identifier: Apache-2.0
"""Configurations: a shape, measured once or as twins tilted about the ankles, or on slopes.

A configuration in the sense of Muscolo 2017 is a *shape*. A pose and its twins, the same shape
turned as one rigid body about the ankle axis, are one configuration (the paper counts its a and b
as two).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from comcal.errors import NotARigidTiltError
from comcal.measure.table import PoseTable
from comcal.robot.frames import apply
from comcal.robot.kinematics import Placements, place_links
from comcal.robot.model import Robot
from comcal.robot.tree import Array
from comcal.statics.stance import in_stance, stance_frame
from comcal.statics.support import Carrier, carrier_of

MAX_SHAPE_ANGLE = np.deg2rad(1.0)
"""How far two twins' link orientations may differ from one rigid turn [rad]."""
MAX_SHAPE_SHIFT = 0.005
"""How far their link origins may [m]."""


@dataclass(frozen=True)
class Configuration:
    """One shape and the poses that measured it.

    Parameters
    ----------
    name : str
        Value of the column ``configuration``.
    rows : tuple of int
        Row numbers in the pose table; the first is the reference posture.
    tilts : array, shape (n_rows,)
        Tilt of each row relative to the first [rad], positive toes-ward, from the joint angles.
    foot_side : array of bool, shape (n_links,)
        Links that do not tilt: feet and what hangs below their ankles.
    """

    name: str
    carrier: Carrier
    rows: tuple[int, ...]
    tilts: Array
    foot_side: npt.NDArray[np.bool_]


def find_configurations(
    robot: Robot, table: PoseTable, rows: Sequence[int]
) -> tuple[tuple[Configuration, ...], tuple[NotARigidTiltError, ...]]:
    """Collect the shapes of a session by the column ``configuration`` and check them against q.

    Parameters
    ----------
    robot : Robot
    table : PoseTable
    rows : sequence of int
        Row numbers of standing poses that have a wrench; others are left out.

    Returns
    -------
    configurations : tuple of Configuration
        In order of first appearance. Every pose belongs to at most one; equal names in different
        supports are different configurations.
    refused : tuple of NotARigidTiltError
        One for each set of poses that share a name but are not one rigid tilt, with the reason.
    """
    labels: dict[tuple[str, str], list[int]] = {}
    for i in rows:
        if table.configuration[i]:
            labels.setdefault((table.configuration[i], table.support[i]), []).append(i)
    found: list[Configuration] = []
    refused: list[NotARigidTiltError] = []
    for (name, support), members in labels.items():
        carrier = carrier_of(robot, support)
        foot_side = foot_side_links(robot, carrier)
        try:
            tilts = rigid_tilts(robot, carrier, foot_side, table, members)
        except NotARigidTiltError as error:
            refused.append(error)
            continue
        found.append(Configuration(name, carrier, tuple(members), tilts, foot_side))
    return tuple(found), tuple(refused)


def foot_side_links(robot: Robot, carrier: Carrier) -> npt.NDArray[np.bool_]:
    """Return the links on the foot's side of every standing ankle, shape (n_links,)."""
    side = np.zeros(len(robot.tree.links), dtype=np.bool_)
    for name in carrier.feet:
        foot = robot.feet[name]
        if foot.ankle is not None:
            beyond = robot.tree.subtree(foot.ankle)
            side |= beyond if beyond[robot.tree.link_index[foot.link]] else ~beyond
        else:
            side[robot.tree.link_index[foot.link]] = True
    return side


def placed_in_stance(robot: Robot, carrier: Carrier, q: Array) -> Placements:
    """Return where every link is, seen from P, for N poses of one support."""
    placements = place_links(robot.tree, q)
    return in_stance(*stance_frame(robot, carrier.support, placements), placements)


def ankle_point(robot: Robot, carrier: Carrier, at: Placements) -> Array:
    """Return a point of the tilt axis in P, shape (N, 3) [m]: the mean of the standing ankles."""
    ankles = [a for a in (robot.feet[f].ankle for f in carrier.feet) if a is not None]
    if not ankles:
        return np.zeros((len(at.p), 3))
    return np.mean([at.joint(ankle)[1] for ankle in ankles], axis=0)


def pitch_between(R_from: Array, R_to: Array) -> Array:
    """Return the angle about +y that best takes *R_from* to *R_to* [rad], shape (...)."""
    turn = R_to @ np.swapaxes(R_from, -1, -2)
    return np.arctan2(turn[..., 0, 2] - turn[..., 2, 0], turn[..., 0, 0] + turn[..., 2, 2])


def mean_tilts(robot: Robot, configuration: Configuration, R: Array) -> Array:
    """Return how far each posture is tilted against the first, shape (..., K) [rad].

    Parameters
    ----------
    R : array, shape (..., K, n_links, 3, 3)
        Axes of all links in P.

    Notes
    -----
    The mean over the carried links above the ankles, weighted with their masses.
    """
    body = np.flatnonzero(~configuration.foot_side & configuration.carrier.carried)
    weights = robot.tree.masses[body]
    if weights.sum() <= 0:
        return np.zeros(R.shape[:-3])
    R = R[..., body, :, :]
    return pitch_between(R[..., :1, :, :, :], R) @ (weights / weights.sum())


def rigid_tilts(
    robot: Robot,
    carrier: Carrier,
    foot_side: npt.NDArray[np.bool_],
    table: PoseTable,
    rows: list[int],
) -> Array:
    """Return the tilts of poses of one shape relative to the first, shape (n_rows,) [rad].

    Raises
    ------
    NotARigidTiltError
        If what is above the ankles did not turn as one rigid body about the ankle axis, which is
        parallel to P's y axis. A lateral sway on two feet never does: each leg turns about its own
        ankle and the trunk is only shifted.
    """
    at = placed_in_stance(robot, carrier, table.q[rows])
    body = np.flatnonzero(~foot_side & carrier.carried)
    tilts = np.zeros(len(rows))
    if body.size == 0:
        return tilts
    pivot = ankle_point(robot, carrier, at)
    for k in range(1, len(rows)):
        angles = pitch_between(at.R[0, body], at.R[k, body])
        tilt = float(np.median(angles))
        R = _about_y(tilt)
        turn_error = R @ at.R[0, body] - at.R[k, body]
        angle_error = float(np.max(np.linalg.norm(turn_error, axis=(1, 2)))) / np.sqrt(2.0)
        moved = pivot[k] + apply(R, at.p[0, body] - pivot[0])
        shift = float(np.max(np.linalg.norm(moved - at.p[k, body], axis=1)))
        if angle_error > MAX_SHAPE_ANGLE or shift > MAX_SHAPE_SHIFT:
            raise _refusal(robot, carrier, table, (rows[0], rows[k]), angle_error, shift)
        tilts[k] = tilt
    return tilts


def _about_y(angle: float) -> Array:
    s, c = np.sin(angle), np.cos(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def _refusal(
    robot: Robot,
    carrier: Carrier,
    table: PoseTable,
    pair: tuple[int, int],
    angle_error: float,
    shift: float,
) -> NotARigidTiltError:
    """Say in words why two poses are not one rigid tilt."""
    a, b = pair
    changed = [
        name
        for name, dq in zip(robot.tree.joint_names, table.q[b] - table.q[a], strict=True)
        if abs(dq) > MAX_SHAPE_ANGLE
    ]
    ankles = {robot.feet[f].ankle for f in carrier.feet}
    others = [name for name in changed if name not in ankles]
    if others and len(carrier.feet) > 1 and any("roll" in name for name in others):
        reason = (
            "a lateral sway on two feet: each leg turns about its own ankle, the trunk is shifted"
        )
    elif others:
        reason = f"besides the ankles, {', '.join(others)} moved"
    elif len(carrier.feet) > 1:
        reason = "the ankle axes of the standing feet are not collinear"
    else:
        reason = "the ankle axis is not parallel to the y axis of the sole"
    return NotARigidTiltError(
        f"poses {table.pose[a]} and {table.pose[b]} share configuration "
        f"{table.configuration[a]!r} but are not one rigid tilt: {reason}",
        where=table.where(b),
        measured=f"{np.rad2deg(angle_error):.2f} deg, {shift * 1e3:.1f} mm",
        limit=f"{np.rad2deg(MAX_SHAPE_ANGLE):.1f} deg, {MAX_SHAPE_SHIFT * 1e3:.0f} mm",
        next_step="tilt about the ankle pitch axis only, stand on one foot, or use two slopes",
    )
