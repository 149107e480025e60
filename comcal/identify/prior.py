# SPDX-License-Identifier: Apache-2.0
r"""The fit and CAD together: every number, with the share of it that is CAD's.

A prior is information that nobody measured. It is used only when asked for, at a stated strength,
and stays apart from the measured result: nothing here is ever written into a model.

Strength 1 takes ``tolerances`` of robot.yaml as they are, strength 2 halves its sigmas.

Share of the prior
------------------
With J and K the information of data and prior, the posterior mean is :math:`(J + K)^{-1}(J\,
\theta_{fit} + K\,\theta_{CAD})`, and :math:`R = (J + K)^{-1} J` says how much of each unknown's
true deviation from CAD reaches the estimate. The share of the prior in a number
:math:`L\,\theta` is what R leaves open,

.. math:: \frac{L\,(J + K)^{-1} L^T}{L\,K^{-1} L^T} ,

its variance after the data over that before them: 1 where no pose says anything, 0 where CAD does
not matter, :math:`1 - R_{ii}` for an unknown, and for a number of its own the part of the total
information that the prior has.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc

from comcal.errors import UsageError
from comcal.identify.adjust import Adjustment
from comcal.identify.against_cad import AgainstCad, against_cad, cad_root
from comcal.identify.unknowns import AXES
from comcal.robot.tree import Array

MEASURED, PRIOR = "measured", "prior"
MARKED_SHARE = 0.1
"""A number of which more than this share comes from the prior is marked as the prior's."""
CONTRADICTS = 1e-3
"""Probability of a step between prior and data below which they contradict one another."""
FAR = 3.0
"""Components further from CAD than this many sigmas of their step are named then."""
WEAKEST = 1e-6
"""Smallest strength at which prior and data are asked to agree."""
HALVINGS = 40
"""Steps of that search: more digits than anybody types."""


@dataclass(frozen=True)
class PriorLink:
    """A link as data and prior together have it.

    Parameters
    ----------
    mass, mass_sigma : float
        [kg]; sigma is NaN where masses are not free.
    mass_share : float
        Share of the prior in the mass.
    com, sigma : array, shape (3,)
        In the link frame [m]; NaN where the link has neither mass nor a value in the URDF.
    share : array, shape (3,)
        Share of the prior in each component.
    """

    link: str
    mass: float
    mass_sigma: float
    mass_share: float
    com: Array
    sigma: Array
    share: Array

    @property
    def source(self) -> tuple[str | None, str | None, str | None]:
        """``measured`` or ``prior`` for each component; None where there is no number."""
        x, y, z = (source_of(s) if np.isfinite(s) else None for s in self.share)
        return x, y, z

    @property
    def mass_source(self) -> str:
        """``measured`` or ``prior``."""
        return source_of(self.mass_share)


@dataclass(frozen=True)
class PriorFit:
    """A fit joined with a prior.

    Parameters
    ----------
    fit : Adjustment
        From data alone.
    strength : float
        What the sigmas of ``tolerances`` were divided by.
    theta : array, shape (size,)
        Posterior mean.
    cov, prior_cov : array, shape (size, size)
        After and before the data.
    links : tuple of PriorLink
        Every link, in tree order.
    chi2 : float
        Squared distance of data and prior along the seen directions, in its own sigmas.
    dof : int
        Number of those directions.
    agreeing_strength : float
        Strength at which chi2 would be as large as is to be expected.
    """

    fit: Adjustment
    strength: float
    theta: Array
    cov: Array
    prior_cov: Array
    links: tuple[PriorLink, ...]
    chi2: float
    dof: int
    agreeing_strength: float

    @property
    def p(self) -> float:
        """Probability of a distance at least as large if both are right."""
        return float(chdtrc(self.dof, self.chi2)) if self.dof else 1.0

    @property
    def contradict(self) -> bool:
        """Whether data and prior contradict one another."""
        return self.p < CONTRADICTS

    @property
    def sigma(self) -> Array:
        """Standard deviation of every unknown, shape (size,)."""
        return np.sqrt(np.clip(np.diag(self.cov), 0.0, None))

    @property
    def share(self) -> Array:
        """Share of the prior in every unknown, shape (size,)."""
        return self.share_of(np.eye(self.fit.unknowns.size))

    @property
    def far(self) -> tuple[tuple[str, float], ...]:
        """Unknowns whose step from CAD is implausible, farthest first, each with it in sigmas.

        A posterior mean differs from the prior's by as much as the variance that the data took.
        """
        step = self.theta - self.fit.unknowns.cad
        variance = np.diag(self.prior_cov) - np.diag(self.cov)
        known = self.share < 1.0 - MARKED_SHARE
        pull = np.divide(step, np.sqrt(np.abs(variance)), out=np.zeros_like(step), where=known)
        order = np.argsort(-np.abs(pull))
        names = self.fit.unknowns.names
        return tuple((names[i], float(pull[i])) for i in order if abs(pull[i]) > FAR)

    def share_of(self, functional: Array) -> Array:
        """Return the share of the prior in linear functionals of theta.

        Parameters
        ----------
        functional : array, shape (..., size)
            Rows L of ``L theta``.

        Returns
        -------
        share : array, shape (...)
            1 also where CAD is exact.
        """
        return _share(functional, self.cov, self.prior_cov)


def with_prior(fit: Adjustment, strength: float) -> PriorFit:
    """Join a fit with what the URDF says.

    Parameters
    ----------
    fit : Adjustment
    strength : float
        1: ``tolerances`` of robot.yaml as they are; larger: CAD is trusted more.

    Raises
    ------
    UsageError
        If *strength* is not a positive number.
    """
    if not (np.isfinite(strength) and strength > 0.0):
        raise UsageError(
            "the strength of a prior is a positive number",
            measured=f"{strength:g}",
            next_step="1 takes the tolerances of robot.yaml as they are; leave it out for none",
        )
    unknowns = fit.unknowns
    root = cad_root(unknowns, strength)
    view = against_cad(fit, root)
    theta = unknowns.cad + view.basis[:, : view.rank] @ (
        view.gain * view.seen / (1.0 + view.gain**2)
    )
    variance = np.ones(unknowns.size)
    variance[: view.rank] = 1.0 / (1.0 + view.gain**2)
    cov, prior_cov = (view.basis * variance) @ view.basis.T, root @ root.T
    return PriorFit(
        fit=fit,
        strength=strength,
        theta=theta,
        cov=cov,
        prior_cov=prior_cov,
        links=tuple(
            _link(fit, theta, cov, prior_cov, strength, k)
            for k in range(len(unknowns.robot.tree.links))
        ),
        chi2=_distance(view, 1.0),
        dof=view.rank,
        agreeing_strength=strength * _agreeing(view),
    )


def source_of(share: float) -> str:
    """Return ``prior`` for numbers that the prior has more than :data:`MARKED_SHARE` of.

    Parameters
    ----------
    share : float
    """
    return PRIOR if share > MARKED_SHARE else MEASURED


def _distance(view: AgainstCad, strength: float) -> float:
    """Return the squared distance of data and prior, the latter's sigmas divided by *strength*."""
    return float(np.sum(view.seen**2 / (1.0 + (view.gain / strength) ** 2)))


def _agreeing(view: AgainstCad) -> float:
    """Return by what the strength has to be multiplied for the distance that is to be expected."""
    if _distance(view, 1.0) <= view.rank:
        return 1.0
    low, high = np.log(WEAKEST), 0.0
    for _ in range(HALVINGS):  # the distance grows with the strength
        middle = 0.5 * (low + high)
        if _distance(view, float(np.exp(middle))) > view.rank:
            high = middle
        else:
            low = middle
    return float(np.exp(low))


def _share(functional: Array, cov: Array, prior_cov: Array) -> Array:
    after = np.einsum("...i,ij,...j->...", functional, cov, functional)
    before = np.einsum("...i,ij,...j->...", functional, prior_cov, functional)
    share = np.divide(after, before, out=np.ones_like(after), where=before > 0.0)
    return np.clip(share, 0.0, 1.0)


def _link(
    fit: Adjustment, theta: Array, cov: Array, prior_cov: Array, strength: float, k: int
) -> PriorLink:
    unknowns, robot = fit.unknowns, fit.unknowns.robot
    link, column, mass_column = robot.tree.links[k], unknowns.column(k), unknowns.mass_column(k)
    if column is None:
        known = 1.0 if link.has_inertial else np.nan
        com = link.com if link.has_inertial else np.full(3, np.nan)
        sigma = np.full(3, known * robot.tolerances.link_com / strength)
        return PriorLink(link.name, link.mass, np.nan, 1.0, com, sigma, np.full(3, known))
    functional = np.zeros((3, unknowns.size))
    functional[:, column : column + len(AXES)] = np.eye(3)
    mass, mass_sigma, mass_share = link.mass, np.nan, 1.0
    h = theta[column : column + 3]
    if mass_column is not None:
        mass = float(theta[mass_column])
        mass_sigma = float(np.sqrt(cov[mass_column, mass_column]))
        mass_share = float(_share(np.eye(unknowns.size)[mass_column], cov, prior_cov))
        if mass <= 0.0:  # no body: its CoM means nothing
            nothing = np.full(3, np.nan)
            return PriorLink(link.name, mass, mass_sigma, mass_share, nothing, nothing, nothing)
        functional[:, mass_column] = -h / mass  # d(h / m) = (dh - c dm) / m
    variance = np.einsum("ai,ij,aj->a", functional, cov, functional)
    return PriorLink(
        link=link.name,
        mass=mass,
        mass_sigma=mass_sigma,
        mass_share=mass_share,
        com=h / mass,
        sigma=np.sqrt(np.clip(variance, 0.0, None)) / abs(mass),
        share=_share(functional, cov, prior_cov),
    )
