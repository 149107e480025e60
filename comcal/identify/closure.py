# SPDX-License-Identifier: Apache-2.0
"""Closure of poses on both feet: the loop through both legs makes the soles parallel."""

from __future__ import annotations

from math import nan

import numpy as np
import numpy.typing as npt
from scipy.special import chdtrc

from comcal.errors import ConfigError
from comcal.identify.conventions import Closure, Convention, Conventions
from comcal.robot.kinematics import place_links
from comcal.robot.tree import Array, Tree


def on_both_feet(
    tree: Tree, closure: Closure | None, convention: Convention, q: Array
) -> npt.NDArray[np.bool_]:
    """Return which poses stand on both feet: no joint between the feet is bent much.

    Parameters
    ----------
    tree : Tree
    closure : Closure or None
        None: no pose is known to.
    convention : Convention
    q : array, shape (N, n_joints)
        Columns of the table [rad] or [m].

    Returns
    -------
    array of bool, shape (N,)
    """
    if closure is None:
        return np.zeros(len(q), dtype=np.bool_)
    bent = np.abs(convention.joint_positions(q)[:, _path(tree, closure.link)])
    return np.all(bent <= closure.two_feet_below, axis=1)


def feet_gap(
    tree: Tree, conventions: Conventions, convention: Convention, q: Array
) -> tuple[float, float]:
    """Return how far the feet are from parallel in the poses that stand on both.

    Returns
    -------
    rms : float
        Angle between the feet [rad].
    p : float
        How often angles with the stated scatter and rounding would make gaps as large. Both are
        NaN where no pose stands on both feet.
    """
    closure = conventions.closure
    both = on_both_feet(tree, closure, convention, q)
    if closure is None or not bool(both.any()):
        return nan, nan
    turned = place_links(tree, convention.joint_positions(q[both])).link(closure.link)[0]
    flat = place_links(tree, np.zeros(q.shape[1])).link(closure.link)[0]
    gap = _angle_between(turned, flat)
    per_joint = closure.scatter**2 + conventions.rounding.angle**2 / 3.0
    variance = per_joint * len(_path(tree, closure.link))
    p = float(chdtrc(int(both.sum()), float(np.sum(gap**2)) / variance)) if variance else nan
    return float(np.sqrt(np.mean(gap**2))), p


def _path(tree: Tree, link: str) -> list[int]:
    """Return the columns of q of the joints between the root and *link*."""
    if link not in tree.link_index:
        raise ConfigError(
            f"the closure names a link {link!r} that the chain does not have",
            where=tree.name,
            next_step=f"the links are {', '.join(tree.link_index)}",
        )
    above = tree.descendants[:, tree.link_index[link]]
    return [i for i, n in enumerate(tree.joint_names) if above[tree.joint_index[n] + 1]]


def _angle_between(R_a: Array, R_b: Array) -> Array:
    """Return the angle of the rotation from each ``R_b`` to ``R_a`` [rad]."""
    sine = np.linalg.norm(R_a - R_b, axis=(-2, -1)) / np.sqrt(8.0)
    return 2.0 * np.arcsin(np.clip(sine, 0.0, 1.0))
