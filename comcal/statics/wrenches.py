# SPDX-License-Identifier: Apache-2.0
"""Wrenches: force then moment about the origin of the frame they are expressed in."""

from __future__ import annotations

import numpy as np

from comcal.robot.frames import skew
from comcal.robot.tree import Array


def wrench_transform(R_a_b: Array, p_a_b: Array) -> Array:
    """Return the matrix that takes a wrench from frame b to frame a.

    Parameters
    ----------
    R_a_b : array, shape (..., 3, 3)
        Axes of b in a.
    p_a_b : array, shape (..., 3)
        Origin of b in a [m].

    Returns
    -------
    X : array, shape (..., 6, 6)
        ``w_a = X w_b``: the force is rotated, the moment rotated and moved by ``p x F``.

    Examples
    --------
    A force of 10 N upward, 0.2 m ahead, is a moment of -2 N m about y:

    >>> w = wrench_transform(np.eye(3), np.array([0.2, 0, 0])) @ [0, 0, 10, 0, 0, 0]
    >>> w.tolist()
    [0.0, 0.0, 10.0, 0.0, -2.0, 0.0]
    """
    X = np.zeros((*R_a_b.shape[:-2], 6, 6))
    X[..., :3, :3] = R_a_b
    X[..., 3:, 3:] = R_a_b
    X[..., 3:, :3] = skew(p_a_b) @ R_a_b
    return X
