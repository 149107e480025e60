# SPDX-License-Identifier: Apache-2.0
"""Do the two routes agree? Judged by the sigma of their difference: they share the data."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc

from comcal.identify.adjust import Adjustment
from comcal.identify.paper_route import PaperRoute
from comcal.identify.shared_errors import shared_roots
from comcal.identify.solution import rotated_moment_functional, sigmas
from comcal.measure.table import PoseTable
from comcal.robot.tree import Array
from comcal.statics.planar import placed_configurations, segment_com

SIGNIFICANT = 1e-3
"""Probability below which the two routes contradict one another."""


@dataclass(frozen=True)
class RouteDifference:
    """Cramer minus all data, segment by segment.

    Parameters
    ----------
    names : tuple of str
        ``SEGMENT r``, ``SEGMENT l``.
    cramer, lstsq : array, shape (2 n_segments,)
        r and l of each segment relative to its anchor joint [m].
    lstsq_sigma : array, shape (2 n_segments,)
        [m]
    cov : array, shape (2 n_segments, 2 n_segments)
        (L1 - L2) C (L1 - L2)^T, C the covariance of the shared measurements, tares included; plus
        what the CAD values of the feet add to Cramer [m^2].
    p : float
        Probability of a difference at least as large.
    """

    names: tuple[str, ...]
    cramer: Array
    lstsq: Array
    lstsq_sigma: Array
    cov: Array
    p: float

    @property
    def sigma(self) -> Array:
        """Standard deviation of each difference [m]."""
        return np.sqrt(np.diag(self.cov))

    @property
    def agree(self) -> bool:
        """Whether the difference is within its own uncertainty."""
        return self.p > SIGNIFICANT


def route_difference(
    fit: Adjustment, paper: PaperRoute, table: PoseTable
) -> RouteDifference | None:
    """Compare the best Cramer choice with the all-data fit; None where either says nothing.

    Poses whose CoM was given without force sensors share no measurements with the fit.
    """
    chain = paper.chain
    if chain is None or not paper.choices or any(t.by == "given" for t in paper.totals):
        return None
    configurations = [t.configuration for t in paper.totals]
    q = table.q[[c.rows[0] for c in configurations]]
    at = placed_configurations(chain.robot, configurations, q)
    functionals = [
        rotated_moment_functional(fit.unknowns, s.links, at.R[0]) for s in chain.segments
    ]
    moments = np.array([L @ fit.theta + known for L, known in functionals])
    w = segment_com(chain, at, moments[:, 2] + 1j * moments[:, 0])
    zero = segment_com(chain, at, np.zeros(len(w), np.complex128))
    rows: list[Array] = []
    for v, (L, _) in enumerate(functionals):
        one = np.zeros(len(w), np.complex128)
        one[v] = 1.0
        turned = (segment_com(chain, at, one) - zero)[v] * (L[2] + 1j * L[0])
        rows += [turned.imag, turned.real]
    to_segments = np.array(rows)

    # Both routes as linear functions of the same inputs, in the layout of the fit's groups.
    width = to_segments.shape[0]
    position = {
        row: (g, i) for g, group in enumerate(fit.groups) for i, row in enumerate(group.rows)
    }
    by_paper = [np.zeros((len(g.rows), width, g.cov.shape[1])) for g in fit.groups]
    column = 0
    for row in paper.rows:
        g, i = position[row]
        n = fit.groups[g].layout.q_columns.stop
        by_paper[g][i, :, :n] = paper.sensitivity[:, column : column + n]
        column += n
    cov, shared = paper.cov_cad.copy(), 0.0
    roots = shared_roots(fit.groups)
    for group, sensitivity, L1, root in zip(
        fit.groups, fit.sensitivity, by_paper, roots, strict=True
    ):
        D = L1 - to_segments @ sensitivity
        cov += np.einsum("nij,njk,nlk->il", D, group.cov, D, optimize=True)
        shared = shared + np.sum(D @ root, axis=0)
    cov += shared @ np.transpose(shared)
    best = paper.choices[0].w
    cramer = np.stack([best.imag, best.real], axis=1).ravel()
    lstsq = np.stack([w.imag, w.real], axis=1).ravel()
    value, vector = np.linalg.eigh(cov)
    firm = value > 1e-9 * value[-1]
    chi2 = float(np.sum((vector[:, firm].T @ (cramer - lstsq)) ** 2 / value[firm]))
    names = tuple(f"{s.name(chain.robot)} {a}" for s in chain.segments for a in "rl")
    sigma = sigmas(to_segments @ (fit.cov + fit.cov_cad) @ to_segments.T)
    return RouteDifference(names, cramer, lstsq, sigma, cov, float(chdtrc(int(firm.sum()), chi2)))
