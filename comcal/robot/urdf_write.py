# SPDX-License-Identifier: Apache-2.0
"""Writing new masses and CoMs into a URDF without touching anything else.

A parser that writes the file anew loses comments, line ends, the order of attributes and the way
numbers were written, and then nobody can read the difference. Here the file stays bytes: a
streaming parser says where the numbers stand, and only those that changed are replaced. Comments,
CDATA and ``<inertial>`` elsewhere than directly in a link of the robot are never looked into.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from xml.parsers import expat

import numpy as np

from comcal.errors import ComcalError, UrdfError
from comcal.robot.tree import Link, Tree
from comcal.robot.urdf import parse_urdf
from comcal.robot.urdf_xml import current_declaration

COM_STEP = 1e-8
"""Step to which CoMs are written [m]: far below what any force sensor resolves, so that rounding
some thirty links stays invisible too. A number closer than half of it to the new one stays."""
DIGITS = 9
"""Significant digits of masses and moments of inertia."""

_CHILDREN = ("origin", "mass", "inertia")
_MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
_TAG = re.compile(rb"<[^\s/>]+(?:[^\"'>]|\"[^\"]*\"|'[^']*')*>")
_ATTRIBUTE = re.compile(rb"([^\s=/<>\"']+)\s*=\s*(?:\"([^\"]*)\"|'([^']*)')")
_BLANK = re.compile(rb"[ \t\r\n]*")
_WORD = re.compile(rb"[^ \t\r\n]+")


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
    """

    link: str
    com: tuple[float | None, float | None, float | None] = (None, None, None)
    factor: float = 1.0


@dataclass(frozen=True)
class _Replacement:
    """New bytes for ``raw[start:end]``."""

    start: int
    end: int
    new: bytes


@dataclass
class _Inertial:
    """Offsets of the start tags of an ``<inertial>`` and of its first children."""

    start: int
    children: dict[str, int] = field(default_factory=dict[str, int])


def write_inertials(raw: bytes, name: str, edits: Sequence[InertialEdit]) -> bytes:
    """Return a URDF with other inertials, every other byte as it was.

    The rotation of an inertial's ``<origin>`` and its tensor about the CoM stay. Where there is no
    ``<origin>``, or one without ``xyz``, it is added. The result is read back and compared.

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
    replacements: list[_Replacement] = []
    for edit in edits:
        if edit.link not in found:
            raise UrdfError(
                f"link {edit.link!r} has no <inertial> that could be changed",
                where=name,
                next_step="give the link an <inertial>, or join it to one that has",
            )
        replacements += _replacements(raw, found[edit.link], edit)
    new = raw
    for r in sorted(replacements, key=lambda r: r.start, reverse=True):
        new = new[: r.start] + r.new + new[r.end :]
    _check(before, parse_urdf(new, name), edits, name)
    return new


def _find_inertials(raw: bytes, name: str) -> Mapping[str, _Inertial]:
    """Return where the first ``<inertial>`` of every link of the robot stands."""
    if b"\0" in raw:
        raise UrdfError(
            "the file is not in an encoding that contains ASCII",
            where=name,
            next_step="save it as UTF-8",
        )
    found: dict[str, _Inertial] = {}
    path: list[tuple[str, str]] = []
    parser = expat.ParserCreate()

    def start(tag: str, attributes: dict[str, str]) -> None:
        tags = [parent for parent, _ in path]
        here = parser.CurrentByteIndex
        if tags == ["robot", "link"] and tag == "inertial":
            _ = found.setdefault(path[1][1], _Inertial(here))
        elif tags == ["robot", "link", "inertial"] and tag in _CHILDREN:
            inertial = found[path[1][1]]
            if inertial.start == starts[-1]:
                _ = inertial.children.setdefault(tag, here)
        path.append((tag, attributes.get("name", "").strip()))
        starts.append(here)

    def end(_: str) -> None:
        del path[-1], starts[-1]

    starts: list[int] = []
    parser.StartElementHandler = start
    parser.EndElementHandler = end
    try:
        _ = parser.Parse(current_declaration(raw), True)
    except expat.ExpatError as error:
        raise UrdfError(
            f"not valid XML: {expat.ErrorString(error.code)}", where=f"{name}:{error.lineno}"
        ) from error
    return found


def _replacements(raw: bytes, inertial: _Inertial, edit: InertialEdit) -> Iterable[_Replacement]:
    """Yield what changes in one ``<inertial>``."""
    if any(value is not None for value in edit.com):
        yield from _new_origin(raw, inertial, edit.com)
    if edit.factor == 1.0:
        return
    for tag, attributes in (("mass", ("value",)), ("inertia", _MOMENTS)):
        if tag not in inertial.children:
            continue
        spans = _attributes(raw, inertial.children[tag])
        for attribute in attributes:
            if attribute in spans:
                start, end = spans[attribute]
                value = float(raw[start:end].decode("ascii")) * edit.factor
                yield _Replacement(start, end, f"{value:.{DIGITS}g}".encode())


def _new_origin(
    raw: bytes, inertial: _Inertial, com: Sequence[float | None]
) -> Iterable[_Replacement]:
    """Yield the change of ``xyz``: number by number where they stand, else added."""
    if "origin" in inertial.children:
        start = inertial.children["origin"]
        spans = _attributes(raw, start)
        if "xyz" in spans:
            yield from _new_numbers(raw, spans["xyz"], com)
            return
        at, before = start + len(b"<origin"), b' xyz="'
        after = b'"'
    else:
        # A child of its own, set off as the first child is.
        at = _tag_end(raw, inertial.start)
        blank = _BLANK.match(raw, at)
        before = (blank.group() if blank else b"") + b'<origin xyz="'
        after = b'"/>'
    values = [0.0 if value is None else value for value in com]
    if any(abs(value) > 0.5 * COM_STEP for value in values):
        yield _Replacement(at, at, before + " ".join(map(_metres, values)).encode() + after)


def _new_numbers(
    raw: bytes, span: tuple[int, int], com: Sequence[float | None]
) -> Iterable[_Replacement]:
    """Yield the replacement of those numbers of ``xyz`` that changed."""
    words = [(m.start(), m.end()) for m in _WORD.finditer(raw, *span)]
    for (start, end), value in zip(words, com, strict=True):
        if value is not None and abs(float(raw[start:end]) - value) > 0.5 * COM_STEP:
            yield _Replacement(start, end, _metres(value).encode())


def _metres(value: float) -> str:
    """Return a length to the step of 1e-8 m, without idle zeros."""
    text = f"{value:.8f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def _tag_end(raw: bytes, start: int) -> int:
    """Return the offset after the ``>`` of the tag that begins at *start*."""
    tag = _TAG.match(raw, start)
    return tag.end() if tag else start


def _attributes(raw: bytes, start: int) -> dict[str, tuple[int, int]]:
    """Return where the values of a start tag's attributes stand, without their quotes."""
    spans: dict[str, tuple[int, int]] = {}
    for match in _ATTRIBUTE.finditer(raw, start, _tag_end(raw, start)):
        group = 2 if match.group(2) is not None else 3
        if b"&" in match.group(group):
            line = 1 + raw.count(b"\n", 0, start)
            raise UrdfError(
                "a number is written with a character reference, which is not edited in place",
                where=f"line {line}",
                measured=match.group().decode("ascii", "replace"),
                next_step="write it as a plain decimal number",
            )
        spans[match.group(1).decode("utf-8", "replace")] = match.span(group)
    return spans


def _check(before: Tree, after: Tree, edits: Sequence[InertialEdit], name: str) -> None:
    """Compare the tree that was written with the one that was meant."""
    wanted = {edit.link: edit for edit in edits}
    same = [link.name for link in before.links] == [link.name for link in after.links]
    same = same and all(
        _same_inertial(_edited(old, wanted.get(old.name)), new)
        for old, new in zip(before.links, after.links, strict=True)
    )
    if not same:
        raise ComcalError(
            "the URDF read back differs from the one that was to be written",
            where=name,
            next_step="report this with the file; nothing was written",
        )


def _edited(link: Link, edit: InertialEdit | None) -> Link:
    """Return *link* as the edit wants it."""
    if edit is None:
        return link
    com = [old if new is None else new for old, new in zip(link.com, edit.com, strict=True)]
    return replace(
        link,
        mass=link.mass * edit.factor,
        com=np.array(com),
        inertia=link.inertia * edit.factor,
    )


def _same_inertial(wanted: Link, found: Link) -> bool:
    rounding = 10.0 ** (1 - DIGITS)
    size = float(np.abs(wanted.inertia).max())
    return bool(
        wanted.name == found.name
        and wanted.has_inertial == found.has_inertial
        and abs(wanted.mass - found.mass) <= rounding * abs(wanted.mass)
        and np.all(np.abs(wanted.com - found.com) <= COM_STEP)
        and np.all(np.abs(wanted.inertia - found.inertia) <= 10.0 * rounding * size)
    )
