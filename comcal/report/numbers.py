# SPDX-License-Identifier: Apache-2.0
"""Numbers as text, with the digits that their sigma is worth."""

from __future__ import annotations

import numpy as np

from comcal.report.console import PLUS_MINUS


def plus_minus(value: float, sigma: float, factor: float = 1.0) -> str:
    """Return value and sigma with as many decimals as two digits of sigma need.

    Parameters
    ----------
    value, sigma : float
        Without a sigma (NaN, zero) the value stands alone; NaN is a dash.
    factor : float
        Multiplies both: 1e3 for millimetres.
    """
    value, sigma = value * factor, sigma * factor
    if not np.isfinite(value):
        return "-"
    if not np.isfinite(sigma) or sigma <= 0:
        return f"{value:.3f}"
    decimals = int(np.clip(1 - np.floor(np.log10(sigma)), 0, 4))
    value = round(value, decimals) + 0.0  # without the sign of a zero
    return f"{value:.{decimals}f}{PLUS_MINUS}{sigma:.{decimals}f}"
