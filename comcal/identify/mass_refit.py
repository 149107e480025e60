# SPDX-License-Identifier: Apache-2.0
"""Whether refitted link masses may be believed; if not, why, and what is determined instead.

Static poses of a robot that moves little determine its mass and a few first moments, not how the
mass is split over the links. A least-squares fit returns numbers all the same, negative ones too.
Such numbers are not passed on: a refused refit carries its reasons and no masses.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc

from comcal.identify.adjust import adjust
from comcal.identify.calibration import MISFIT
from comcal.identify.groups import groups_of
from comcal.identify.hung_moments import determined_sums
from comcal.identify.mass_fit import MassFit, fit_masses
from comcal.identify.solution import sigmas
from comcal.identify.unknowns import unknowns_of
from comcal.identify.words import Combination
from comcal.measure.plan import NONE
from comcal.measure.table import PoseTable
from comcal.robot.model import Robot
from comcal.robot.tree import Array, JointType

LIGHTEST, HEAVIEST = 0.1, 3.0
"""Refitted over URDF mass beyond which a mass is absurd, whatever its interval says."""
WIDEST = 0.5
"""Largest half width of a 95 % interval, relative to the URDF's mass."""
TWO_SIDED_95 = 1.96
"""Standard deviations in half a 95 % interval."""


@dataclass(frozen=True)
class Objection:
    """One reason not to believe a refit.

    Parameters
    ----------
    link : str
        Empty when the whole fit is meant.
    words : str
    """

    link: str
    words: str


@dataclass(frozen=True)
class MassRefit:
    """A refit of link masses and the judgement of it.

    Parameters
    ----------
    links : tuple of str
        Links whose mass was free.
    urdf : array, shape (n,)
        Their masses in the URDF [kg].
    masses, cov : array, shape (n,) and (n, n), or None
        [kg], [kg^2], noise and the tolerance of the URDF's CoMs together; None when refused.
    objections : tuple of Objection
        Empty when the masses may be believed.
    rank : int
        Combinations of the masses that the poses determine.
    condition : float
        Of the refit, masses in units of the URDF's.
    chi2, dof, misfit_p
        Of the refit; probability of a misfit at least as large if model and noise are right.
    ranges : mapping from joint name to float
        How far each joint moved between all standing poses [rad] or [m], least first.
    slides : tuple of str
        Which of them are prismatic.
    determined : tuple of Combination
        What the poses determine however the mass is split: the mass [kg], and first moments
        [kg m], see :mod:`comcal.identify.hung_moments`.
    determined_p : float
        Probability of the misfit of the fit that *determined* comes from.
    """

    links: tuple[str, ...]
    urdf: Array
    masses: Array | None
    cov: Array | None
    objections: tuple[Objection, ...]
    rank: int
    condition: float
    chi2: float
    dof: int
    misfit_p: float
    ranges: dict[str, float]
    slides: tuple[str, ...]
    determined: tuple[Combination, ...]
    determined_p: float

    @property
    def is_refused(self) -> bool:
        """Whether the masses are withheld."""
        return self.masses is None


def refit_masses(robot: Robot, table: PoseTable) -> MassRefit:
    """Refit the link masses with CoMs kept at the URDF's place, and judge the result.

    Parameters
    ----------
    robot : Robot
    table : PoseTable

    Returns
    -------
    MassRefit
        Refused, hence without masses, when any mass is negative, below 10 % or above 300 % of the
        URDF's, or has a 95 % interval wider than +/-50 % of it; when the poses do not determine
        every mass; or when the misfit is beyond the noise, so that no sigma can be trusted.

    Raises
    ------
    RankError
        If no pose loads a sensor.
    MissingColumnError
        If a loaded sensor has no wrench.
    """
    groups = groups_of(robot, table)
    fit = fit_masses(robot, groups)
    free = adjust(robot, unknowns_of(robot), groups)
    names = tuple(robot.tree.links[k].name for k in fit.links)
    urdf = robot.tree.masses[list(fit.links)]
    p = _p(fit.chi2, fit.dof)
    objections = (*_whole(fit, p), *_single(fit, names, urdf))
    moving = [s != NONE for s in table.support]
    spans = np.ptp(table.q[np.array(moving)], axis=0)
    joints = robot.tree.joint_names
    prismatic = {j.name for j in robot.tree.joints if j.kind is JointType.PRISMATIC}
    return MassRefit(
        links=names,
        urdf=urdf,
        masses=None if objections else fit.masses,
        cov=None if objections else fit.cov + fit.cov_cad,
        objections=objections,
        rank=fit.rank,
        condition=fit.condition,
        chi2=fit.chi2,
        dof=fit.dof,
        misfit_p=p,
        ranges={joints[i]: float(spans[i]) for i in np.argsort(spans, kind="stable")},
        slides=tuple(name for name in joints if name in prismatic),
        determined=determined_sums(free),
        determined_p=_p(free.chi2, free.dof),
    )


def _whole(fit: MassFit, p: float) -> Iterator[Objection]:
    """Yield what speaks against the fit as a whole."""
    n = len(fit.links)
    if fit.rank < n:
        yield Objection(
            "", f"the poses determine {fit.rank} combinations of the {n} masses, not each of them"
        )
    if p < MISFIT:
        yield Objection(
            "",
            f"the misfit is beyond the noise (chi2 {fit.chi2:.0f} for {fit.dof} degrees of "
            f"freedom, p = {p:.1e}, limit {MISFIT:g}), so no sigma can be trusted",
        )


def _single(fit: MassFit, names: tuple[str, ...], urdf: Array) -> Iterator[Objection]:
    """Yield what is absurd about single masses, without telling the mass."""
    share = fit.masses / urdf
    noise, cad = (TWO_SIDED_95 * sigmas(c) / urdf for c in (fit.cov, fit.cov_cad))
    for i, name in enumerate(names):
        if share[i] < 0.0:
            yield Objection(name, "the fit wants a negative mass; not reported")
        elif share[i] < LIGHTEST:
            yield Objection(name, f"the fit wants less than {_percent(LIGHTEST)}; not reported")
        elif share[i] > HEAVIEST:
            yield Objection(name, f"the fit wants more than {_percent(HEAVIEST)}; not reported")
        if np.hypot(noise[i], cad[i]) > WIDEST:
            yield Objection(
                name,
                f"95 % interval of +/-{_percent(float(np.hypot(noise[i], cad[i])))} (limit "
                f"{100.0 * WIDEST:.0f} %; noise {100.0 * noise[i]:.0f} %, tolerance of the URDF's "
                f"CoMs {100.0 * cad[i]:.0f} %)",
            )


def _percent(share: float) -> str:
    return f"{100.0 * share:.0f} % of the URDF's mass"


def _p(chi2: float, dof: int) -> float:
    return float(chdtrc(dof, chi2)) if dof > 0 else float("nan")
