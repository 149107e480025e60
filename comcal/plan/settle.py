# SPDX-License-Identifier: Apache-2.0
"""Turn any joint angles into a pose that stands: soles flat, CoM above a wanted point.

Uniform angles are balanced in a few per cent of all cases and close a double support never. A few
Gauss-Newton steps of least motion (joints weighed by their ranges, those at a limit left out)
bring soles and CoM to where they have to be and keep what was random about the pose.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from comcal.plan.motion import SoleMotion, sole_motion
from comcal.plan.stand import Stand
from comcal.robot.tree import Array, Tree

STEPS = 25
"""Gauss-Newton steps at most; most poses need five to ten."""
CLOSED = 1e-7
"""Turn [rad] and shift [m] of a sole from its place at which a closed chain counts as closed."""
LONGEST_STEP = 0.3
"""Of a joint, in parts of its range: the equations are linear only nearby."""
DAMPING = 1e-9
UNLIMITED = np.pi
"""Range taken to either side for a joint without limits [rad] or [m]."""


@dataclass(frozen=True)
class JointBox:
    """The joint positions that a plan may use, each shape (n_joints,) [rad] or [m]."""

    lower: Array
    upper: Array

    @property
    def range(self) -> Array:
        """Width of each interval."""
        return self.upper - self.lower


def joint_box(tree: Tree, share: float = 1.0) -> JointBox:
    """Return the middle *share* of every joint's range, mimics obeyed.

    Parameters
    ----------
    tree : Tree
    share : float
        Of the range between the limits.
    """
    lower = {j.name: j.lower if np.isfinite(j.lower) else -UNLIMITED for j in tree.joints}
    upper = {j.name: j.upper if np.isfinite(j.upper) else UNLIMITED for j in tree.joints}
    for joint in tree.joints:
        if joint.mimic is not None and joint.mimic.multiplier != 0.0:
            ends = [
                (end - joint.mimic.offset) / joint.mimic.multiplier
                for end in (lower[joint.name], upper[joint.name])
            ]
            leader = joint.mimic.joint
            lower[leader] = max(lower[leader], min(ends))
            upper[leader] = min(upper[leader], max(ends))
    low = np.array([lower[name] for name in tree.joint_names])
    high = np.array([upper[name] for name in tree.joint_names])
    cut = 0.5 * (1.0 - share) * (high - low)
    return JointBox(low + cut, high - cut)


def settle(
    stand: Stand, box: JointBox, q: Array, target: Array | None
) -> tuple[Array, npt.NDArray[np.bool_]]:
    """Move N poses as little as possible until they stand.

    Parameters
    ----------
    stand : Stand
    box : JointBox
    q : array, shape (N, n_joints)
        Where to start; positions outside the box are brought to its edge.
    target : array, shape (N, 2), or None
        Wanted CoM in the floor frame [m]; a pose whose CoM is inside the margin already is left.
        None: only the chain is closed and the CoM is taken as it comes.

    Returns
    -------
    q : array, shape (N, n_joints)
    stands : array of bool, shape (N,)
        Whether the chain is closed and, with a target, the CoM keeps the margin.
    """
    q = np.clip(q, box.lower, box.upper)
    stands = np.zeros(len(q), np.bool_)
    open_ = np.arange(len(q))
    for _ in range(STEPS):
        at = sole_motion(stand.robot, stand.feet[0], q[open_])
        closure, com = stand.closure_error(at), at.com()
        closed = np.max(np.abs(closure), axis=1, initial=0.0) < CLOSED
        balanced = stand.inside_by(com) >= stand.margin
        done = closed if target is None else closed & balanced
        stands[open_[done]] = True
        left = ~done
        if not left.any():
            break
        error, J = -closure, stand.closure_jacobian(at)
        if target is not None:
            to_point = np.where(balanced[:, None], 0.0, target[open_] - com[:, :2])
            error = np.concatenate([error, to_point], axis=1)
            J = np.concatenate([J, at.com_jacobian()[:, :2]], axis=1)
        open_ = open_[left]
        q[open_] = _stepped(box, q[open_], error[left], J[left])
    return q, stands


def _stepped(box: JointBox, q: Array, error: Array, J: Array) -> Array:
    """Make the step of least weighted motion that mends *error*, within the box."""
    weight = np.broadcast_to(box.range**2, q.shape).copy()
    dq = _least_motion(weight, error, J)
    outward = ((q <= box.lower) & (dq < 0.0)) | ((q >= box.upper) & (dq > 0.0))
    if outward.any():
        dq = _least_motion(np.where(outward, 0.0, weight), error, J)
    longest = np.max(np.abs(dq) / np.where(box.range > 0.0, box.range, 1.0), axis=1, keepdims=True)
    dq *= np.minimum(1.0, LONGEST_STEP / np.maximum(longest, 1e-12))
    return np.clip(q + dq, box.lower, box.upper)


def _least_motion(weight: Array, error: Array, J: Array) -> Array:
    WJt = weight[:, :, None] * np.swapaxes(J, 1, 2)
    A = J @ WJt
    size = np.einsum("nii->n", A) / A.shape[1]
    A = A + (DAMPING * size + 1e-15)[:, None, None] * np.eye(A.shape[1])
    return (WJt @ np.linalg.solve(A, error[:, :, None]))[:, :, 0]


def com_of(stand: Stand, q: Array) -> Array:
    """Return the CoM of N poses in the floor frame, shape (N, 3) [m]."""
    return _at(stand, q).com()


def _at(stand: Stand, q: Array) -> SoleMotion:
    return sole_motion(stand.robot, stand.feet[0], q)
