# SPDX-License-Identifier: Apache-2.0
r"""Between the vectors R of the equivalent chain and the masses and first moments of the bodies.

Times the total mass M, R is linear in the :math:`(m, h)` of every body (Cotton 2008, eqs. (2)-(3),
for any tree):

.. math:: M\,R = L\,(m_0, h_0, m_1, h_1, \dots)

A vector ``r_k`` collects the first moments of all bodies that turn as one, and, for each joint that
hangs on them, the mass beyond times the vector to that joint. The share of a sliding joint is the
mass beyond it alone. So with geometry and masses known, R gives the first moment of each body,
except that bodies joined by sliding joints give only their sum, and a planar chain says nothing
about first moments along its normal: :func:`undetermined_moments`.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg

from comcal.errors import ConfigError, DataError
from comcal.robot.bodies import Bodies
from comcal.robot.tree import Array
from comcal.statics.sesc import SescChain


def moment_matrix(chain: SescChain) -> Array:
    """Return L: what a mass or a first moment of a body adds to R, times the total mass.

    Returns
    -------
    L : array, shape (chain.size, 4 n_bodies)
        Columns in the order of ``chain.tree.bodies.labels``.

    Raises
    ------
    ConfigError
        If lengths are unknown (chains without URDF).
    """
    tree = chain.tree
    if not tree.geometry_known:
        raise ConfigError(
            "the lengths of the links are not known, so R says nothing about single links",
            where=tree.name,
            next_step="give a URDF",
        )
    bodies = tree.bodies
    turning, R_turning_body = _turning_bodies(bodies)
    width = chain.basis.shape[2]
    L = np.zeros((chain.size, len(bodies), 4))
    vectors = L[: len(chain.bodies) * width].reshape(len(chain.bodies), width, len(bodies), 4)
    row = {leader: i for i, leader in enumerate(chain.bodies)}
    for b in range(len(bodies)):
        k = row[bodies.leaders[turning[b]]]
        vectors[k, :, b, 1:] += chain.basis[k].T @ R_turning_body[b]
        if b == 0:
            continue
        parent = bodies.parents[b]
        k = row[bodies.leaders[turning[parent]]]
        to_joint = R_turning_body[parent] @ bodies.motions[b - 1, 0, 1:, 0]
        beyond = bodies.descendants[b]
        vectors[k][:, beyond, 0] += (chain.basis[k].T @ to_joint)[:, None]
    first = len(chain.bodies) * width
    for i, joint in enumerate(chain.slides):
        L[first + i, bodies.descendants[bodies.of_link[joint + 1]], 0] = 1.0
    return L.reshape(chain.size, -1)


def r_from_moments(chain: SescChain, moments: Array) -> Array:
    """Return R of bodies with given masses and first moments.

    Parameters
    ----------
    chain : SescChain
    moments : array, shape (n_bodies, 4)
        Mass [kg] and first moments [kg m] of each body in its leader's frame, as
        ``tree.bodies.moments`` or as identified.

    Returns
    -------
    r : array, shape (chain.size,)
        [m]; shares of sliding joints [1].

    Raises
    ------
    ConfigError
        As of :func:`moment_matrix`.
    DataError
        If the masses do not add up to a positive number.
    """
    return moment_matrix(chain) @ moments.ravel() / _total(chain, moments)


def moments_from_r(chain: SescChain, r: Array, prior: Array) -> Array:
    """Return the first moments nearest to *prior* that have the vectors R.

    Parameters
    ----------
    chain : SescChain
    r : array, shape (chain.size,)
        Shares of sliding joints are not used: the masses say what they are.
    prior : array, shape (n_bodies, 4)
        Masses [kg], which are kept, and first moments [kg m]. Along the directions of
        :func:`undetermined_moments` the prior's first moments stay; they are not measured.

    Returns
    -------
    moments : array, shape (n_bodies, 4)
        The CoM of a body with mass is ``moments[:, 1:] / moments[:, :1]`` in its leader's frame;
        links joined by fixed joints are one body and have no CoM of their own here.

    Raises
    ------
    ConfigError, DataError
        As of :func:`r_from_moments`.
    """
    L = moment_matrix(chain)
    vectors = slice(0, chain.size - len(chain.slides))
    missing = (r * _total(chain, prior) - L @ prior.ravel())[vectors]
    to_moments = L.reshape(chain.size, -1, 4)[vectors, :, 1:].reshape(len(missing), -1)
    moments = prior.copy()
    moments[:, 1:] += np.linalg.lstsq(to_moments, missing, rcond=None)[0].reshape(-1, 3)
    return moments


def undetermined_moments(chain: SescChain) -> Array:
    """Return the changes of first moments that R does not show, masses being known.

    Returns
    -------
    directions : array, shape (n, 4 n_bodies)
        Orthonormal; n = 3 for every sliding joint, on a planar chain 1 more for every other body
        (along the normal). In the order of ``chain.tree.bodies.labels``, masses zero.

    Raises
    ------
    ConfigError
        As of :func:`moment_matrix`.
    """
    n_bodies = len(chain.tree.bodies)
    L = moment_matrix(chain).reshape(chain.size, n_bodies, 4)
    hidden = scipy.linalg.null_space(L[:, :, 1:].reshape(chain.size, 3 * n_bodies)).T
    directions = np.zeros((len(hidden), n_bodies, 4))
    directions[:, :, 1:] = hidden.reshape(len(hidden), n_bodies, 3)
    return directions.reshape(len(hidden), 4 * n_bodies)


def _total(chain: SescChain, moments: Array) -> float:
    total = float(moments[:, 0].sum())
    if not total > 0.0:
        raise DataError(
            "the masses of the bodies do not add up to a positive number",
            where=chain.tree.name,
            measured=f"{total:g} kg",
            limit="above 0",
            next_step="give masses from the URDF, or identify them first",
        )
    return total


def _turning_bodies(bodies: Bodies) -> tuple[list[int], Array]:
    """Return for each body the one it turns with, and its constant rotation against that one."""
    turning = list(range(len(bodies)))
    rotation = np.tile(np.eye(3), (len(bodies), 1, 1))
    for b in range(1, len(bodies)):
        if bodies.slides[b - 1]:
            parent = bodies.parents[b]
            turning[b] = turning[parent]
            rotation[b] = rotation[parent] @ bodies.motions[b - 1, 0, 1:, 1:]
    return turning, rotation
