# SPDX-License-Identifier: Apache-2.0
"""Writing new masses, CoMs and joint origins into a URDF without touching anything else.

Numbers are replaced where they stand (:mod:`comcal.robot.urdf_bytes`). Comments, CDATA and
elements elsewhere than directly in a link or joint of the robot are never looked into.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from comcal.errors import ComcalError, UrdfError
from comcal.robot.frames import rotation_from_rpy
from comcal.robot.tree import Array, Link, Tree
from comcal.robot.urdf import parse_urdf
from comcal.robot.urdf_bytes import (
    LENGTH_STEP,
    Replacement,
    attributes,
    new_origin,
    replaced,
    walk_tags,
)

DIGITS = 9
"""Significant digits of masses and moments of inertia."""

_CHILDREN = ("origin", "mass", "inertia")
_MOMENTS = {
    "ixx": (0, 0),
    "ixy": (0, 1),
    "ixz": (0, 2),
    "iyy": (1, 1),
    "iyz": (1, 2),
    "izz": (2, 2),
}


@dataclass(frozen=True)
class InertialEdit:
    """What is to change in the ``<inertial>`` of one link.

    Parameters
    ----------
    link : str
    com : tuple of float or None, length 3
        New CoM in the link frame [m]; None keeps what is written.
    factor : float
        Mass and moments of inertia are multiplied by it: the same body, denser. At 1 they keep
        what is written.
    joined : tuple of (float, array of shape (3, 3)), optional
        Mass [kg] and moments of inertia, about the CoM and in the axes of the link [kg m^2], that
        a body joined to the link adds to that.
    """

    link: str
    com: tuple[float | None, float | None, float | None] = (None, None, None)
    factor: float = 1.0
    joined: tuple[float, Array] | None = None


@dataclass(frozen=True)
class OriginEdit:
    """How far the ``<origin>`` of one joint is to move, in the frame of its parent link [m]."""

    joint: str
    shift: tuple[float, float, float]


@dataclass
class _Element:
    """Offsets of the start tag of an element and of its first children."""

    start: int
    children: dict[str, int] = field(default_factory=dict[str, int])


def write_inertials(raw: bytes, name: str, edits: Sequence[InertialEdit]) -> bytes:
    """Return a URDF with other inertials, every other byte as it was.

    The rotation of an inertial's ``<origin>`` stays. Where there is no ``<origin>``, or one without
    ``xyz``, it is added. The result is read back and compared.

    Parameters
    ----------
    raw : bytes
        The file, in an encoding that contains ASCII.
    name : str
        Of the file, for messages.
    edits : sequence of InertialEdit
        At most one per link.

    Returns
    -------
    bytes

    Raises
    ------
    UrdfError
        If the URDF cannot be read, or a link to be edited is not there or has no ``<inertial>``:
        none is ever invented.
    ComcalError
        If the result, read back, is not what was asked for.
    """
    before = parse_urdf(raw, name)
    found = _find_inertials(raw, name)
    replacements: list[Replacement] = []
    for edit in edits:
        if edit.link not in found:
            raise UrdfError(
                f"link {edit.link!r} has no <inertial> that could be changed",
                where=name,
                next_step="give the link an <inertial>, or join it to one that has",
            )
        replacements += _replacements(raw, found[edit.link], edit)
    new = replaced(raw, replacements)
    _check(before, parse_urdf(new, name), edits, name)
    return new


def write_origins(raw: bytes, name: str, edits: Sequence[OriginEdit]) -> bytes:
    """Return a URDF with other joint origins, every other byte as it was.

    Parameters
    ----------
    raw : bytes
    name : str
        Of the file, for messages.
    edits : sequence of OriginEdit

    Raises
    ------
    UrdfError
        If the URDF cannot be read, or has no such joint.
    ComcalError
        If the result, read back, is not what was asked for.
    """
    before = parse_urdf(raw, name)
    found = _find_joints(raw, name)
    shifts: dict[str, Array] = {}
    for edit in edits:
        if edit.joint not in found:
            raise UrdfError(f"there is no joint {edit.joint!r}", where=name)
        shifts[edit.joint] = shifts.get(edit.joint, np.zeros(3)) + edit.shift
    wanted = {
        joint.name: joint.T_parent_joint[:3, 3] + shifts.get(joint.name, np.zeros(3))
        for joint in before.joints
    }
    replacements: list[Replacement] = []
    for joint in shifts:
        at = found[joint]
        xyz = wanted[joint].tolist()
        replacements += new_origin(raw, at.start, at.children.get("origin"), xyz)
    new = replaced(raw, replacements)
    after = {joint.name: joint.T_parent_joint[:3, 3] for joint in parse_urdf(new, name).joints}
    if not all(np.abs(after[j] - xyz).max() <= LENGTH_STEP for j, xyz in wanted.items()):
        raise _not_as_meant(name)
    return new


def _find_inertials(raw: bytes, name: str) -> Mapping[str, _Element]:
    """Return where the first ``<inertial>`` of every link of the robot stands."""
    found: dict[str, _Element] = {}

    def on_tag(tags: Sequence[str], names: Sequence[str], starts: Sequence[int], here: int) -> None:
        if list(tags) == ["robot", "link", "inertial"]:
            _ = found.setdefault(names[1], _Element(here))
        elif list(tags[:-1]) == ["robot", "link", "inertial"] and tags[-1] in _CHILDREN:
            inertial = found[names[1]]
            if inertial.start == starts[-1]:
                _ = inertial.children.setdefault(tags[-1], here)

    walk_tags(raw, name, on_tag)
    return found


def _find_joints(raw: bytes, name: str) -> Mapping[str, _Element]:
    """Return where every joint of the robot stands, and its ``<origin>``."""
    found: dict[str, _Element] = {}

    def on_tag(tags: Sequence[str], names: Sequence[str], starts: Sequence[int], here: int) -> None:
        if list(tags) == ["robot", "joint"]:
            _ = found.setdefault(names[1], _Element(here))
        elif list(tags) == ["robot", "joint", "origin"] and found[names[1]].start == starts[-1]:
            _ = found[names[1]].children.setdefault("origin", here)

    walk_tags(raw, name, on_tag)
    return found


def _replacements(raw: bytes, inertial: _Element, edit: InertialEdit) -> Iterable[Replacement]:
    """Yield what changes in one ``<inertial>``."""
    origin = inertial.children.get("origin")
    if any(value is not None for value in edit.com):
        yield from new_origin(raw, inertial.start, origin, edit.com)
    if edit.factor == 1.0 and edit.joined is None:
        return
    more, moments = edit.joined or (0.0, np.zeros((3, 3)))
    R = _rotation(raw, origin)
    added = {name: float((R.T @ moments @ R)[at]) for name, at in _MOMENTS.items()}
    for tag, more_of in (("mass", {"value": more}), ("inertia", added)):
        if tag not in inertial.children:
            continue
        spans = attributes(raw, inertial.children[tag])
        for attribute, summand in more_of.items():
            if attribute in spans:
                start, end = spans[attribute]
                value = float(raw[start:end].decode("ascii")) * edit.factor + summand
                yield Replacement(start, end, f"{value:.{DIGITS}g}".encode())


def _rotation(raw: bytes, origin: int | None) -> Array:
    """Return the axes of an ``<inertial>`` in those of its link."""
    span = None if origin is None else attributes(raw, origin).get("rpy")
    if span is None:
        return np.eye(3)
    return rotation_from_rpy([float(word) for word in raw[slice(*span)].split()])


def _check(before: Tree, after: Tree, edits: Sequence[InertialEdit], name: str) -> None:
    """Compare the tree that was written with the one that was meant."""
    wanted = {edit.link: edit for edit in edits}
    same = [link.name for link in before.links] == [link.name for link in after.links]
    same = same and all(
        _same_inertial(_edited(old, wanted.get(old.name)), new)
        for old, new in zip(before.links, after.links, strict=True)
    )
    if not same:
        raise _not_as_meant(name)


def _not_as_meant(name: str) -> ComcalError:
    return ComcalError(
        "the URDF read back differs from the one that was to be written",
        where=name,
        next_step="report this with the file; nothing was written",
    )


def _edited(link: Link, edit: InertialEdit | None) -> Link:
    """Return *link* as the edit wants it."""
    if edit is None:
        return link
    com = [old if new is None else new for old, new in zip(link.com, edit.com, strict=True)]
    more, moments = edit.joined or (0.0, np.zeros((3, 3)))
    return replace(
        link,
        mass=link.mass * edit.factor + more,
        com=np.array(com),
        inertia=link.inertia * edit.factor + moments,
    )


def _same_inertial(wanted: Link, found: Link) -> bool:
    rounding = 10.0 ** (1 - DIGITS)
    size = float(np.abs(wanted.inertia).max())
    return bool(
        wanted.name == found.name
        and wanted.has_inertial == found.has_inertial
        and abs(wanted.mass - found.mass) <= rounding * abs(wanted.mass)
        and np.all(np.abs(wanted.com - found.com) <= LENGTH_STEP)
        and np.all(np.abs(wanted.inertia - found.inertia) <= 10.0 * rounding * size)
    )
