# SPDX-License-Identifier: Apache-2.0
"""Inverse kinematics of one leg in its own plane."""

from __future__ import annotations

import numpy as np

from comcal.errors import UsageError


def two_link_tilts(
    shin: float, thigh: float, dx: float, dz: float, *, where: str
) -> tuple[float, float]:
    """Return the tilts of shin and thigh that put the hip at (dx, dz) from the ankle.

    Parameters
    ----------
    shin, thigh : float
        Lengths [m].
    dx, dz : float
        Hip relative to the ankle, toes-ward and up [m].
    where : str
        Name of the leg, for the message.

    Returns
    -------
    shin_tilt, thigh_tilt : float
        Absolute, positive toes-ward [rad], with the knee in front of the line ankle - hip.

    Raises
    ------
    UsageError
        If that point is out of reach.

    Notes
    -----
    Law of cosines in the triangle ankle - knee - hip.
    """
    reach = float(np.hypot(dx, dz))
    shortest, longest = abs(shin - thigh), shin + thigh
    if not shortest < reach < longest:
        raise UsageError(
            "the leg does not reach",
            where=where,
            measured=f"hip {reach:.4f} m from the ankle",
            limit=f"{shortest:.4f} to {longest:.4f} m",
            next_step="lower the hip or move the feet closer to it",
        )
    line = float(np.arctan2(dx, dz))
    at_ankle = float(np.arccos((shin**2 + reach**2 - thigh**2) / (2 * shin * reach)))
    at_hip = float(np.arccos((thigh**2 + reach**2 - shin**2) / (2 * thigh * reach)))
    return line + at_ankle, line - at_hip
