# SPDX-License-Identifier: Apache-2.0
"""Numbers of a URDF, found and replaced where they stand in the bytes of the file.

A parser that writes the file anew loses comments, line ends, the order of attributes and the way
numbers were written, and then nobody can read the difference. Here the file stays bytes: a
streaming parser says where tags begin, and only numbers that changed are replaced.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from xml.parsers import expat

from comcal.errors import UrdfError
from comcal.robot.urdf_xml import current_declaration

LENGTH_STEP = 1e-8
"""Step to which lengths are written [m]: far below what any force sensor resolves, so that rounding
some thirty links stays invisible too. A number closer than half of it to the new one stays."""

_TAG = re.compile(rb"<[^\s/>]+(?:[^\"'>]|\"[^\"]*\"|'[^']*')*>")
_ATTRIBUTE = re.compile(rb"([^\s=/<>\"']+)\s*=\s*(?:\"([^\"]*)\"|'([^']*)')")
_BLANK = re.compile(rb"[ \t\r\n]*")
_WORD = re.compile(rb"[^ \t\r\n]+")

OnTag = Callable[[Sequence[str], Sequence[str], Sequence[int], int], None]
"""Called with tags and names of all parents, where they begin, and where this tag begins."""


@dataclass(frozen=True)
class Replacement:
    """New bytes for ``raw[start:end]``."""

    start: int
    end: int
    new: bytes


def replaced(raw: bytes, replacements: Iterable[Replacement]) -> bytes:
    """Return *raw* with parts replaced that do not overlap."""
    for r in sorted(replacements, key=lambda r: r.start, reverse=True):
        raw = raw[: r.start] + r.new + raw[r.end :]
    return raw


def walk_tags(raw: bytes, name: str, on_tag: OnTag) -> None:
    """Call *on_tag* for every start tag; the last tag and name are its own.

    Raises
    ------
    UrdfError
        If the file is not XML, or in an encoding without ASCII.
    """
    if b"\0" in raw:
        raise UrdfError(
            "the file is not in an encoding that contains ASCII",
            where=name,
            next_step="save it as UTF-8",
        )
    tags: list[str] = []
    names: list[str] = []
    starts: list[int] = []
    parser = expat.ParserCreate()

    def start(tag: str, attributes: dict[str, str]) -> None:
        here = parser.CurrentByteIndex
        tags.append(tag)
        names.append(attributes.get("name", "").strip())
        on_tag(tags, names, starts, here)
        starts.append(here)

    def end(_: str) -> None:
        del tags[-1], names[-1], starts[-1]

    parser.StartElementHandler = start
    parser.EndElementHandler = end
    try:
        _ = parser.Parse(current_declaration(raw), True)
    except expat.ExpatError as error:
        raise UrdfError(
            f"not valid XML: {expat.ErrorString(error.code)}", where=f"{name}:{error.lineno}"
        ) from error


def new_origin(
    raw: bytes, parent: int, origin: int | None, xyz: Sequence[float | None]
) -> Iterable[Replacement]:
    """Yield the change of ``xyz``: number by number where they stand, else added.

    Parameters
    ----------
    raw : bytes
    parent : int
        Where the tag begins that holds the ``<origin>``.
    origin : int or None
        Where its ``<origin>`` begins; None: it has none.
    xyz : sequence of float or None, length 3
        New numbers [m]; None keeps what is written.
    """
    if origin is not None:
        spans = attributes(raw, origin)
        if "xyz" in spans:
            yield from _new_numbers(raw, spans["xyz"], xyz)
            return
        at, before = origin + len(b"<origin"), b' xyz="'
        after = b'"'
    else:
        # A child of its own, set off as the first child is.
        at = _tag_end(raw, parent)
        blank = _BLANK.match(raw, at)
        before = (blank.group() if blank else b"") + b'<origin xyz="'
        after = b'"/>'
    values = [0.0 if value is None else value for value in xyz]
    if any(abs(value) > 0.5 * LENGTH_STEP for value in values):
        yield Replacement(at, at, before + " ".join(map(_metres, values)).encode() + after)


def _new_numbers(
    raw: bytes, span: tuple[int, int], xyz: Sequence[float | None]
) -> Iterable[Replacement]:
    """Yield the replacement of those numbers of ``xyz`` that changed."""
    words = [(m.start(), m.end()) for m in _WORD.finditer(raw, *span)]
    for (start, end), value in zip(words, xyz, strict=True):
        if value is not None and abs(float(raw[start:end]) - value) > 0.5 * LENGTH_STEP:
            yield Replacement(start, end, _metres(value).encode())


def _metres(value: float) -> str:
    """Return a length to the step of 1e-8 m, without idle zeros."""
    text = f"{value:.8f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def _tag_end(raw: bytes, start: int) -> int:
    """Return the offset after the ``>`` of the tag that begins at *start*."""
    tag = _TAG.match(raw, start)
    return tag.end() if tag else start


def attributes(raw: bytes, start: int) -> dict[str, tuple[int, int]]:
    """Return where the values of a start tag's attributes stand, without their quotes.

    Raises
    ------
    UrdfError
        If one is written with a character reference.
    """
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
