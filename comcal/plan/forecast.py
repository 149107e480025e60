# SPDX-License-Identifier: Apache-2.0
"""What a calibration will know after a set of poses, said before the robot moves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from comcal.identify.adjust import Adjustment
from comcal.identify.cad_inputs import cad_inputs
from comcal.identify.solution import SEEN_SHARE, sigmas, total_com_at
from comcal.identify.unknowns import Unknowns
from comcal.identify.words import Combination, combinations_of
from comcal.measure.table import PoseTable
from comcal.plan.candidates import Pool
from comcal.plan.information import predicted_fit
from comcal.robot.tree import Array


@dataclass(frozen=True)
class LinkForecast:
    """What will be known of one link's CoM, in its URDF frame.

    Parameters
    ----------
    mass : float
        From the URDF, of all that is fixed to the link [kg].
    sigma : array, shape (3,)
        [m]; NaN for a component that is not determined by itself.
    source : tuple of str or None, length 3
        ``measured``, ``combination``, or None where nothing is seen.
    """

    link: str
    mass: float
    sigma: Array
    source: tuple[str | None, str | None, str | None]


@dataclass(frozen=True)
class Forecast:
    """Predicted accuracy of a set of poses.

    Parameters
    ----------
    poses : int
    rank, unknowns : int
    condition : float
    mass_sigma : float
        Of the whole robot [kg].
    links : tuple of LinkForecast
    sums : tuple of Combination
        Of what is determined only together; first moments [kg m].
    total_com : array, shape (3,)
        Root mean square standard error of the whole robot's CoM in P over other balanced poses, of
        what poses determine [m].
    total_com_cad : array, shape (3,)
        What the URDF's own tolerances add to it along directions that no pose determines [m].
    """

    poses: int
    rank: int
    unknowns: int
    condition: float
    mass_sigma: float
    links: tuple[LinkForecast, ...]
    sums: tuple[Combination, ...]
    total_com: Array
    total_com_cad: Array


def forecast(unknowns: Unknowns, held_out: Pool, *tables: PoseTable) -> Forecast:
    """Predict what a calibration of some poses will know.

    Parameters
    ----------
    unknowns : Unknowns
    held_out : Pool
        Other balanced poses, in which the total CoM is predicted.
    *tables : PoseTable
        Planned and recorded poses.
    """
    fit = predicted_fit(unknowns, *tables)
    inputs = cad_inputs(fit)
    cov = fit.cov + fit.cov_cad + inputs.cov
    combinations = combinations_of(fit)
    in_sums = {name for c in combinations for name in c.coefficients}
    every = np.ones(len(unknowns.robot.tree.links), np.bool_)
    by_mass, _ = unknowns.mass_functional(every)
    noise, cad = list[Array](), list[Array]()
    for support in sorted(set(held_out.support)):
        q = held_out.q[[s == support for s in held_out.support]]
        _, by_noise, by_cad = total_com_at(fit, inputs, support, q)
        noise.append(np.einsum("nii->ni", by_noise))
        cad.append(np.einsum("nii->ni", by_cad))
    return Forecast(
        poses=sum(len(table) for table in tables),
        rank=fit.rank,
        unknowns=unknowns.size,
        condition=fit.condition,
        mass_sigma=float(np.sqrt(by_mass @ cov @ by_mass)),
        links=tuple(_link(fit, i, cov, in_sums) for i in range(len(unknowns.links))),
        sums=tuple(c for c in combinations if len(c.coefficients) > 1),
        total_com=np.sqrt(np.concatenate(noise).mean(axis=0)),
        total_com_cad=np.sqrt(np.concatenate(cad).mean(axis=0)),
    )


def _link(fit: Adjustment, i: int, cov: Array, in_sums: set[str]) -> LinkForecast:
    unknowns = fit.unknowns
    k, mass = unknowns.links[i], float(unknowns.body_masses[i])
    first = unknowns.column(k) or 0
    at = slice(first, first + 3)
    functional = np.eye(unknowns.size)[at]
    column = unknowns.mass_column(k)
    if column is not None:
        functional[:, column] = -unknowns.robot.tree.coms[k]
    seen = fit.visibility(functional) < SEEN_SHARE
    sigma = np.where(seen, sigmas(functional @ cov @ functional.T) / mass, np.nan)
    source = [
        "measured" if is_seen else "combination" if name in in_sums else None
        for is_seen, name in zip(seen, unknowns.names[at], strict=True)
    ]
    name = unknowns.robot.tree.links[k].name
    return LinkForecast(name, mass, sigma, (source[0], source[1], source[2]))
