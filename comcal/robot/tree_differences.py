# SPDX-License-Identifier: Apache-2.0
"""Whether two URDFs describe the same mechanism, and where they differ."""

from __future__ import annotations

import numpy as np

from comcal.robot.tree import Joint, Tree

SAME_PLACE = 1e-6
"""Joint frames nearer to one another than this are the same [m], [rad]."""
_SHOWN = 5


def structure_differences(one: Tree, other: Tree) -> list[str]:
    """Return in words what makes the trees two different mechanisms; empty if nothing does.

    Parameters
    ----------
    one, other : Tree
        Compared by the names of links and joints, and by the type, ends and leaders of joints.
    """
    found: list[str] = []
    for what, a, b in (
        ("link", one.link_index, other.link_index),
        ("joint", one.joint_index, other.joint_index),
    ):
        found += _missing(what, [name for name in a if name not in b], "is not there")
        found += _missing(what, [name for name in b if name not in a], "is new")
    for joint in one.joints:
        if joint.name in other.joint_index:
            now = other.joints[other.joint_index[joint.name]]
            found += _joint_differences(joint, now)
    if not found and one.joint_names != other.joint_names:
        found.append("the joints stand in another order")
    return found


def placement_differences(one: Tree, other: Tree) -> list[str]:
    """Return the names of joints whose frame or axis differs, of two trees of one structure.

    Parameters
    ----------
    one, other : Tree
    """
    return [
        a.name
        for a, b in zip(one.joints, other.joints, strict=True)
        if np.abs(a.T_parent_joint - b.T_parent_joint).max() > SAME_PLACE
        or np.abs(a.axis - b.axis).max() > SAME_PLACE
    ]


def _missing(what: str, names: list[str], how: str) -> list[str]:
    if not names:
        return []
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    plural = "s" if len(names) > 1 else ""
    return [f"{what}{plural} {', '.join(map(repr, names[:_SHOWN]))}{more} {how}"]


def _joint_differences(before: Joint, now: Joint) -> list[str]:
    found: list[str] = []
    if before.kind is not now.kind:
        found.append(f"joint {now.name!r} is {now.kind.value}, not {before.kind.value}")
    if (before.parent, before.child) != (now.parent, now.child):
        found.append(
            f"joint {now.name!r} joins {now.parent!r} and {now.child!r}, not {before.parent!r} and "
            f"{before.child!r}"
        )
    leaders = [None if j.mimic is None else j.mimic.joint for j in (before, now)]
    if leaders[0] != leaders[1]:
        found.append(f"joint {now.name!r} mimics {leaders[1]}, not {leaders[0]}")
    return found
