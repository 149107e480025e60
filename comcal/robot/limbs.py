# SPDX-License-Identifier: Apache-2.0
"""Limbs: the blocks in which "which body hangs on which joint" is dense but for a triangle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt


@dataclass(frozen=True)
class Limb:
    """Joints in a row, without branches between them, and some of the bodies that hang on them.

    Parameters
    ----------
    joints : slice
        Of the moving joints; joint i moves body i + 1.
    columns : slice
        Of q: the joints' own, or that of the joint which they follow by mimic.
    follows : bool
        Whether this is a joint that follows another one by mimic; it is a limb of its own then.
    unknowns : slice
        Of one uninterrupted run of bodies that hang on the first joint; four unknowns per body.
    gaps : tuple of (int, slice)
        Joints and runs of unknowns, counted from the first of each, where the body does not hang
        on the joint.
    """

    joints: slice
    columns: slice
    follows: bool
    unknowns: slice
    gaps: tuple[tuple[int, slice], ...]


def cut_limbs(
    parents: Sequence[int],
    columns: npt.NDArray[np.intp],
    follows: npt.NDArray[np.bool_],
    descendants: npt.NDArray[np.bool_],
) -> tuple[Limb, ...]:
    """Cut a tree into limbs, those that follow others last.

    Parameters
    ----------
    parents : sequence of int
        Body that each body hangs on, -1 for the root.
    columns, follows : array, shape (n_bodies - 1,)
        Column of q of each moving joint, and whether it mimics another joint.
    descendants : array of bool, shape (n_bodies, n_bodies)
        ``descendants[i, b]``: body b is body i or hangs below it.
    """
    limbs: list[Limb] = []
    children = np.bincount(np.array(parents[1:], dtype=np.intp), minlength=len(parents))
    below = descendants[1:]
    first, n = 0, len(columns)
    while first < n:
        last = first + 1
        while (
            last < n
            and parents[last + 1] == last
            and children[last] == 1
            and columns[last] == columns[last - 1] + 1
            and not follows[first]
            and not follows[last]
        ):
            last += 1
        column = int(columns[first])
        for run in _runs(below[first]):
            limbs.append(
                Limb(
                    slice(first, last),
                    slice(column, column + last - first),
                    bool(follows[first]),
                    _fourfold(run),
                    tuple(
                        (i, _fourfold(gap))
                        for i, hangs in enumerate(below[first:last, run])
                        for gap in _runs(~hangs)
                    ),
                )
            )
        first = last
    return tuple(sorted(limbs, key=lambda limb: limb.follows))


def _runs(mask: npt.NDArray[np.bool_]) -> list[slice]:
    """Return the uninterrupted runs of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]])))
    return [slice(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def _fourfold(run: slice) -> slice:
    return slice(4 * run.start, 4 * run.stop)
