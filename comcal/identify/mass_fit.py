# SPDX-License-Identifier: Apache-2.0
"""Link masses from static poses, CoMs kept where the URDF has them: what is so often tried.

The rows are those of :mod:`comcal.statics.balance`, linear in the masses when every link's CoM is
given, and weighted as in :mod:`comcal.identify.adjust`: with the full covariance of each pose,
at adjusted inputs. Whether the answer may be believed is judged in
:mod:`comcal.identify.mass_refit`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from comcal.errors import RankError
from comcal.identify.adjust import CONVERGED, ITERATIONS, NOISE_RATIO, RELATIVE_RANK
from comcal.identify.groups import Group
from comcal.identify.unknowns import unknowns_of
from comcal.robot.model import Robot
from comcal.robot.tree import Array
from comcal.statics.balance import (
    Balance,
    balance_at,
    input_jacobian,
    moment_regressor,
    residual,
)

STEP = 1e-5
"""Step of the numerical derivatives with respect to inputs [N, N m, rad, m]."""


@dataclass(frozen=True)
class MassFit:
    """Masses as the rows want them, believable or not.

    Parameters
    ----------
    links : tuple of int
        Links whose mass was free, in tree order; the others keep the URDF's.
    masses : array, shape (n,)
        [kg]; along directions that no row reacts to at all, the URDF's.
    cov : array, shape (n, n)
        From measurement noise alone [kg^2].
    cov_cad : array, shape (n, n)
        What the tolerance of the URDF's CoMs, which the fit takes for exact, does to the masses
        [kg^2].
    rank : int
        Number of combinations of masses that the poses determine beyond what noise would feign.
        The fit itself uses every direction that rounding allows, as people do.
    condition : float
        Best over worst singular value, masses in units of the URDF's; infinite where no row
        reacts to some direction.
    chi2, dof
        Weighted sum of squared residuals and its degrees of freedom.
    """

    links: tuple[int, ...]
    masses: Array
    cov: Array
    cov_cad: Array
    rank: int
    condition: float
    chi2: float
    dof: int


@dataclass(frozen=True)
class _Rows:
    """One group's rows at a linearisation point; A with respect to masses, D to CoMs."""

    misclosure: Array
    A: Array
    B: Array
    D: Array
    W: Array


def fit_masses(robot: Robot, groups: Sequence[Group]) -> MassFit:
    """Fit the masses of all carried links that are not negligible.

    Parameters
    ----------
    robot : Robot
    groups : sequence of Group
        Standing poses, see :func:`comcal.identify.groups.groups_of`.

    Raises
    ------
    RankError
        If there is no pose in which a sensor is loaded.
    """
    if not groups:
        raise RankError(
            "no pose in which a foot with a sensor stands",
            next_step="record poses with support 'double' or one foot",
        )
    links = unknowns_of(robot).links
    at = list(links)
    urdf = robot.tree.masses[at]
    inputs = [group.inputs for group in groups]
    masses, iterations = urdf, 0
    seen, rank = _seen(robot, links, groups, urdf)
    while True:
        iterations += 1
        rows = [_rows(robot, links, g, masses, x) for g, x in zip(groups, inputs, strict=True)]
        value, turn = np.linalg.eigh(seen.T @ _scaled_information(rows, urdf) @ seen)
        basis = seen @ turn
        cov = (urdf[:, None] * basis / value) @ (basis.T * urdf)
        step = -cov @ sum(np.einsum("nij,nik,nk->j", r.A, r.W, r.misclosure) for r in rows)
        masses = masses + step
        left = [r.misclosure + r.A @ step for r in rows]
        inputs = [
            g.inputs - np.einsum("nij,nkj,nkl,nl->ni", g.cov, r.B, r.W, e, optimize=True)
            for g, r, e in zip(groups, rows, left, strict=True)
        ]
        in_sigmas = np.sqrt(value) * np.abs(basis.T @ (step / urdf))
        if iterations >= ITERATIONS or bool(np.all(in_sigmas < CONVERGED)):
            break
    by_com = -cov @ sum(np.einsum("nij,nik,nkl->jl", r.A, r.W, r.D, optimize=True) for r in rows)
    full = len(value) == len(links)
    return MassFit(
        links=links,
        masses=masses,
        cov=cov,
        cov_cad=robot.tolerances.link_com**2 * by_com @ by_com.T,
        rank=rank,
        condition=float(np.sqrt(value[-1] / value[0])) if full else np.inf,
        chi2=sum(
            float(np.einsum("ni,nij,nj->", e, r.W, e)) for e, r in zip(left, rows, strict=True)
        ),
        dof=sum(4 * len(group.rows) for group in groups) - len(value),
    )


def with_masses(robot: Robot, links: Sequence[int], masses: Array) -> Robot:
    """Return *robot* with other masses for some links, everything else unchanged.

    Parameters
    ----------
    links : sequence of int
    masses : array, shape (n,)
        [kg]
    """
    new = list(robot.tree.links)
    for k, mass in zip(links, masses, strict=True):
        new[k] = replace(new[k], mass=float(mass))
    return replace(robot, tree=replace(robot.tree, links=tuple(new)))


def _rows(
    robot: Robot, links: tuple[int, ...], group: Group, masses: Array, inputs: Array
) -> _Rows:
    robot = with_masses(robot, links, masses)
    tree = robot.tree
    w, q = group.split(inputs)
    balance = balance_at(robot, group.carrier, q, w)
    h = tree.masses[:, None] * tree.coms
    B_w, B_q = input_jacobian(balance, h)
    B = np.concatenate([B_w.reshape(len(w), 4, -1), B_q], axis=2)
    carried = float(tree.masses[group.carrier.carried].sum())
    D = np.zeros((len(w), 4, 3 * len(tree.links)))
    by_moment = moment_regressor(balance, balance.direction)
    D[:, 1:] = (by_moment * tree.masses[:, None]).reshape(len(w), 3, -1)
    return _Rows(
        misclosure=residual(balance, carried, h)
        + np.einsum("nij,nj->ni", B, group.inputs - inputs),
        A=_regressor(balance, links),
        B=B,
        D=D,
        W=np.asarray(np.linalg.inv(B @ group.cov @ np.swapaxes(B, 1, 2)), np.float64),
    )


def _regressor(balance: Balance, links: tuple[int, ...]) -> Array:
    """Return d(residual)/d(m_k): -g for the force, -g c_k x f for the moment, (N, 4, n)."""
    at = list(links)
    g = balance.robot.gravity
    A = np.full((len(balance.F), 4, len(at)), -g)
    coms = balance.placements.coms[:, at]
    A[:, 1:] = -g * np.swapaxes(np.cross(coms, balance.direction[:, None]), 1, 2)
    return A * balance.carrier.carried[at]


def _seen(
    robot: Robot, links: tuple[int, ...], groups: Sequence[Group], urdf: Array
) -> tuple[Array, int]:
    """Return a basis of what any row reacts to, in units of the URDF's masses, and the rank.

    Errors of angles and force directions feign information; directions that owe most of theirs to
    such errors do not count in the rank.
    """
    rows = [_rows(robot, links, group, urdf, group.inputs) for group in groups]
    value, vector = np.linalg.eigh(_scaled_information(rows, urdf))
    feigned = np.zeros((len(links), len(links)))
    for group, r in zip(groups, rows, strict=True):
        dA = _by_inputs(robot, links, group)
        feigned += np.einsum("nab,anij,nik,bnkl->jl", group.cov, dA, r.W, dA, optimize=True)
    noise = np.einsum("ik,ij,jk->k", vector, feigned * np.outer(urdf, urdf), vector)
    reacts = value > RELATIVE_RANK**2 * value[-1]
    return vector[:, reacts], int(np.sum(reacts & (value > NOISE_RATIO * noise)))


def _by_inputs(robot: Robot, links: tuple[int, ...], group: Group) -> Array:
    """Return d(regressor)/d(inputs) by central differences, shape (n_inputs, N, 4, n)."""

    def at(inputs: Array) -> Array:
        w, q = group.split(inputs)
        return _regressor(balance_at(robot, group.carrier, q, w), links)

    moves = STEP * np.eye(group.inputs.shape[1])
    return np.stack([at(group.inputs + m) - at(group.inputs - m) for m in moves]) / (2.0 * STEP)


def _scaled_information(rows: Sequence[_Rows], urdf: Array) -> Array:
    information = sum(np.einsum("nji,njk,nkl->il", r.A, r.W, r.A, optimize=True) for r in rows)
    return np.outer(urdf, urdf) * information
