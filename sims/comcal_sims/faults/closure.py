# SPDX-License-Identifier: Apache-2.0
"""Joint angles with which all standing soles rest flat on one floor.

Legs whose encoders or lengths are off do not close the chain at the angles that are commanded. A
real robot gives: servos, gears and soles yield until the feet are flat. Here the smallest change
of joint angles that does it is taken; encoders see it, as they do in reality.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from comcal.errors import UsageError
from comcal.robot.frames import transform_from
from comcal.robot.kinematics import Placements, place_links
from comcal.robot.model import Foot, Robot
from comcal.robot.tree import Array
from comcal_sims.rotations import floor_rotation

CLOSED = 1e-10
"""Largest gap [m] and angle [rad] that is left."""
ROUNDS = 30
_STEP = 1e-6
_LONGEST_STEP = 0.05
_LARGEST = 0.2
"""Change of one joint beyond which this is no small correction [rad] or [m]."""


@dataclass(frozen=True)
class Shift:
    """Where a foot stands against where its angles alone would put it, in its sole axes.

    ``x``, ``y`` [m], ``yaw`` [rad].
    """

    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0

    def transform(self) -> Array:
        """Return it as a transform, shape (4, 4)."""
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        return transform_from(R, (self.x, self.y, 0.0))


@dataclass(frozen=True)
class Stance:
    """The feet that stand, and how they are shifted.

    Parameters
    ----------
    feet : sequence of Foot
        Their ``T_link_sole`` is the plane by which they rest on the floor.
    shifts : mapping from foot name to Shift
        Empty: the feet stand wherever the angles put them on the floor.
    stuck_at : array, shape (n_joints,), or None
        Angles with which the feet were put down; they stay there, with friction [rad] or [m].
    """

    feet: Sequence[Foot]
    shifts: Mapping[str, Shift] = field(default_factory=dict[str, Shift])
    stuck_at: Array | None = None


def closed_angles(robot: Robot, stance: Stance, q: Array, where: str = "") -> Array:
    """Return the angles nearest to *q* with which all soles of a stance lie in one plane.

    Parameters
    ----------
    robot : Robot
    stance : Stance
    q : array, shape (n_joints,)
        [rad] or [m]
    where : str
        The pose, for the message.

    Returns
    -------
    array, shape (n_joints,)
        *q* itself with fewer than two feet.

    Raises
    ------
    UsageError
        If there are none near *q*.

    Notes
    -----
    Newton steps of least norm. Heights and tilts of the soles against the first one have to
    vanish; in plane the feet keep the places that *q* gives them, but for ``stance.shifts``, and
    only if there are any.
    """
    if len(stance.feet) < 2:
        return q
    put_down = q if stance.stuck_at is None else stance.stuck_at
    wanted = _in_plane(_relative(robot, stance.feet, put_down[None])[0], stance)
    start, q = q, q.copy()
    for _ in range(ROUNDS):
        around = np.vstack([q, q + _STEP * np.eye(q.size), q - _STEP * np.eye(q.size)])
        errors = _errors(_relative(robot, stance.feet, around), wanted)
        if np.abs(errors[0]).max() < CLOSED:
            return q
        n = q.size
        jacobian = (errors[1 : n + 1] - errors[n + 1 :]).T / (2.0 * _STEP)
        step = np.linalg.lstsq(jacobian, errors[0], rcond=1e-6)[0]
        q = q - step * min(1.0, _LONGEST_STEP / max(float(np.abs(step).max()), 1e-300))
        if not np.abs(q - start).max() <= _LARGEST:
            break
    raise UsageError(
        "no small change of the joint angles puts both feet flat on the floor",
        where=where,
        limit=f"{_LARGEST:g} rad (or m) per joint",
        next_step="take smaller effects, or another pose",
    )


def _relative(robot: Robot, feet: Sequence[Foot], q: Array) -> Array:
    """Return the soles of all feet but the first in that one's frame, (N, n_feet - 1, 4, 4)."""
    placements = place_links(robot.tree, q)
    first, *others = (_sole(placements, foot) for foot in feet)
    return np.stack([np.linalg.inv(first) @ other for other in others], axis=1)


def _sole(placements: Placements, foot: Foot) -> Array:
    R, p = placements.link(foot.link)
    T = np.zeros((len(p), 4, 4))
    T[:, :3, :3], T[:, :3, 3], T[:, 3, 3] = R, p, 1.0
    return T @ foot.T_link_sole


def _in_plane(T: Array, stance: Stance) -> Array:
    """Return wanted x, y, yaw of each foot in the frame of the first; NaN: any will do."""
    if stance.stuck_at is not None:
        return np.column_stack([T[:, 0, 3], T[:, 1, 3], _yaw(T)])
    moves = [stance.shifts.get(foot.name, Shift()).transform() for foot in stance.feet]
    shifted = np.linalg.inv(moves[0]) @ T @ np.stack(moves[1:])
    wanted = np.column_stack([shifted[:, 0, 3], shifted[:, 1, 3], _yaw(shifted)])
    # Legs without hip yaw can hardly keep three numbers at once: only what is shifted is held.
    if not any(shift.x or shift.y for shift in stance.shifts.values()):
        wanted[:, :2] = np.nan
    if not any(shift.yaw for shift in stance.shifts.values()):
        wanted[:, 2] = np.nan
    return wanted


def _yaw(T: Array) -> Array:
    return np.arctan2(T[..., 1, 0], T[..., 0, 0])


def _errors(T: Array, wanted: Array) -> Array:
    """Return what must vanish, shape (N, n)."""
    plane = np.stack([T[..., 0, 3], T[..., 1, 3], _yaw(T)], axis=-1) - wanted
    held = plane[..., ~np.isnan(wanted)]
    return np.concatenate([T[..., 2, 3], T[..., 0, 2], T[..., 1, 2], held], axis=-1)


def on_wedge(foot: Foot, height: float, roll: float, pitch: float) -> Foot:
    """Return a foot whose sole is raised and turned against the floor under it.

    A wedge is fastened below the sole: its lower side is what rests on the floor.

    Parameters
    ----------
    foot : Foot
    height : float
        Of the sole origin above the floor [m].
    roll, pitch : float
        Of the sole against the floor [rad].
    """
    T = transform_from(floor_rotation(roll, pitch), (0.0, 0.0, height))
    return Foot(
        foot.name,
        foot.link,
        foot.sensor,
        foot.sole,
        foot.T_link_sole @ np.linalg.inv(T),
        foot.ankle,
    )
