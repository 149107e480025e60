# SPDX-License-Identifier: Apache-2.0
r"""CoM of every segment of a planar chain from n + 1 configurations, by Cramer's rule.

The 2n x 2n real system of Muscolo 2017 (26), (34)-(43) is an n x n complex one, E H = K with
:math:`E_{iv} = e^{j\varphi_{iv}}` and det A_real = |det E|^2 (times the masses squared). For n = 2
:math:`|\det E|^2 = 2 (1 - \cos\theta)`, theta being the change of the relative angle: zero when the
shape does not change. Any n of the n + 1 configurations solve; the others check.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from math import comb

import numpy as np

from comcal.errors import RankError
from comcal.robot.kinematics import Placements
from comcal.robot.tree import Array
from comcal.statics.planar import (
    ComplexArray,
    PlanarChain,
    right_hand_side,
    segment_com,
    segment_turns,
)

MIN_DETERMINANT = 0.05
"""Smallest |det E| that is solved; for two segments a change of shape of 2.9 deg."""
MAX_CHOICES = 500
"""More choices of n configurations than this are not enumerated."""


@dataclass(frozen=True)
class Choice:
    """n configurations that solve, and the rest that checks.

    Parameters
    ----------
    solving, checking : tuple of int
        Indices of configurations.
    determinant : float
        |det E| of unit rows; at most n^(n/2).
    """

    solving: tuple[int, ...]
    checking: tuple[int, ...]
    determinant: float


def choices_of(chain: PlanarChain, at: Placements) -> tuple[Choice, ...]:
    """Return every choice of n configurations whose determinant is large enough, best first.

    Raises
    ------
    RankError
        If no choice is regular: the shapes do not differ.
    """
    E = np.exp(1j * segment_turns(chain, at))
    n, available = len(chain.segments), range(len(E))
    if comb(len(E), n) > MAX_CHOICES:
        raise RankError(
            f"{len(E)} configurations allow more than {MAX_CHOICES} choices of {n}",
            next_step="use --method lstsq, which takes them all at once",
        )
    every = [
        Choice(
            solving,
            tuple(i for i in available if i not in solving),
            float(abs(np.linalg.det(E[list(solving)]))),
        )
        for solving in combinations(available, n)
    ]
    regular = [choice for choice in every if choice.determinant >= MIN_DETERMINANT]
    if not regular:
        raise RankError(
            "the configurations are one shape: no choice of them has a determinant to divide by",
            measured=f"|det E| {max(choice.determinant for choice in every):.3g}",
            limit=f"{MIN_DETERMINANT:g}",
            next_step="bend one joint at a time by 30 deg or more; a tilt about the ankles is "
            "the same shape",
        )
    return tuple(sorted(regular, key=lambda choice: -choice.determinant))


def cramer_rule(E: ComplexArray, K: ComplexArray) -> ComplexArray:
    """Solve E H = K as quotients of determinants, batched over leading axes.

    Parameters
    ----------
    E : complex array, shape (..., n, n)
    K : complex array, shape (..., n)
    """
    determinant = np.linalg.det(E)
    H = np.empty(K.shape, dtype=np.complex128)
    for v in range(E.shape[-1]):
        replaced = E.copy()
        replaced[..., v] = K
        H[..., v] = np.linalg.det(replaced) / determinant
    return H


def solve_choices(
    chain: PlanarChain,
    choices: Sequence[Choice],
    at: Placements,
    first_moment: ComplexArray,
    mass: Array,
) -> tuple[ComplexArray, ComplexArray]:
    """Solve every choice, batched over leading axes.

    Parameters
    ----------
    at : Placements, shape (..., n_configurations, n_links, ...)
        Reference postures in P.
    first_moment : complex array, shape (..., n_configurations)
        Mass times CoM of the counted links, z + j x in P, less what of the feet's first moment
        deviates from CAD [kg m].
    mass : array, shape (..., n_configurations)
        Mass of the counted links [kg].

    Returns
    -------
    w : complex array, shape (..., n_choices, n_segments)
        CoM of each segment relative to its anchor joint, l + j r [m] (see ``segment_com``).
    misfit : complex array, shape (..., n_choices)
        Predicted minus measured CoM, z + j x [m], of the first checking configuration of each
        choice; zero where none is left to check.
    """
    E = np.exp(1j * segment_turns(chain, at))
    K = right_hand_side(chain, at, first_moment)
    w: list[ComplexArray] = []
    misfit: list[ComplexArray] = []
    for choice in choices:
        rows = list(choice.solving)
        H = cramer_rule(E[..., rows, :], K[..., rows])
        w.append(segment_com(chain, at, H))
        if choice.checking:
            i = choice.checking[0]
            predicted = np.einsum("...v,...v->...", E[..., i, :], H)
            misfit.append((predicted - K[..., i]) / mass[..., i])
        else:
            misfit.append(np.zeros(K.shape[:-1], dtype=np.complex128))
    return np.stack(w, axis=-2), np.stack(misfit, axis=-1)
