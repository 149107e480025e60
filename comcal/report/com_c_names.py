# SPDX-License-Identifier: Apache-2.0
"""Names of a URDF as C wants them: identifiers, strings and comments; any name may come in."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable


def identifier(name: str) -> str:
    """Return *name* as a C identifier that may start another one; ASCII only.

    Examples
    --------
    >>> identifier("l-knee (pitch)"), identifier("7dof"), identifier("")
    ('l_knee_pitch', 'robot_7dof', 'robot')
    """
    clean = _clean(name)
    return clean if re.match(r"[A-Za-z]", clean) else f"robot_{clean}".rstrip("_")


def enumerators(prefix: str, names: Iterable[str]) -> tuple[str, ...]:
    """Return one upper-case identifier per name, all different, in the same order.

    Examples
    --------
    Names that differ only in what C does not allow are numbered:

    >>> enumerators("R_Q_", ["knee", "Knee", "knee_2", "#"])
    ('R_Q_KNEE', 'R_Q_KNEE_3', 'R_Q_KNEE_2', 'R_Q_JOINT')
    """
    wanted = [prefix + (_clean(name).upper() or "JOINT") for name in names]
    taken = set(wanted)
    used: set[str] = set()
    unique: list[str] = []
    for name in wanted:
        chosen, count = name, 1
        while chosen in used or (count > 1 and chosen in taken):
            count += 1
            chosen = f"{name}_{count}"
        used.add(chosen)
        unique.append(chosen)
    return tuple(unique)


def string_literal(text: str) -> str:
    """Return *text* as a C string, its UTF-8 bytes escaped where they are not plain ASCII."""
    plain = {ord(c) for c in map(chr, range(32, 127))} - set(b'"\\?')
    return '"' + "".join(chr(b) if b in plain else f"\\{b:03o}" for b in text.encode()) + '"'


def in_comment(text: str) -> str:
    """Return *text* as it may stand in a comment: one line, ASCII, and it cannot end the comment.

    Examples
    --------
    >>> in_comment("knee */ hips")
    'knee _/ hips'
    """
    return re.sub(r"[^ -~]|[*\\?]", "_", text)


def comment_block(lines: Iterable[str]) -> str:
    """Return *lines* as one C comment, long ones wrapped, indented ones kept as they are."""
    wrapped = [
        part
        for line in map(in_comment, lines)
        for part in ([line] if line.startswith(" ") else textwrap.wrap(line, 97) or [""])
    ]
    return "\n".join(["/*", *(f" * {line}".rstrip() for line in wrapped), " */"])


def _clean(name: str) -> str:
    return re.sub(r"[^A-Za-z0-9]+", "_", name).strip("_")
