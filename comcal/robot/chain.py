# SPDX-License-Identifier: Apache-2.0
"""The tree of a chain that is described without URDF: axes are known, lengths and masses are not.

Enough for a statically equivalent serial chain (Cotton 2008), whose link vectors are what the data
are asked for. The entry ``knee`` becomes the joint ``knee`` and the link ``knee_link`` beyond it;
the root link is ``base``.
"""

from __future__ import annotations

import numpy as np

from comcal.errors import ConfigError
from comcal.robot.locate import LocatedYaml
from comcal.robot.schema import ChainEntry
from comcal.robot.tree import Joint, JointType, Link, Tree
from comcal.robot.tree_order import depth_first
from comcal.robot.validate import did_you_mean

ROOT = "base"


def link_name(joint: str) -> str:
    """Return the name of the link beyond *joint*; of the root link for ``base``."""
    return ROOT if joint == ROOT else f"{joint}_link"


def tree_from_chain(name: str, entries: list[ChainEntry], located: LocatedYaml) -> Tree:
    """Build the tree of a chain.

    Parameters
    ----------
    name : str
        Of the robot.
    entries : list of ChainEntry
        In any order; ``parent`` names another entry, absent or ``base`` means the root.
    located : LocatedYaml
        The file, for messages.

    Returns
    -------
    Tree
        ``geometry_known`` is False; joints without limits, offsets zero; masses and CoMs NaN.

    Raises
    ------
    ConfigError
        If a name occurs twice, a parent is unknown, or the entries form a cycle.
    """
    line_of: dict[str, int] = {}
    for i, entry in enumerate(entries):
        if entry.name in line_of:
            raise ConfigError(
                f"chain entry {entry.name!r} is defined twice, first in line {line_of[entry.name]}",
                where=located.where("chain", i, "name"),
            )
        line_of[entry.name] = located.line(("chain", i))
    for i, entry in enumerate(entries):
        if entry.parent is not None and entry.parent not in {*line_of, ROOT}:
            raise ConfigError(
                f"chain entry {entry.name!r} hangs on {entry.parent!r}, which is not defined",
                where=located.where("chain", i, "parent"),
                next_step=did_you_mean(entry.parent, [*line_of, ROOT]),
            )
    joints = depth_first(ROOT, [_joint(entry) for entry in entries])
    placed = {joint.name for joint in joints}
    for i, entry in enumerate(entries):
        if entry.name not in placed:
            raise ConfigError(
                f"chain entry {entry.name!r} is part of a cycle",
                where=located.where("chain", i),
                next_step="one entry must hang on the root: leave its parent out",
            )
    links = (_link(ROOT), *(_link(joint.child) for joint in joints))
    return Tree(name, links, joints, geometry_known=False)


def _joint(entry: ChainEntry) -> Joint:
    """Return the joint of one entry, at the origin of its parent."""
    return Joint(
        entry.name,
        JointType.CONTINUOUS,
        link_name(entry.parent or ROOT),
        link_name(entry.name),
        np.eye(4),
        np.array(entry.axis),
    )


def _link(name: str) -> Link:
    """Return a link of which nothing but the name is known."""
    return Link(name, np.nan, np.full(3, np.nan), np.full((3, 3), np.nan), has_inertial=False)
