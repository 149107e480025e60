# SPDX-License-Identifier: Apache-2.0
"""The whole route of Muscolo et al. (2017) for n = 2, from coefficients to link CoMs.

Poses a (straight), b (straight, tilted about the ankles) and c (only the thigh and what it carries
bent). With faults it is what the paper prints; without, what the same steps give when they are
right, which takes a fourth pose: c tilted as a whole.
"""

from __future__ import annotations

from dataclasses import dataclass

from comcal.errors import RankError
from comcal.statics.published_chain import (
    Bends,
    LinkComs,
    PublishedChain,
    TotalCom,
    masses_under,
)
from comcal.statics.published_coefficients import TiltedLine, total_com_two_poses
from comcal.statics.published_faults import CORRECTED, Fault
from comcal.statics.published_links import link_coms_from_totals, poses_required


@dataclass(frozen=True)
class PlanarPose:
    """What one pose contributes.

    Parameters
    ----------
    shin, thigh : float
        Absolute pitch, positive to the toes [rad].
    alpha, beta : float
        Equations (10) and (11) without M_2 [m, 1], x measured from the ankle axle.
    internal : float
        M_Y2 / (F_Z0 + F_Z1) [m], which equation (10) as printed subtracts from alpha.
    """

    shin: float
    thigh: float
    alpha: float
    beta: float = 0.0
    internal: float = 0.0

    def line(self, theta: float, faults: Fault, factor: float) -> TiltedLine:
        """Return (14) for a shape tilted by *theta* [rad], with M_2 if *faults* has E5."""
        shift = factor * self.internal if Fault.INTERNAL_TORQUES in faults else 0.0
        return TiltedLine(theta, self.alpha - shift, self.beta)


@dataclass(frozen=True)
class PublishedResult:
    """Total CoM in poses b and c, in P, and the link CoMs that follow [m]."""

    b: TotalCom
    c: TotalCom
    links: LinkComs


def published_route(
    a: PlanarPose,
    b: PlanarPose,
    c: PlanarPose,
    chain: PublishedChain,
    *,
    c_tilted: PlanarPose | None = None,
    faults: Fault = CORRECTED,
    factor: float = 1.0,
) -> PublishedResult:
    """Return the link CoMs of a planar biped by equations (28)-(43).

    Parameters
    ----------
    a, b : PlanarPose
        Straight, and straight tilted about the ankles by theta_b. The paper has a upright.
    c : PlanarPose
        Thigh and all above it bent by theta_c. The paper has the shin upright.
    chain : PublishedChain
        Masses of both legs together.
    c_tilted : PlanarPose, optional
        c with the whole body tilted about the ankles; not used if *faults* has E3 or E4.
    faults : Fault
        Each alone or any together.
    factor : float
        Sign of M_2 under E5, +1 or -1.

    Returns
    -------
    PublishedResult

    Raises
    ------
    RankError
        If a tilt or bend is too small; or if Z_2c is unknown: *c_tilted* is missing, or E4 forbids
        its use while E3 does not guess in its place.
    """
    seen, m_2 = masses_under(chain, faults)
    # In (28) and (29) the shape that tilts is the straight one, whatever the knee does.
    line_a = a.line(a.shin, faults, factor)
    com_b = TotalCom(*total_com_two_poses(line_a, b.line(b.shin, faults, factor), m_2, seen.foot))
    if Fault.RIGID_BEND in faults:
        first, line_c = line_a, c.line(c.thigh, faults, factor)
    elif c_tilted is None or Fault.TOO_FEW_POSES in faults:
        raise RankError(
            "the height of the CoM in configuration c is not determined",
            measured="3 equations for 4 unknowns",
            limit=f"{poses_required(2)} poses",
            next_step="measure configuration c once more with the whole body tilted",
        )
    else:
        first = c_tilted.line(c_tilted.shin, faults, factor)
        line_c = c.line(c.shin, faults, factor)
    com_c = TotalCom(*total_com_two_poses(first, line_c, m_2, seen.foot))
    bends = Bends(theta_b=b.shin, theta_c=c.thigh, shin_c=c.shin)
    links = link_coms_from_totals(com_b, com_c, bends, chain, faults=faults)
    return PublishedResult(com_b, com_c, links)
