# SPDX-License-Identifier: Apache-2.0
"""The all-data route: mass, link CoMs, total CoMs, each with what is and is not determined."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import chdtrc

from comcal.identify.adjust import Adjustment, adjust
from comcal.identify.cad_inputs import CadInputs, cad_inputs
from comcal.identify.held_out import HeldOut, held_out_error, named_error
from comcal.identify.scope import Scope, scoped
from comcal.identify.unknowns import Unknowns, rigid_parts
from comcal.identify.words import Combination, Unseen, combinations_of, unseen_directions
from comcal.measure.plan import NONE
from comcal.measure.table import PoseTable
from comcal.robot.frames import apply
from comcal.robot.model import Robot
from comcal.robot.tree import Array
from comcal.statics.configurations import placed_in_stance
from comcal.statics.joint_slopes import joint_slopes
from comcal.statics.support import Carrier, carrier_of

MEASURED, COMBINATION, PRIOR = "measured", "combination", "prior"

SEEN_SHARE = 0.1
"""A component counts as measured when less than this share of it lies in unseen directions. Noise
turns those by a few per cent; the share of real sums is a quarter or more. What is left of them
is part of the printed sigma, at the tolerance that CAD has."""


@dataclass(frozen=True)
class LinkCom:
    """CoM of one link in its URDF frame.

    Parameters
    ----------
    mass : float
        From the URDF [kg], or measured where masses are free.
    com : array, shape (3,)
        [m]; NaN where it is neither determined by itself nor taken from the URDF.
    cov : array, shape (3, 3)
        [m^2], from noise and CAD; NaN in rows and columns of components without a value.
    identifiable : array of bool, shape (3,)
    source : tuple of str or None, length 3
        ``measured``; ``prior`` (URDF: links below a cut, negligible links); ``combination`` (only
        a sum with other links is determined); None (not seen at all).
    mass_sigma : float
        [kg]; NaN where it is not measured.
    mass_source : str
        ``prior`` (URDF), ``measured``, or ``combination``, where the mass stays the URDF's.
    members : tuple of str
        Links fixed to this one: it takes what they deviate from the URDF.
    """

    link: str
    mass: float
    com: Array
    cov: Array
    identifiable: npt.NDArray[np.bool_]
    source: tuple[str | None, str | None, str | None]
    mass_sigma: float = np.nan
    mass_source: str = PRIOR
    members: tuple[str, ...] = ()


@dataclass(frozen=True)
class PoseCom:
    """Total CoM in one pose, in P.

    Parameters
    ----------
    xyz, carried_xyz : array, shape (3,)
        Of the whole robot and of what the sensors carry [m].
    cov, cov_cad : array, shape (3, 3)
        From measurement noise (the encoder errors of this pose included, their correlation with
        the fit neglected), and from CAD along directions that the poses do not determine.
    """

    row: int
    pose: int
    xyz: Array
    carried_xyz: Array
    cov: Array
    cov_cad: Array


@dataclass(frozen=True)
class Solution:
    """Everything that the all-data route determines.

    Parameters
    ----------
    mass, mass_sigma : float
        Of the whole robot [kg]; sigma from noise and from the masses below the cuts. NaN where no
        pose says anything about it, as joint torques alone do not.
    scope : Scope
        What was used and looked for.
    misfit_p : float
        Probability of a misfit at least as large if model and noise are right.
    """

    adjustment: Adjustment
    mass: float
    mass_sigma: float
    links: tuple[LinkCom, ...]
    poses: tuple[PoseCom, ...]
    combinations: tuple[Combination, ...]
    unseen: tuple[Unseen, ...]
    held_out: HeldOut
    misfit_p: float
    scope: Scope


def solve_all(
    robot: Robot,
    table: PoseTable,
    scope: Scope | None = None,
    *,
    links_only: bool = False,
    held_out: PoseTable | None = None,
) -> Solution:
    """Fit every pose at once.

    Parameters
    ----------
    robot : Robot
    table : PoseTable
    scope : Scope, optional
        By default the balance of standing poses, for the mass of the robot and first moments.
    links_only : bool
        Leave out what takes most of the time: total CoMs of the poses, directions that they do not
        determine and the error on held-out poses (then of no pose).
    held_out : PoseTable, optional
        Poses to predict and not to fit; by default those of *table* are left out in turn.

    Raises
    ------
    RankError
        If no pose loads a sensor.
    MissingColumnError, NotFiniteError, DataError
        If the wrench or the error of a loaded sensor is not known.
    """
    scope = scope or Scope()
    unknowns, groups = scoped(robot, table, scope)
    fit = adjust(robot, unknowns, groups)
    inputs = cad_inputs(fit)
    from_cad = inputs.cov
    combinations = combinations_of(fit)
    mass, mass_sigma = _mass(fit, from_cad)
    in_sums = {name for combination in combinations for name in combination.coefficients}
    judged = () if links_only else groups
    if held_out is None:
        left_out = held_out_error(robot, unknowns, judged, fit.rank)
    else:
        left_out = named_error(robot, unknowns, scoped(robot, held_out, scope)[1], fit.theta)
    return Solution(
        adjustment=fit,
        mass=mass,
        mass_sigma=mass_sigma,
        links=tuple(_link(fit, k, from_cad, in_sums) for k in range(len(robot.tree.links))),
        poses=tuple(
            _pose(fit, inputs, table, i)
            for i, support in enumerate(table.support)
            if support != NONE and not links_only
        ),
        combinations=combinations,
        unseen=() if links_only else unseen_directions(fit),
        held_out=left_out,
        misfit_p=float(chdtrc(fit.dof, fit.chi2)) if fit.dof > 0 else float("nan"),
        scope=scope,
    )


def total_com_functional(
    unknowns: Unknowns, carrier: Carrier, q: Array, *, whole: bool
) -> tuple[Array, Array, Array]:
    """Return the first moment about the root as an affine function of theta, in the axes of P.

    The balance is one about the root's origin. Where the masses of the links do not add up to the
    measured mass, only the moment about that point is determined; to move it takes the measured
    mass, not the sum.

    Parameters
    ----------
    q : array, shape (N, n_joints)
    whole : bool
        Count the whole robot instead of what the sensors carry.

    Returns
    -------
    L : array, shape (N, 3, size)
    known : array, shape (N, 3)
        First moment = L theta + known [kg m].
    root : array, shape (N, 3)
        Origin of the root link in P [m].
    """
    robot = unknowns.robot
    at = placed_in_stance(robot, carrier, q)
    counted = np.ones_like(carrier.carried) if whole else carrier.carried
    masses = robot.tree.masses * counted
    free = np.zeros(len(masses), dtype=np.bool_)
    free[list(unknowns.links)] = True
    arms = at.p - at.p[:, :1]
    given = masses * ~free if unknowns.free_masses else masses
    known = np.einsum("k,nki->ni", given, arms)
    known += np.einsum("nkij,kj->ni", at.R, (masses * ~free)[:, None] * robot.tree.coms)
    L = np.zeros((len(q), 3, unknowns.size))
    for k in unknowns.links:
        column, mass_column = unknowns.column(k), unknowns.mass_column(k)
        if counted[k] and column is not None:
            L[:, :, column : column + 3] = at.R[:, k]
        if counted[k] and mass_column is not None:
            L[:, :, mass_column] = arms[:, k]
    return L, known, at.p[:, 0]


def total_com_at(
    fit: Adjustment, inputs: CadInputs, support: str, q: Array
) -> tuple[Array, Array, Array]:
    """Return the whole robot's CoM at exactly known angles, in P.

    Parameters
    ----------
    fit : Adjustment
    inputs : CadInputs
        Of the same fit.
    support : str
    q : array, shape (N, n_joints)

    Returns
    -------
    xyz : array, shape (N, 3)
        [m]
    cov, cov_cad : array, shape (N, 3, 3)
        From measurement noise; and from CAD, along directions that the poses do not determine and
        through the links whose values are taken from it.
    """
    unknowns = fit.unknowns
    tree = unknowns.robot.tree
    carrier = carrier_of(unknowns.robot, support)
    L, known, root = total_com_functional(unknowns, carrier, q, whole=True)
    every = np.ones(len(tree.links), np.bool_)
    of_mass, _ = unknowns.mass_functional(every)
    mass = unknowns.mass(fit.theta)
    xyz = root + (L @ fit.theta + known) / mass
    J = (L - (xyz - root)[:, :, None] * of_mass) / mass
    # A CAD value enters through the fit, and again where the link itself is counted.
    at, given = placed_in_stance(unknowns.robot, carrier, q), list(inputs.links)
    by_mass = np.swapaxes(at.coms[:, given] - root[:, None], 1, 2)
    by_com = at.R[:, given] * tree.masses[given, None, None]
    direct = np.concatenate([by_mass, np.moveaxis(by_com, 1, 2).reshape(*xyz.shape, -1)], axis=2)
    by_input = (J @ inputs.gain + direct / mass) * inputs.sigma
    Jt = np.swapaxes(J, 1, 2)
    return xyz, J @ fit.cov @ Jt, J @ fit.cov_cad @ Jt + by_input @ np.swapaxes(by_input, 1, 2)


def _link(fit: Adjustment, k: int, from_cad: Array, in_sums: set[str]) -> LinkCom:
    unknowns = fit.unknowns
    robot = unknowns.robot
    link = robot.tree.links[k]
    column = unknowns.column(k)
    if column is None:
        known = link.has_inertial
        source = PRIOR if known else None
        nothing = np.full((3, 3), np.nan)
        return LinkCom(
            link=link.name,
            mass=link.mass,
            com=link.com if known else nothing[0],
            cov=np.eye(3) * robot.tolerances.link_com**2 if known else nothing,
            identifiable=np.zeros(3, np.bool_),
            source=(source, source, source),
        )
    cov = fit.cov + fit.cov_cad + from_cad
    at = slice(column, column + 3)
    mass, mass_sigma, mass_source = link.mass, np.nan, PRIOR
    functional = np.eye(unknowns.size)[at]
    mass_column = unknowns.mass_column(k)
    if mass_column is not None:
        mass_source = COMBINATION
        if fit.visibility(np.eye(unknowns.size)[mass_column]) < SEEN_SHARE:
            mass, mass_source = float(fit.theta[mass_column]), MEASURED
            mass_sigma = float(np.sqrt(cov[mass_column, mass_column]))
        # d(h / m) = (dh - c dm) / m: what a CoM needs to be measured.
        functional[:, mass_column] = -fit.theta[at] / mass
    seen = fit.visibility(functional) < SEEN_SHARE
    both = np.outer(seen, seen)
    names = [
        MEASURED if is_seen else COMBINATION if name in in_sums else None
        for is_seen, name in zip(seen, unknowns.names[at], strict=True)
    ]
    bodies = rigid_parts(robot)
    return LinkCom(
        link=link.name,
        mass=mass,
        com=np.where(seen, fit.theta[at] / mass, np.nan),
        cov=np.where(both, functional @ cov @ functional.T / mass**2, np.nan),
        identifiable=seen,
        source=(names[0], names[1], names[2]),
        mass_sigma=mass_sigma,
        mass_source=mass_source,
        members=tuple(
            other.name
            for j, other in enumerate(robot.tree.links)
            if bodies[j] == bodies[k] and j != k and other.mass
        ),
    )


def _pose(fit: Adjustment, inputs: CadInputs, table: PoseTable, i: int) -> PoseCom:
    unknowns = fit.unknowns
    robot = unknowns.robot
    q, support = table.q[i][None], table.support[i]
    carrier = carrier_of(robot, support)
    xyz, cov, cov_cad = total_com_at(fit, inputs, support, q)
    L, known, root = total_com_functional(unknowns, carrier, q, whole=False)
    carried = root + (L @ fit.theta + known) / unknowns.mass(fit.theta, carrier.carried)
    J = joint_slopes(lambda moved: total_com_at(fit, inputs, support, moved)[0], q)[0]
    encoder = (J * table.q_cov[i]) @ J.T
    return PoseCom(i, table.pose[i], xyz[0], carried[0], cov[0] + encoder, cov_cad[0])


def _mass(fit: Adjustment, from_cad: Array) -> tuple[float, float]:
    """Return the mass of the whole robot and its sigma [kg]; NaN where it is not determined."""
    unknowns = fit.unknowns
    L, known = unknowns.mass_functional(np.ones(len(unknowns.robot.tree.links), np.bool_))
    if fit.visibility(L) > SEEN_SHARE:
        return np.nan, np.nan
    return float(L @ fit.theta) + known, float(np.sqrt(L @ (fit.cov + fit.cov_cad + from_cad) @ L))


def sigmas(cov: Array) -> Array:
    """Return the standard deviations of a covariance, shape (n,); rounding below zero is zero.

    Parameters
    ----------
    cov : array, shape (n, n)
    """
    return np.sqrt(np.clip(np.diag(cov), 0.0, None))


def rotated_moment_functional(
    unknowns: Unknowns, links: tuple[int, ...], R: Array
) -> tuple[Array, Array]:
    """Return sum over *links* of R_k h_k as an affine function of theta.

    Parameters
    ----------
    R : array, shape (n_links, 3, 3)

    Returns
    -------
    L : array, shape (3, size)
    known : array, shape (3,)
        What links that are not free contribute [kg m].
    """
    L, known = np.zeros((3, unknowns.size)), np.zeros(3)
    tree = unknowns.robot.tree
    for k in links:
        column = unknowns.column(k)
        if column is None:
            known += apply(R[k], tree.masses[k] * tree.coms[k])
        else:
            L[:, column : column + 3] = R[k]
    return L, known
