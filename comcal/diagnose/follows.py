# SPDX-License-Identifier: Apache-2.0
"""What numbers of several poses go along with, in words."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from comcal.robot.tree import Array

ENOUGH = 6
"""Poses from which a correlation means anything."""


def companion(values: Array, others: Iterable[tuple[str, Array]], least: float) -> str:
    """Return the name of what *values* follow most closely; empty where nothing does.

    Parameters
    ----------
    values : array, shape (N,)
    others : iterable of (str, array of shape (N,))
        Those that are constant, or not known in every pose, are passed over.
    least : float
        Smallest correlation, of either sign.
    """
    best, found = least, ""
    if len(values) < ENOUGH or not np.ptp(values) > 0.0:
        return found
    for name, other in others:
        if np.isfinite(other).all() and np.ptp(other) > 0.0:
            correlation = abs(float(np.corrcoef(values, other)[0, 1]))
            if correlation > best:
                best, found = correlation, name
    return found
