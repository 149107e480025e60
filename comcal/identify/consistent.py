# SPDX-License-Identifier: Apache-2.0
r"""The physically possible robot nearest to the fit, and what being possible costs.

Along what the poses determine, near is measured in the covariance of the fit: the cost is the
increase of chi2. Along what they do not determine, the URDF holds, at :data:`WEAK` of its
tolerances, so that a bound is met by moving what nobody measured before anything measured moves.
Without bounds in the way the answer is the fit itself, completed by the least change of the URDF.

A bound that costs little was within the noise. One that costs much is contradicted by the data:
then the bound is wrong (the collision geometry is not the outline, the link carries something
outside), or the data are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc

from comcal.identify.adjust import Adjustment
from comcal.identify.against_cad import against_cad, cad_root
from comcal.identify.bounds import Bound, physical_bounds
from comcal.identify.least_norm import least_norm
from comcal.identify.prior import CONTRADICTS, MEASURED, PRIOR
from comcal.identify.solution import SEEN_SHARE
from comcal.identify.unknowns import AXES
from comcal.robot.tree import Array

BOUND = "bound"
WEAK = 0.01
"""Strength of CAD along unseen directions: 1 mm of tolerance weighs like 100 mm."""
SMALLEST = 1e-3
"""Least sigma of CAD there, as a share of the scale of an unknown: 0.1 mm of a body's CoM."""
ACTIVE = 1e-6
"""Multipliers above this, in sigmas, belong to bounds that are active."""


@dataclass(frozen=True)
class ActiveBound:
    """A bound at which the answer lies.

    Parameters
    ----------
    pull : float
        Its multiplier: how hard it pulls at the answer, in sigmas.
    """

    bound: Bound
    pull: float


@dataclass(frozen=True)
class ConsistentLink:
    """A link of the physically possible robot.

    Parameters
    ----------
    mass : float
        [kg]
    com, before : array, shape (3,)
        With and without bounds, in the link frame [m]; NaN where there is no positive mass.
    source : tuple of str or None, length 3
        ``measured``, ``bound`` (it lies at one) or ``prior`` (the poses do not determine it).
    mass_source : str
        The same.
    """

    link: str
    mass: float
    com: Array
    before: Array
    source: tuple[str | None, str | None, str | None]
    mass_source: str


@dataclass(frozen=True)
class ConsistentFit:
    """The answer, or the bounds that contradict one another.

    Parameters
    ----------
    fit : Adjustment
        Without bounds.
    theta : array, shape (size,), or None
        None where the bounds contradict one another.
    active : tuple of ActiveBound
        The one that pulls hardest first.
    contradiction : tuple of Bound
        Bounds that cannot hold together.
    chi2_increase : float
        Squared distance from the fit along the seen directions, in the sigmas of the fit.
    dof : int
        Independent directions in which the active bounds hold the answer.
    without : tuple of (str, str)
        Links whose CoM is not bounded, with the reason.
    links : tuple of ConsistentLink
        Empty where there is no answer.
    """

    fit: Adjustment
    theta: Array | None
    active: tuple[ActiveBound, ...]
    contradiction: tuple[Bound, ...]
    chi2_increase: float
    dof: int
    without: tuple[tuple[str, str], ...]
    links: tuple[ConsistentLink, ...]

    @property
    def p(self) -> float:
        """Probability of an increase at least as large if a robot at these bounds was measured.

        Given which bounds are active, the increase is a chi2 of as many degrees of freedom; for a
        robot inside its bounds it is smaller.
        """
        return float(chdtrc(self.dof, self.chi2_increase)) if self.dof else 1.0

    @property
    def contradicted(self) -> bool:
        """Whether the data contradict the bounds, first of all the one that pulls hardest."""
        return self.p < CONTRADICTS


def consistent_fit(fit: Adjustment, more: Sequence[Bound] = ()) -> ConsistentFit:
    """Return the physically possible unknowns nearest to a fit.

    Parameters
    ----------
    fit : Adjustment
    more : sequence of Bound
        What else is known for sure, besides positive masses and CoMs within their outlines.

    Raises
    ------
    MissingExtraError
        If the convex solver is not installed.
    DataError
        If the solver gives up.
    """
    unknowns = fit.unknowns
    physical = physical_bounds(unknowns)
    bounds = (*physical.bounds, *more)
    view = against_cad(fit, cad_root(unknowns, smallest=SMALLEST))
    rank = view.rank
    # theta = nearest + step e, |e|^2 being what is minimised.
    nearest = unknowns.cad + view.basis[:, :rank] @ (view.seen / view.gain)
    step = view.basis / WEAK
    step[:, :rank] = view.basis[:, :rank] / view.gain

    rows = np.array([bound.row for bound in bounds]).reshape(-1, unknowns.size)
    limit = np.array([bound.limit for bound in bounds])
    N, b = rows @ step, limit - rows @ nearest
    length = np.linalg.norm(N, axis=1)
    length[length == 0.0] = 1.0
    N, b = N / length[:, None], b / length
    found = least_norm(N, b)
    if found.point is None:
        return ConsistentFit(
            fit=fit,
            theta=None,
            active=(),
            contradiction=tuple(bounds[i] for i in found.contradiction),
            chi2_increase=np.nan,
            dof=0,
            without=physical.without,
            links=(),
        )
    theta = nearest + step @ found.point
    order = np.argsort(-found.multipliers)
    at = [int(i) for i in order if found.multipliers[i] > ACTIVE]
    return ConsistentFit(
        fit=fit,
        theta=theta,
        active=tuple(ActiveBound(bounds[i], float(found.multipliers[i])) for i in at),
        contradiction=(),
        chi2_increase=float(np.sum(found.point[:rank] ** 2)),
        dof=int(np.linalg.matrix_rank(N[at, :rank], tol=ACTIVE)) if at else 0,
        without=physical.without,
        links=_links(fit, theta, nearest, {bounds[i].component for i in at}),
    )


def _links(
    fit: Adjustment, theta: Array, nearest: Array, at_bound: set[str]
) -> tuple[ConsistentLink, ...]:
    unknowns, tree = fit.unknowns, fit.unknowns.robot.tree
    mass, before = unknowns.link_masses(theta), unknowns.link_masses(nearest)
    h, h_before = unknowns.moments(theta), unknowns.moments(nearest)
    links: list[ConsistentLink] = []
    for k, link in enumerate(tree.links):
        column, mass_column = unknowns.column(k), unknowns.mass_column(k)
        source: list[str | None] = [PRIOR if link.has_inertial else None] * len(AXES)
        com, com_before, mass_source = link.com, link.com, PRIOR
        if not link.has_inertial:
            com = com_before = np.full(len(AXES), np.nan)
        if column is not None:
            com, com_before = _com(h[k], mass[k]), _com(h_before[k], before[k])
            functional = np.eye(unknowns.size)[column : column + len(AXES)]
            if mass_column is not None:
                functional[:, mass_column] = -com
                whole = np.eye(unknowns.size)[mass_column]
                mass_source = _source(fit, whole, f"{link.name} mass" in at_bound)
            source = [
                _source(fit, row, f"{link.name} {axis}" in at_bound)
                for row, axis in zip(functional, AXES, strict=True)
            ]
        links.append(
            ConsistentLink(
                link=link.name,
                mass=float(mass[k]),
                com=com,
                before=com_before,
                source=(source[0], source[1], source[2]),
                mass_source=mass_source,
            )
        )
    return tuple(links)


def _com(h: Array, mass: float) -> Array:
    return h / mass if mass != 0.0 else np.full(len(h), np.nan)


def _source(fit: Adjustment, functional: Array, at_bound: bool) -> str:
    if at_bound:
        return BOUND
    return MEASURED if fit.visibility(functional) < SEEN_SHARE else PRIOR
