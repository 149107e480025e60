# SPDX-License-Identifier: Apache-2.0
"""What a robot stands on in one kind of support: the soles, their places, their polygon."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull

from comcal.errors import ConfigError
from comcal.measure.plan import NONE
from comcal.plan.motion import SoleMotion, sole_motion
from comcal.robot.model import Robot
from comcal.robot.tree import Array
from comcal.statics.support import standing_feet


@dataclass(frozen=True)
class Stand:
    """Where the standing soles are, in the frame of the first of them (the floor frame).

    Parameters
    ----------
    robot : Robot
    support : str
        ``double`` or the name of a foot.
    feet : tuple of str
        Standing feet; the sole of the first one is the floor frame.
    R, p : array, shape (n_feet, 3, 3) and (n_feet, 3)
        Where every standing sole has to be: coplanar and parallel, otherwise as at q = 0 [m].
    edges : array, shape (n_edges, 3)
        Support polygon: a point (x, y) is inside where ``edges @ (x, y, 1) <= 0`` [m].
    margin : float
        Distance that the CoM has to keep from every edge [m].
    """

    robot: Robot
    support: str
    feet: tuple[str, ...]
    R: Array
    p: Array
    edges: Array
    margin: float

    def inside_by(self, com: Array) -> Array:
        """Return how far CoMs (N, 3) in the floor frame are inside the polygon, (N,) [m]."""
        return -np.max(com[:, :2] @ self.edges[:, :2].T + self.edges[:, 2], axis=1)

    def closure_error(self, at: SoleMotion) -> Array:
        """Return turn [rad] and shift [m] of the other soles from their places, (N, 6 (n - 1))."""
        parts = [np.zeros((len(at.axis), 0))]
        for foot, R, p in zip(self.feet[1:], self.R[1:], self.p[1:], strict=True):
            R_is, p_is = at.relative_sole(foot)
            parts += [rotation_vector(R_is @ R.T), p_is - p]
        return np.concatenate(parts, axis=1)

    def closure_jacobian(self, at: SoleMotion) -> Array:
        """Return d(closure error)/dq near zero error, shape (N, 6 (n - 1), n_joints)."""
        n, n_joints = len(at.axis), at.motion.drive.shape[1]
        parts = [np.zeros((n, 0, n_joints))]
        parts += [at.relative_sole_jacobian(foot) for foot in self.feet[1:]]
        return np.concatenate(parts, axis=1)

    def random_points(self, rng: np.random.Generator, n: int) -> Array:
        """Return points uniform in the polygon less its margin, shape (n, 2) [m]."""
        corners = self.corners()
        low, high = corners.min(axis=0), corners.max(axis=0)
        found = np.zeros((0, 2))
        while len(found) < n:
            drawn = rng.uniform(low, high, (4 * n, 2))
            inside = self.inside_by(np.column_stack([drawn, np.zeros(len(drawn))])) >= self.margin
            found = np.concatenate([found, drawn[inside]])
        return found[:n]

    def closing_links(self) -> npt.NDArray[np.bool_]:
        """Return the links that move when the closed chain closes, shape (n_links,)."""
        tree = self.robot.tree
        moved = np.zeros(len(tree.links), np.bool_)
        if len(self.feet) > 1:
            feet = [tree.link_index[self.robot.feet[foot].link] for foot in self.feet]
            above = tree.descendants[:, feet]
            # Links beyond a joint that lies between some feet but not above all of them.
            moved = above.any(axis=1) & ~above.all(axis=1)
            moved |= tree.descendants[moved].any(axis=0)
        return np.asarray(moved, np.bool_)

    def corners(self) -> Array:
        """Return the corners of all standing soles in the floor frame, shape (k, 2) [m]."""
        return np.concatenate(
            [
                np.column_stack([_sole(self.robot, f), np.zeros(len(_sole(self.robot, f)))]) @ R.T
                + p
                for f, R, p in zip(self.feet, self.R, self.p, strict=True)
            ]
        )[:, :2]


def stand_of(robot: Robot, support: str, margin: float) -> Stand:
    """Return what *robot* stands on in *support*.

    Raises
    ------
    ConfigError
        If the support is hanging or unknown, a sole is not known, or no point of the polygon keeps
        the margin.
    """
    if support == NONE:
        raise ConfigError(
            "hanging poses are not planned",
            where="--support none",
            next_step=f"supports of this robot: double, {', '.join(robot.feet)}",
        )
    feet = standing_feet(robot, support)
    zero = sole_motion(robot, feet[0], np.zeros((1, len(robot.tree.joint_names))))
    R, p = [np.eye(3)], [np.zeros(3)]
    for foot in feet[1:]:
        R_is, p_is = zero.relative_sole(foot)
        yaw = float(np.arctan2(R_is[0, 1, 0], R_is[0, 0, 0]))
        c, s = np.cos(yaw), np.sin(yaw)
        R.append(np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]))
        p.append(p_is[0] * [1.0, 1.0, 0.0])
    flat = Stand(robot, support, feet, np.array(R), np.array(p), np.zeros((0, 3)), margin)
    edges = np.asarray(ConvexHull(flat.corners()).equations, np.float64)
    stand = Stand(robot, support, feet, flat.R, flat.p, edges, margin)
    _check_room(stand)
    return stand


def rotation_vector(R: Array) -> Array:
    """Return axis times angle of rotations (N, 3, 3), shape (N, 3) [rad]."""
    v = 0.5 * np.stack(
        [R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]], axis=-1
    )
    sine = np.linalg.norm(v, axis=-1, keepdims=True)
    cosine = 0.5 * (np.einsum("nii->n", R)[:, None] - 1.0)
    angle = np.arctan2(sine, cosine)
    return v * np.divide(angle, sine, out=np.ones_like(sine), where=sine > 1e-12)


def _sole(robot: Robot, foot: str) -> Array:
    sole = robot.feet[foot].sole
    if sole is None:
        raise ConfigError(
            f"the outline of the sole of foot {foot!r} is not known, so balance cannot be planned",
            where=str(robot.yaml_path or robot.name),
            next_step=f"give feet.{foot}.sole, its corners in the sole frame",
        )
    return sole


def _check_room(stand: Stand) -> None:
    """Refuse a margin that leaves nothing of the polygon: the inscribed circle decides."""
    corners = stand.corners()
    low, high = corners.min(axis=0), corners.max(axis=0)
    grid = np.stack(np.meshgrid(*np.linspace(low, high, 101).T), axis=-1).reshape(-1, 2)
    room = float(stand.inside_by(np.column_stack([grid, np.zeros(len(grid))])).max())
    if room <= stand.margin:
        raise ConfigError(
            f"no point of the soles keeps the balance margin in support {stand.support!r}",
            where=str(stand.robot.yaml_path or stand.robot.name),
            measured=f"the most inner point is {room * 1e3:.1f} mm from an edge",
            limit=f"{stand.margin * 1e3:.1f} mm",
            next_step="give a smaller --margin, or correct feet.*.sole",
        )
