# SPDX-License-Identifier: Apache-2.0
r"""What changed on a robot between two calibrations.

The readings of two sessions are independent: their variances add. What comes from CAD is not: it is
the same robot and the same URDF. Along directions that a session does not see, its estimate is off
by :math:`-P d`, d being how far the robot is from its URDF and P the projection on what is unseen.
If nothing changed, d is the same in both, so the difference of the estimates has the covariance

.. math:: C_A + C_B + (P_B - P_A) D (P_B - P_A)^T + (G_A - G_B) S (G_A - G_B)^T

with D and S from ``tolerances`` and G the reaction to masses and CoMs below the cuts. Two sessions
with the same kinds of poses share what CAD does to them, and it cancels.

Many numbers are compared at once, and of a hundred that did not change five are beyond two sigma.
So a single number counts as changed beyond the limit at which *none of all of them* passes it with
the probability that one has to stay below two sigma (Sidak): 2 sigma for one number, 3.3 for fifty.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from comcal.identify.adjust import Adjustment
from comcal.identify.cad_inputs import cad_inputs
from comcal.identify.solution import SEEN_SHARE, total_com_at, total_com_functional
from comcal.identify.unknowns import AXES
from comcal.identify.words import combinations_of
from comcal.robot.tree import Array
from comcal.statics.support import carrier_of

SIGMAS = 2.0
"""What one number has to change by to be told, in its own sigmas."""
ONE_IN = 0.0455002639
"""Probability that a normal number is beyond two sigma."""


@dataclass(frozen=True)
class Change:
    """One number of two calibrations.

    Parameters
    ----------
    name : str
        ``mass``, ``LINK x``, the words of a sum, or ``total CoM x``.
    kind : str
        ``mass``, ``link``, ``sum`` or ``total_com``.
    a, b : float
        Both values, SI.
    sigma : float
        Of b - a.
    unit : str
        ``kg``, ``m`` or ``kg m``.
    """

    name: str
    kind: str
    a: float
    b: float
    sigma: float
    unit: str

    @property
    def value(self) -> float:
        """The change b - a."""
        return self.b - self.a

    @property
    def in_sigmas(self) -> float:
        """Size of the change in its own sigma; infinite for exact numbers that differ."""
        if self.sigma > 0.0:
            return abs(self.value) / self.sigma
        return np.inf if self.value else 0.0


def limit_for(count: int) -> float:
    """Return how many sigmas one of *count* numbers must change by to count as changed.

    Parameters
    ----------
    count : int
    """
    each = -np.expm1(np.log1p(-ONE_IN) / max(count, 1))
    return float(-ndtri(0.5 * each))


def comparable(one: Adjustment, other: Adjustment) -> bool:
    """Return whether two fits speak of the same unknowns, measured from the same URDF.

    Parameters
    ----------
    one, other : Adjustment
    """
    a, b = one.unknowns, other.unknowns
    return a.names == b.names and bool(np.array_equal(a.cad, b.cad))


def changes_between(
    one: Adjustment, other: Adjustment, support: str, q: Array
) -> tuple[Change, ...]:
    """Compare mass, link CoMs, sums and total CoM of two fits that are :func:`comparable`.

    Only what both of them determine is compared.

    Parameters
    ----------
    one, other : Adjustment
    support : str
        Of the posture in which the total CoM is compared, in P.
    q : array, shape (n_joints,)
        The posture.
    """
    unknowns = one.unknowns
    tree = unknowns.robot.tree
    every = np.ones(len(tree.links), np.bool_)
    of_mass, known = unknowns.mass_functional(every)
    names: list[tuple[str, str, str]] = [("mass", "mass", "kg")]
    rows, offset = [of_mass], [known]
    for k in unknowns.links:
        column, mass = unknowns.column(k), float(tree.masses[k])
        mass_column = unknowns.mass_column(k)
        if mass_column is not None:
            names.append((f"{tree.links[k].name} mass", "link", "kg"))
            rows.append(np.eye(unknowns.size)[mass_column])
            offset.append(0.0)
        if column is None or mass_column is not None:
            continue  # with free masses, sums of first moments say what changed
        for axis, letter in enumerate(AXES):
            row = np.zeros(unknowns.size)
            row[column + axis] = 1.0 / mass
            names.append((f"{tree.links[k].name} {letter}", "link", "m"))
            rows.append(row)
            offset.append(0.0)
    index = {name: i for i, name in enumerate(unknowns.names)}
    tares = set(unknowns.names[unknowns.first_offset :])
    for combination in combinations_of(one):
        alone = len(combination.coefficients) == 1 and not unknowns.free_masses
        told = alone or combination.words in {name for name, _, _ in names}
        if not told and not tares & set(combination.coefficients):
            row = np.zeros(unknowns.size)
            for name, coefficient in combination.coefficients.items():
                row[index[name]] = coefficient
            names.append((combination.words, "sum", "kg m"))
            rows.append(row)
            offset.append(0.0)
    L, known_values = np.array(rows), np.array(offset)
    seen = np.maximum(one.visibility(L), other.visibility(L)) < SEEN_SHARE
    sigma = np.sqrt(np.clip(np.diag(_cov_of_difference(one, other, L, L)), 0.0, None))
    found = [
        Change(name, kind, float(a), float(b), float(s), unit)
        for (name, kind, unit), a, b, s, both in zip(
            names,
            L @ one.theta + known_values,
            L @ other.theta + known_values,
            sigma,
            seen,
            strict=True,
        )
        if both
    ]
    if not any(change.kind == "mass" for change in found):
        return tuple(found)  # what does not weigh the robot does not know its CoM
    return (*found, *_total_com(one, other, support, q))


def _total_com(one: Adjustment, other: Adjustment, support: str, q: Array) -> list[Change]:
    """Compare the whole robot's CoM in one posture; what CAD adds to both alike cancels."""
    values, slopes = [], []
    for fit in (one, other):
        unknowns = fit.unknowns
        carrier = carrier_of(unknowns.robot, support)
        every = np.ones(len(unknowns.robot.tree.links), np.bool_)
        of_mass, _ = unknowns.mass_functional(every)
        L, _, root = total_com_functional(unknowns, carrier, q[None], whole=True)
        xyz, _, _ = total_com_at(fit, cad_inputs(fit), support, q[None])
        values.append(xyz[0])
        slopes.append((L[0] - (xyz[0] - root[0])[:, None] * of_mass) / unknowns.mass(fit.theta))
    cov = _cov_of_difference(one, other, slopes[0], slopes[1])
    sigma = np.sqrt(np.clip(np.diag(cov), 0.0, None))
    return [
        Change(f"total CoM {letter}", "total_com", float(a), float(b), float(s), "m")
        for letter, a, b, s in zip(AXES, values[0], values[1], sigma, strict=True)
    ]


def _cov_of_difference(one: Adjustment, other: Adjustment, J_a: Array, J_b: Array) -> Array:
    """Return the covariance of J_b theta_b - J_a theta_a if the robot is the same."""
    cov = J_a @ one.cov @ J_a.T + J_b @ other.cov @ J_b.T
    unseen = (J_b @ _unseen(other) - J_a @ _unseen(one)) * one.unknowns.cad_sigma
    a, b = cad_inputs(one), cad_inputs(other)
    given = (J_b @ b.gain - J_a @ a.gain) * a.sigma
    return cov + unseen @ unseen.T + given @ given.T


def _unseen(fit: Adjustment) -> Array:
    """Return the projection of the unknowns on what a fit does not see, shape (size, size)."""
    scale = fit.unknowns.scale
    return (scale[:, None] * fit.unseen) @ (fit.unseen.T / scale)


def strongest_first(changes: Sequence[Change]) -> list[Change]:
    """Return *changes* with the most significant first.

    Parameters
    ----------
    changes : sequence of Change
    """
    return sorted(changes, key=lambda change: -change.in_sigmas)
