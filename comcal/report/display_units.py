# SPDX-License-Identifier: Apache-2.0
"""Units in which people read: degrees and millimetres where files have radians and metres."""

from __future__ import annotations

import math

_SHOWN = {
    "rad": (180.0 / math.pi, "deg"),
    "m": (1e3, "mm"),
    "rad/(N m)": (180e3 / math.pi, "mdeg/(N m)"),
    "kg m": (1e3, "kg mm"),
    "N/s": (60.0, "N/min"),
    "N m/s": (60.0, "N m/min"),
    "1": (1e2, "%"),
}
PLAIN_RATIOS = ("factor",)
"""Keys of ratios that are read as they are, not in per cent."""


def shown_unit(unit: str, key: str = "") -> tuple[float, str]:
    """Return the factor from a unit of a file to the one that is printed, and its name.

    Parameters
    ----------
    unit : str
        SI, as files have it.
    key : str
        Parameter, where that decides.

    Examples
    --------
    >>> shown_unit("m")
    (1000.0, 'mm')
    """
    if unit == "1" and key in PLAIN_RATIOS:
        return 1.0, ""
    return _SHOWN.get(unit, (1.0, "" if unit == "SI" else unit))
