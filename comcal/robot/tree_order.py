# SPDX-License-Identifier: Apache-2.0
"""The order in which a tree lists its joints."""

from __future__ import annotations

from collections.abc import Iterable

from comcal.robot.tree import Joint


def depth_first(root: str, joints: Iterable[Joint]) -> tuple[Joint, ...]:
    """Return the joints reachable from *root*, parents before children, limb after limb.

    Parameters
    ----------
    root : str
        Name of the root link.
    joints : iterable of Joint
        Each link the child of at most one of them; the children of one link keep this order.

    Returns
    -------
    tuple of Joint
        Fewer than given when some are not reachable, that is, when they form a cycle.
    """
    below: dict[str, list[Joint]] = {}
    for joint in joints:
        below.setdefault(joint.parent, []).append(joint)
    ordered: list[Joint] = []
    waiting = below.get(root, [])[::-1]
    while waiting:
        joint = waiting.pop()
        ordered.append(joint)
        waiting.extend(reversed(below.get(joint.child, [])))
    return tuple(ordered)
