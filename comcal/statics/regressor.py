# SPDX-License-Identifier: Apache-2.0
r"""Static rows of any tree: wrench and joint torques, linear in masses and first moments.

At rest the support carries the weights, and every joint carries what lies beyond it. With G = g
times the direction up, the row of any of these loads for the body b, per :math:`(m, h_x, h_y,
h_z)`, is one four-vector times the body's frame in the frame of the root link,

.. math::

   [\,w,\; u^T\,] \begin{bmatrix} 1 & 0 \\ p_b & R_b \end{bmatrix}, \qquad
   (u, w) = \begin{cases}
   (0,\; G_i) & \text{force along axis } i\\
   (G \times e_i,\; 0) & \text{moment about axis } i \text{ of the root}\\
   (G \times a,\; -(G \times a) \cdot o) & \text{torque of a joint turning about } a
     \text{ through } o\\
   (0,\; G \cdot a) & \text{force of a joint sliding along } a
   \end{cases}

and zero for bodies that do not hang on the joint. So the rows of a limb are one small matrix
product per pose.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from comcal.errors import ConfigError, DataError
from comcal.robot.bodies import Bodies, place_bodies
from comcal.robot.tree import Array, Tree

WRENCH = slice(0, 6)
"""Rows of the wrench of the support on the robot: force, then moment about the root origin."""
TORQUES = slice(6, None)
"""Rows of the joint torques, in the order of ``tree.joint_names``."""

_UNIT = 1e-9
_BLOCK = 1024
"""Poses placed before their rows are written: enough to hide the cost of a call."""
_CACHED = 1 << 22
"""Size of the rows finished before going on [bytes]: the last-level cache holds them."""


def static_regressor(
    tree: Tree,
    q: npt.ArrayLike,
    up: npt.ArrayLike,
    gravity: float = 9.81,
    *,
    out: Array | None = None,
) -> Array:
    """Return the rows that give wrench and joint torques of N poses at rest.

    Parameters
    ----------
    tree : Tree
        Its masses are not used. ``tree.bodies`` says which links make one body.
    q : array, shape (N, n_joints)
        Joint positions [rad] or [m], in the order of ``tree.joint_names``.
    up : array, shape (3,) or (N, 3)
        Unit vector against gravity in the root frame.
    gravity : float
        [m/s^2].
    out : array, shape (N, 6 + n_joints, 4 n_bodies), optional
        Where to write; C-contiguous.

    Returns
    -------
    rows : array, shape (N, 6 + n_joints, 4 n_bodies)
        Times ``tree.bodies.moments.ravel()``: the wrench of the support (whatever it is) on the
        robot, force [N] and moment about the root origin [N m] in the root frame; then torque [N m]
        or force [N] of parent on child about or along +axis of every independent joint, those of
        joints that mimic it folded in by virtual work. The torques are those of the free end: of
        a joint between the root and a loaded foot, the support's share has to be subtracted.
        Columns are named by ``tree.bodies.labels``.

    Raises
    ------
    ConfigError
        If lengths are unknown (chains without URDF).
    DataError
        If *up* is not a unit vector per pose, or *out* is not the array described.

    Examples
    --------
    A pendulum held level, 2 kg 0.5 m out along x: it would fall about +y and is held about -y.

    >>> from comcal.robot.tree import Joint, JointType, Link, Tree
    >>> base = Link("base", 0.0, np.zeros(3), np.eye(3))
    >>> rod = Link("rod", 2.0, np.array([0.5, 0.0, 0.0]), np.eye(3))
    >>> hinge = Joint("hinge", JointType.REVOLUTE, "base", "rod", np.eye(4), np.eye(3)[1])
    >>> tree = Tree("pendulum", (base, rod), (hinge,))
    >>> rows = static_regressor(tree, [[0.0]], [0.0, 0.0, 1.0])
    >>> (rows @ tree.bodies.moments.ravel())[0, 6].round(6).item()
    -9.81
    """
    q = np.atleast_2d(np.asarray(q, dtype=np.float64))
    if not tree.geometry_known:
        raise ConfigError(
            "the lengths of the links are not known, so static rows cannot be computed",
            where=tree.name,
            next_step="give a URDF, or use the statically equivalent chain",
        )
    bodies = tree.bodies
    G = gravity * _checked_up(up, len(q))
    shape = (len(q), 6 + len(tree.joint_names), 4 * len(bodies))
    if out is None:
        out = np.empty(shape)
    elif out.shape != shape or out.dtype != np.float64 or not out.flags.c_contiguous:
        raise DataError(
            "the buffer for the static rows does not fit",
            where="out",
            measured=f"{out.dtype} {out.shape}",
            limit=f"C-contiguous float64 {shape}",
            next_step="leave out, or np.empty of that shape",
        )
    for start in range(0, len(q), _BLOCK):
        block = slice(start, start + _BLOCK)
        _write(bodies, q[block], G[block], out[block])
    return out


def _checked_up(up: npt.ArrayLike, n: int) -> Array:
    """Return *up* for each of n poses, shape (n, 3)."""
    up = np.asarray(up, dtype=np.float64)
    if up.shape not in ((3,), (n, 3)):
        raise DataError(
            "the direction up has the wrong shape",
            where="up",
            measured=str(up.shape),
            limit=f"(3,) or ({n}, 3)",
        )
    up = np.broadcast_to(up, (n, 3))
    length = np.linalg.norm(up, axis=1)
    wrong = np.flatnonzero(~(np.abs(length - 1.0) < _UNIT))
    if wrong.size:
        raise DataError(
            "the direction up is not a unit vector",
            where=f"pose number {wrong[0]}",
            measured=f"length {length[wrong[0]]:g}",
            limit="1",
            next_step="divide it by its length",
        )
    return up


def _write(bodies: Bodies, q: Array, G: Array, out: Array) -> None:
    """Write the rows of one block of poses."""
    placed = place_bodies(bodies, q)
    loads = _load_vectors(bodies, placed, G)
    step = max(1, _CACHED // out[0].nbytes)
    frames = np.empty((min(step, len(q)), 4, len(bodies), 4))
    frames[:, 0] = (1.0, 0.0, 0.0, 0.0)
    for start in range(0, len(q), step):
        some = slice(start, start + step)
        rows, g = out[some], G[some]
        frame = frames[: len(rows)]
        frame[:, 1:] = placed[..., some].transpose(3, 2, 0, 1)
        load = np.ascontiguousarray(loads[..., some].transpose(2, 1, 0))
        _write_rows(bodies, frame.reshape(len(rows), 4, -1), load, g, rows)


def _write_rows(bodies: Bodies, frame: Array, load: Array, G: Array, rows: Array) -> None:
    """Write the rows of a few poses, *frame* and *load* being the factors of the module's notes."""
    rows.fill(0.0)
    rows[:, :3, ::4] = G[:, :, None]
    turned = np.zeros((len(G), 3, 4))  # (0, G x e_i)
    turned[:, 0, 2], turned[:, 0, 3] = G[:, 2], -G[:, 1]
    turned[:, 1, 1], turned[:, 1, 3] = -G[:, 2], G[:, 0]
    turned[:, 2, 1], turned[:, 2, 2] = G[:, 1], -G[:, 0]
    np.matmul(turned, frame, out=rows[:, 3:6])
    for limb in bodies.limbs:
        torques = rows[:, TORQUES][:, limb.columns, limb.unknowns]
        if limb.follows:
            torques += load[:, limb.joints] @ frame[..., limb.unknowns]
            continue
        np.matmul(load[:, limb.joints], frame[..., limb.unknowns], out=torques)
        for joint, gap in limb.gaps:
            torques[:, joint, gap] = 0.0


def _load_vectors(bodies: Bodies, placed: Array, G: Array) -> Array:
    """Return ``(w, u)`` of every moving joint, those that mimic scaled, (4, n_bodies - 1, N)."""
    n, n_moving = len(G), len(bodies) - 1
    loads = np.empty((4, n_moving, n))
    if n_moving == 0:
        return loads
    w, u = loads[0], loads[1:]
    # The joint's axis is the same in the body's frame before and after it turns.
    axes = np.matmul(bodies.axes[:, None], placed[1:, 1:].reshape(n_moving, 3, -1))
    a = axes.reshape(n_moving, 3, n).transpose(1, 0, 2)
    g = G.T.copy()
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        np.multiply(g[j], a[k], out=u[i])
        u[i] -= g[k] * a[j]
    np.einsum("cjn,jcn->jn", u, placed[1:, 0], out=w)
    np.negative(w, out=w)
    slides = bodies.slides
    if slides.any():
        u[:, slides] = 0.0
        w[slides] = np.einsum("cn,cjn->jn", g, a[:, slides])
    if bodies.follows.any():
        loads *= bodies.multipliers[:, None]
    return loads
