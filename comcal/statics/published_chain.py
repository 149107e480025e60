# SPDX-License-Identifier: Apache-2.0
"""The planar robot of Muscolo et al. (2017), Figure 4: foot a, shin b, thigh and all above it c.

Stance frame P, SI. A link's CoM is (r, l): r along x and l along z from its lower joint, in the
link's own axes, which are those of P when the robot stands straight. Angles are absolute pitches,
positive to the toes. Pose b: shin and thigh at theta_b; pose c: shin upright, thigh at theta_c.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from comcal.robot.tree import Array
from comcal.statics.published_faults import Fault


@dataclass(frozen=True)
class FootCad:
    """What f takes from CAD about the feet.

    Parameters
    ----------
    m_u : float
        Mass of all that stays on the ground, both feet together [kg].
    r_u, l_u : float
        x and z of its CoM in P [m].
    U : float
        Height of the ankle axle in P [m]; the axle is at x = 0.
    """

    m_u: float
    r_u: float
    l_u: float
    U: float


@dataclass(frozen=True)
class LinkComs:
    """CoM of the shin (b) and of the thigh with all above it (c), in the links' axes [m]."""

    r_b: float
    l_b: float
    r_c: float
    l_c: float

    def as_array(self) -> Array:
        """Return (r_b, l_b, r_c, l_c) [m]."""
        return np.array([self.r_b, self.l_b, self.r_c, self.l_c])


@dataclass(frozen=True)
class Bends:
    """Absolute pitch of the links in poses b and c, positive to the toes [rad].

    Parameters
    ----------
    theta_b : float
        Shin and thigh in b.
    theta_c : float
        Thigh in c.
    shin_c : float
        Shin in c; zero in the paper.
    """

    theta_b: float
    theta_c: float
    shin_c: float = 0.0


@dataclass(frozen=True)
class TotalCom:
    """CoM (X_2, Z_2) of what the sensors carry, in P [m]."""

    X: float
    Z: float


@dataclass(frozen=True)
class PublishedChain:
    """The three links of Figure 4 with the inputs that the paper takes from CAD.

    Parameters
    ----------
    foot : FootCad
        m_a, r_a, l_a and L_a, named m_u, r_u, l_u and U.
    m_b, m_c : float
        Mass of the shins and of the thighs with all above them [kg].
    L_b : float
        Length of the shin, ankle axle to knee axle [m].
    waist_mass : float
        The part of m_c that is not doubled by the second leg [kg]; only E7 asks for it.
    """

    foot: FootCad
    m_b: float
    m_c: float
    L_b: float
    waist_mass: float = 0.0

    @property
    def m_w(self) -> float:
        """Mass above the ankle axle [kg]."""
        return self.m_b + self.m_c

    @property
    def m_2(self) -> float:
        """Carried mass, feet included [kg]: equation (18) read backwards."""
        return self.m_w + self.foot.m_u

    def one_leg(self) -> PublishedChain:
        """Return the chain as the listing builds it: one leg and the whole waist (E7)."""
        foot = self.foot
        return PublishedChain(
            foot=FootCad(foot.m_u / 2, foot.r_u, foot.l_u, foot.U),
            m_b=self.m_b / 2,
            m_c=(self.m_c - self.waist_mass) / 2 + self.waist_mass,
            L_b=self.L_b,
            waist_mass=self.waist_mass,
        )


def masses_under(chain: PublishedChain, faults: Fault) -> tuple[PublishedChain, float]:
    """Return the chain and m_2 [kg] that a reader who makes faults E6 or E7 puts in."""
    if Fault.ONE_LEG in faults:
        chain = chain.one_leg()
    return chain, chain.m_w if Fault.MASS_WITHOUT_FEET in faults else chain.m_2
