# SPDX-License-Identifier: Apache-2.0
"""The two texts in which candump writes frames, and where the parts of a line stand in them.

Lines of a log are alike: the same channel, the same number of digits and bytes. One line of each
kind is taken apart by a regular expression; its :class:`Shape` then serves for all lines that have
the same letters in the same places, as columns.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from comcal_drivers.frames.batch import FD, REMOTE, SENT
from comcal_drivers.frames.batches import CLASSIC, LONG

Text = npt.NDArray[np.uint8]

NO_STAMP = b"-0.000000"
"""How a log says that a frame has no stamp; other programs read a zero."""

LOG = re.compile(
    rb"""\((?P<stamp>-?\d+\.\d+)\)\ +(?P<channel>\S+)\ +
    (?P<id>[0-3][0-9A-Fa-f]{7}|[0-7][0-9A-Fa-f]{2})\#
    (?:(?P<remote>[Rr])(?P<asked>\d?)|(?:\#(?P<fd>[0-9A-Fa-f]))?(?P<data>(?:[0-9A-Fa-f]{2})*))
    (?:_[9A-Fa-f])?                        # the raw DLC of eight bytes
    (?:\ +(?P<way>[RrTt]))?\s*""",
    re.VERBOSE,
)
"""What ``candump -L`` and python-can write: ``(1345212884.318850) can0 044#2A366C2B``."""

CONSOLE = re.compile(
    rb"""\s*(?:\((?P<stamp>-?\d+\.\d+)\)\s+)?(?P<channel>\S+)\ +
    (?:(?P<way>[RT])X\ [B-]\ [E-]\ +)?
    (?P<id>[0-3][0-9A-Fa-f]{7}|[0-7][0-9A-Fa-f]{2})\ +\[(?P<length>\d{1,2})\]\ *
    (?:(?P<remote>remote\ request)|(?P<data>(?:[0-9A-Fa-f]{2}(?:\ [0-9A-Fa-f]{2})*)?))
    (?P<rest>\ +(?:ERRORFRAME|'.*'))?\s*""",
    re.VERBOSE,
)
"""What candump shows: ``  can0  044   [4]  2A 36 6C 2B``, with or without stamps."""

SKIPPED = re.compile(rb"\s*|\t.*", re.DOTALL)
"""Lines without a frame: blank ones, and what ``candump -e`` says of an error frame."""


@dataclass(frozen=True)
class Shape:
    """Where the parts of a line stand, for all lines of one length and kind.

    Parameters
    ----------
    mask, letters : array of uint64, shape (w,)
        The letters that all these lines share, eight to a word, and a mask of where they stand.
    channel : str
    stamp : slice or None
        Digits and point of the time stamp.
    point : int
        Place of the point within it.
    number : slice
        Hexadecimal digits of the identifier.
    data : slice
        Payload.
    step : int
        Letters from one byte of payload to the next: 2, or 3 with blanks.
    length : int
        Payload bytes, or bytes asked for.
    kind : int
        Bits of ``FrameBatch.kinds`` that the form of the line tells.
    """

    mask: npt.NDArray[np.uint64]
    letters: npt.NDArray[np.uint64]
    channel: str
    stamp: slice | None
    point: int
    number: slice
    data: slice
    step: int
    length: int
    kind: int

    def fits(self, words: npt.NDArray[np.uint64]) -> npt.NDArray[np.bool_]:
        """Tell which lines have this shape.

        Parameters
        ----------
        words : array of uint64, shape (m, w)
            Lines of equal length, eight letters to a word.

        Returns
        -------
        array of bool, shape (m,)
        """
        fits = np.ones(words.shape[0], bool)
        for column in np.flatnonzero(self.mask):
            fits &= words[:, column] & self.mask[column] == self.letters[column]
        return fits


def shape_of(line: bytes, dialect: re.Pattern[bytes]) -> Shape | None:
    """Take a line apart.

    Parameters
    ----------
    line : bytes
        Without its line feed.
    dialect : re.Pattern
        :data:`LOG` or :data:`CONSOLE`.

    Returns
    -------
    Shape or None
        None if it does not hold a frame.
    """
    match = dialect.fullmatch(line)
    if match is None:
        return None
    part = match.groupdict()
    data = slice(*match.span("data")) if part["data"] is not None else slice(0, 0)
    step = 2 if dialect is LOG else 3
    length = (data.stop - data.start + step - 2) // step
    is_remote = part["remote"] is not None
    if is_remote:
        length = int(part.get("length") or part.get("asked") or 0)
    elif "length" in part and int(part["length"]) != length:
        return None
    is_fd = part.get("fd") is not None or len(part.get("length") or b"") == 2
    limit = LONG if is_fd else CLASSIC
    if length > limit:
        return None
    variable = np.zeros(len(line), bool)
    stamp: slice | None = None
    point = 0
    # The sign of "no stamp" stays among the letters that lines share.
    if part["stamp"] is not None and part["stamp"] != NO_STAMP:
        stamp = slice(*match.span("stamp"))
        point = part["stamp"].index(b".")
        variable[stamp] = True
        variable[stamp.start + point] = False
    number = slice(*match.span("id"))
    hexadecimal = (slice(data.start + k, data.stop, step) for k in (0, 1))
    for places in (number, *hexadecimal):
        variable[places] = True
    if part.get("rest") is not None:
        variable[slice(*match.span("rest"))] = True
    return Shape(
        mask=_words(np.where(variable, 0, 0xFF).astype(np.uint8)),
        letters=_words(np.where(variable, 0, np.frombuffer(line, np.uint8)).astype(np.uint8)),
        channel=part["channel"].decode("utf-8", "replace"),
        stamp=stamp,
        point=point,
        number=number,
        data=data,
        step=step,
        length=length,
        kind=is_remote * int(REMOTE)
        + is_fd * int(FD)
        + ((part["way"] or b"R").upper() == b"T") * int(SENT),
    )


def _words(letters: Text) -> npt.NDArray[np.uint64]:
    whole = np.zeros(-(-letters.size // 8) * 8, np.uint8)
    whole[: letters.size] = letters
    return whole.view(np.uint64)
