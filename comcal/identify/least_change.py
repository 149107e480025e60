# SPDX-License-Identifier: Apache-2.0
"""Of all models that agree with a fit in everything the poses determine, the nearest to the URDF.

Near is measured in ``tolerances.link_com``, the same length for every component of every link.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from comcal.identify.adjust import Adjustment
from comcal.identify.unknowns import Unknowns
from comcal.robot.tree import Array

KEPT_EXACTLY = 0.1
"""Largest change of a measured direction, in its sigmas, for which unseen numbers stay exactly."""


def least_change(fit: Adjustment, keep: npt.NDArray[np.bool_]) -> tuple[Array, bool]:
    """Return the unknowns nearest to the URDF that have the fit's values in all seen directions.

    Masses and tares are no CoMs to be shared out: they stay as fitted. Noise turns seen directions
    a little towards unknowns that no pose speaks about; those are kept all the same, and the
    others make up for it.

    Parameters
    ----------
    fit : Adjustment
    keep : array of bool, shape (size,)
        First moments whose CoM is to stay exactly as the URDF has it.

    Returns
    -------
    theta : array, shape (size,)
        [kg], [kg m]
    kept : bool
        Whether that was possible within a tenth of a sigma. If not, *theta* is the fit as it is.
    """
    unknowns = fit.unknowns
    start, is_moment = _start(fit)
    free = is_moment & ~keep
    missing = fit.seen.T @ ((fit.theta - start) / unknowns.scale)
    change = np.zeros(unknowns.size)
    change[free] = np.linalg.lstsq(fit.seen[free].T, missing, rcond=KEPT_EXACTLY)[0]
    missed = np.abs(fit.singular * (fit.seen.T @ change - missing))
    if missed.size and float(missed.max()) > KEPT_EXACTLY:
        return fit.theta, False
    return start + unknowns.scale * change, True


def _start(fit: Adjustment) -> tuple[Array, npt.NDArray[np.bool_]]:
    """Return the URDF's CoMs at the fit's masses and tares, and which unknowns are moments."""
    unknowns: Unknowns = fit.unknowns
    at = slice(unknowns.n_masses, unknowns.first_offset)
    is_moment = np.zeros(unknowns.size, dtype=np.bool_)
    is_moment[at] = True
    links = list(unknowns.links)
    masses = unknowns.link_masses(fit.theta)[links]
    start = fit.theta.copy()
    start[at] = (masses[:, None] * unknowns.robot.tree.coms[links]).ravel()
    return start, is_moment
