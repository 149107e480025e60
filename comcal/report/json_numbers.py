# SPDX-License-Identifier: Apache-2.0
"""Numbers for JSON, which knows neither NaN nor infinity: both are null."""

from __future__ import annotations

from typing import Any

import numpy as np

from comcal.robot.tree import Array


def number(value: float) -> float | None:
    """Return a number, or None where it is not finite.

    Parameters
    ----------
    value : float
    """
    return float(value) if np.isfinite(value) else None


def numbers(values: Array) -> list[Any]:
    """Return an array as nested lists.

    Parameters
    ----------
    values : array, shape (...)
        One axis at least.
    """
    return [numbers(v) if np.ndim(v) else number(float(v)) for v in values]
