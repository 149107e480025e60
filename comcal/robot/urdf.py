# SPDX-License-Identifier: Apache-2.0
"""From a URDF file to the kinematic tree.

Order of links and joints: depth first from the root, the children of one link in the order in which
their ``<joint>`` elements stand in the file. So the joints of a limb are neighbours, parents come
before children, and the same file always gives the same order of ``q``.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from difflib import get_close_matches
from pathlib import Path

import numpy as np

from comcal.robot.tree import Joint, JointType, Link, Mimic, Tree
from comcal.robot.tree_order import depth_first
from comcal.robot.units import LARGEST
from comcal.robot.urdf_links import read_link
from comcal.robot.urdf_xml import Element, UrdfXml, parse_xml, read_xml

_KINDS = {kind.value: kind for kind in JointType}
_FREE = "floating"
_SMALLEST_AXIS = 1e-6


def read_urdf(path: str | os.PathLike[str]) -> Tree:
    """Read a URDF file into a kinematic tree.

    Joints may be fixed, revolute, continuous or prismatic, and may mimic one another (chains of
    mimics are resolved to the independent joint). A ``floating`` joint is understood only between
    a massless root link and its single child: the root is then dropped, because where the base is
    in the world is not part of the tree. A ``fixed`` joint from an empty ``world`` link is kept.

    Parameters
    ----------
    path : path-like

    Returns
    -------
    Tree
        In SI; see the module for the order. Limits not given are infinite; axes are unit vectors.

    Raises
    ------
    UrdfError
        If the file is missing, is not XML, or does not describe one tree; with file and line.
    """
    return _tree(read_xml(Path(path)))


def parse_urdf(raw: bytes, name: str) -> Tree:
    """Read a URDF that is not on disk, such as one about to be written.

    Parameters
    ----------
    raw : bytes
    name : str
        What the file is called in messages.

    Returns
    -------
    Tree
        As :func:`read_urdf` returns it.

    Raises
    ------
    UrdfError
        As of :func:`read_urdf`.
    """
    return _tree(parse_xml(raw, name))


def _tree(xml: UrdfXml) -> Tree:
    """Return the tree that the XML describes."""
    links = {name: read_link(xml, name, element) for name, element in xml.named("link")}
    if not links:
        raise xml.error(xml.root, "the robot has no links")
    elements = dict(xml.named("joint"))
    ends = {name: _read_ends(xml, element, links) for name, element in elements.items()}
    _drop_floating_root(xml, elements, ends, links)
    joints = {name: _read_joint(xml, name, elements[name], *ends[name]) for name in elements}
    joints = {name: _resolve_mimic(xml, joint, joints, elements) for name, joint in joints.items()}
    root = _find_root(xml, elements, joints, links)
    ordered = depth_first(root, joints.values())
    if len(ordered) < len(joints):
        placed = {joint.name for joint in ordered}
        lost = next(name for name in joints if name not in placed)
        raise xml.error(elements[lost], f"joint {lost!r} is part of a cycle")
    return Tree(
        name=(xml.root.get("name") or "robot").strip(),
        links=(links[root], *(links[joint.child] for joint in ordered)),
        joints=ordered,
        notes=tuple(dict.fromkeys(xml.notes)),
    )


def _read_ends(xml: UrdfXml, element: Element, links: Mapping[str, Link]) -> tuple[str, str]:
    """Return the parent and child link of a ``<joint>``; both must exist."""
    names: list[str] = []
    for tag in ("parent", "child"):
        end = xml.required_child(element, tag)
        link = xml.text(end, "link")
        if link not in links:
            raise xml.error(
                end, f"{tag} link {link!r} is not defined", next_step=_meant(link, links)
            )
        names.append(link)
    return names[0], names[1]


def _drop_floating_root(
    xml: UrdfXml,
    elements: dict[str, Element],
    ends: Mapping[str, tuple[str, str]],
    links: dict[str, Link],
) -> None:
    """Remove a massless root link and the floating joint below it, in place."""
    children = {child for _, child in ends.values()}
    for name in [n for n, e in elements.items() if e.get("type") == _FREE]:
        element, (parent, _) = elements[name], ends[name]
        siblings = [n for n, e in ends.items() if e[0] == parent]
        why = ""
        if parent in children:
            why = "its parent is not the root"
        elif links[parent].mass != 0.0:
            why = f"the root link {parent!r} has mass"
        elif len(siblings) > 1:
            why = f"the root link {parent!r} has other children too"
        if why:
            raise xml.error(
                element,
                f"joint {name!r} is floating, and {why}",
                next_step="a floating joint may only hang the whole robot on a massless world link",
            )
        del elements[name], links[parent]


def _read_joint(xml: UrdfXml, name: str, element: Element, parent: str, child: str) -> Joint:
    """Read one ``<joint>`` whose ends are known."""
    kind_name = xml.text(element, "type")
    kind = _KINDS.get(kind_name)
    if kind is None:
        raise xml.error(
            element,
            f"joint {name!r} is of type {kind_name!r}",
            next_step=f"possible are {', '.join(_KINDS)}"
            + (" (planar needs three joints in a row)" if kind_name == "planar" else ""),
        )
    T_parent_joint = xml.origin(element)
    if kind is JointType.FIXED:
        return Joint(name, kind, parent, child, T_parent_joint, np.zeros(3))
    axis_element = xml.first_child(element, "axis")
    axis = np.array([1.0, 0.0, 0.0])
    if axis_element is not None:
        xml.expect_attributes(axis_element, ("xyz",))
        axis = xml.vector(axis_element, "xyz", (1.0, 0.0, 0.0))
    length = float(np.linalg.norm(axis))
    if length < _SMALLEST_AXIS:
        raise xml.error(
            element if axis_element is None else axis_element,
            f"the axis of joint {name!r} is zero",
            next_step="a joint that cannot move is type='fixed'",
        )
    limit = xml.first_child(element, "limit")
    lower, upper, effort = -np.inf, np.inf, np.inf
    if limit is not None:
        effort = xml.number(limit, "effort", effort, endless=True)
    if limit is not None and kind is not JointType.CONTINUOUS:
        lower = xml.number(limit, "lower", lower, endless=True)
        upper = xml.number(limit, "upper", upper, endless=True)
    return Joint(
        name, kind, parent, child, T_parent_joint, axis / length, lower, upper, effort,
        _read_mimic(xml, element),
    )  # fmt: skip


def _read_mimic(xml: UrdfXml, element: Element) -> Mimic | None:
    """Return ``<mimic>`` of a joint as written, before chains are resolved."""
    mimic = xml.first_child(element, "mimic")
    if mimic is None:
        return None
    xml.expect_attributes(mimic, ("joint", "multiplier", "offset"))
    multiplier, offset = xml.number(mimic, "multiplier", 1.0), xml.number(mimic, "offset", 0.0)
    return Mimic(xml.text(mimic, "joint"), multiplier, offset)


def _resolve_mimic(
    xml: UrdfXml, joint: Joint, joints: Mapping[str, Joint], elements: Mapping[str, Element]
) -> Joint:
    """Return *joint* mimicking an independent joint: q = a q1 + b, q1 = c q2 + d, and so on."""
    if joint.mimic is None:
        return joint
    element = xml.required_child(elements[joint.name], "mimic")
    multiplier, offset = 1.0, 0.0
    seen = [joint.name]
    followed = joint
    while followed.mimic is not None:
        offset += multiplier * followed.mimic.offset
        multiplier *= followed.mimic.multiplier
        leader = followed.mimic.joint
        if leader not in joints or not joints[leader].is_movable:
            state = "fixed" if leader in joints else "not defined"
            raise xml.error(
                element,
                f"joint {joint.name!r} mimics {leader!r}, which is {state}",
                next_step=_meant(leader, [j.name for j in joints.values() if j.is_movable]),
            )
        if leader in seen:
            raise xml.error(element, f"joint {joint.name!r} mimics itself: {' -> '.join(seen)}")
        seen.append(leader)
        followed = joints[leader]
    if not (abs(multiplier) <= LARGEST and abs(offset) <= LARGEST):
        raise xml.error(element, f"joint {joint.name!r} mimics by a factor too large to be real")
    return replace(joint, mimic=Mimic(followed.name, multiplier, offset))


def _find_root(
    xml: UrdfXml,
    elements: Mapping[str, Element],
    joints: Mapping[str, Joint],
    links: Mapping[str, Link],
) -> str:
    """Return the one link that is nobody's child."""
    holder: dict[str, str] = {}
    for name, joint in joints.items():
        if joint.child in holder:
            raise xml.error(
                elements[name],
                f"link {joint.child!r} is the child of joint {name!r}"
                f" and of joint {holder[joint.child]!r}",
                next_step="a closed chain is not a tree: cut it open at one joint",
            )
        holder[joint.child] = name
    roots = [name for name in links if name not in holder]
    if not roots:
        raise xml.error(xml.root, "there is no root link: the joints form a cycle")
    if len(roots) > 1:
        second = next(element for name, element in xml.named("link") if name == roots[1])
        raise xml.error(
            second,
            f"there are {len(roots)} root links: {', '.join(roots[:5])}",
            next_step="join them by fixed joints, or remove links that belong to no joint",
        )
    return roots[0]


def _meant(name: str, known: Mapping[str, Link] | list[str]) -> str:
    """Return the suggestion of the nearest known name."""
    close = get_close_matches(name, list(known), n=1)
    return f"did you mean {close[0]!r}?" if close else ""
