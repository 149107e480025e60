# SPDX-License-Identifier: Apache-2.0
"""The faults of Muscolo, Caldwell and Cannella (2017), each one a switch.

With every switch off the functions of ``published*.py`` are the corrected formulas; with
:data:`AS_PUBLISHED` they are the paper to the letter, so that its bias can be shown.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import Flag, auto
from typing import Final


class Fault(Flag):
    """What the paper prints (E1 to E5) or leaves open (E6, E7) and a robot contradicts."""

    ROW_SIGN = auto()
    """E1: (36) and row 3 of (38) subtract ``r_c cos(theta_c)``; the other rows add it."""
    NUMERATOR_ENTRY = auto()
    """E2: the last entry of the last row of (40)-(42) is ``m_c sin``; in (38) it is ``m_c cos``."""
    RIGID_BEND = auto()
    """E3: (29) gives pose c to a formula for rigid tilts, but in c only the thigh has moved."""
    TOO_FEW_POSES = auto()
    """E4: (21) k = n + 1 poses; each gives one equation, and 2n are needed."""
    INTERNAL_TORQUES = auto()
    """E5: (8), (10), (12) add the joint torques, which cancel in a balance of the whole robot."""
    MASS_WITHOUT_FEET = auto()
    """E6: the text calls m_2 the mass without the feet; (18) and the listing need it with them."""
    ONE_LEG = auto()
    """E7: the listing takes one foot, one shin, one thigh and the whole waist for the robot."""


CORRECTED: Final = Fault(0)
"""No fault."""

AS_PUBLISHED: Final = (
    Fault.ROW_SIGN
    | Fault.NUMERATOR_ENTRY
    | Fault.RIGID_BEND
    | Fault.TOO_FEW_POSES
    | Fault.INTERNAL_TORQUES
)
"""Every printed formula to the letter.

E6 and E7 are not among them: the paper contradicts itself on m_2, and its listing describes a
robot of its own. Either can be added with ``|``.
"""

FAULT_TEXT: Final[Mapping[Fault, str]] = {
    Fault.ROW_SIGN: "E1 sign of r_c in (36), (38)",
    Fault.NUMERATOR_ENTRY: "E2 last entry of (40)-(42)",
    Fault.RIGID_BEND: "E3 rigid tilt assumed in (29)",
    Fault.TOO_FEW_POSES: "E4 n + 1 poses (21)",
    Fault.INTERNAL_TORQUES: "E5 M_2 in (8)-(12)",
    Fault.MASS_WITHOUT_FEET: "E6 m_2 without the feet",
    Fault.ONE_LEG: "E7 masses of one leg",
}
"""One short line for each fault, for tables."""


def fault_codes(faults: Fault) -> str:
    """Return the codes of *faults*, such as ``E1+E2``; ``none`` if there are none."""
    return "+".join(FAULT_TEXT[f].split()[0] for f in Fault if f in faults) or "none"
