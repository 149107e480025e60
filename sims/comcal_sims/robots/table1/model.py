# SPDX-License-Identifier: Apache-2.0
r"""The robot of Table 1 of [1]_: two planar legs of three links each, and a waist.

The paper gives the CoM of a link as (r, l): l along the link and r across it (toes-ward), from the
joint nearer to the **feet**, upwards. A URDF link of this robot, whose root is the waist, has its
origin in the joint nearer to the **waist**, a length L higher, so the CoM in the link frame is
``(r, 0, l - L)`` for thigh, shin and foot alike (the foot counts from the floor).

An absolute tilt t of a segment is a rotation Ry(t): positive toes-ward. Each joint turns its child
about +y against its parent, so hip = thigh - waist, knee = shin - thigh and, with the foot flat,
ankle = -shin.

References
----------
.. [1] Muscolo, Caldwell, Cannella (2017), section 4.1, Table 1.
"""

from __future__ import annotations

from dataclasses import dataclass

from comcal_sims.robots.feet import SolePlate
from comcal_sims.robots.model import (
    ORIGIN,
    X_AXIS,
    Y_AXIS,
    Cuboid,
    JointSpec,
    LinkSpec,
    Lump,
    RobotSpec,
    Vector,
    cuboid_link,
)

SIDES = {"l": 1.0, "r": -1.0}
"""Prefix of each leg and the sign of its y."""

YOKE = Lump(0.001, ORIGIN)
"""The small body between two axes that meet in one point."""
YOKE_INERTIA: Vector = (1e-5, 1e-5, 1e-5)
"""[kg m^2], of the order of a small motor's rotor, so that engines stay well conditioned."""
REACH = 1.7
"""Joint limit either way [rad]."""


@dataclass(frozen=True)
class Table1Parameters:
    """Masses [kg] and lengths [m] of Table 1, in the paper's letters, and of the foot sensor.

    Parameters
    ----------
    m_a, l_a, r_a, L_a : float
        One foot (sole plate included): mass, CoM above the floor and toes-ward of the ankle,
        height of the ankle.
    m_b, l_b, r_b, L_b : float
        One shin: mass, CoM above and toes-ward of the ankle, length.
    m_c, l_c, r_c, L_c : float
        One thigh: mass, CoM above and toes-ward of the knee, length.
    waist_mass, waist_l, waist_r : float
        Waist: mass, CoM above and toes-ward of the middle between the hips.
    half_stance : float
        Half the distance between the legs.
    sole_mass, cut_height : float
        Mass below the sensor's cut, taken out of the foot so that both together are *m_a* at
        (*r_a*, *l_a*), and the cut's height above the ground.
    heel, toe, half_width : float
        Corners of the sole.
    roll_joints : bool
        Adds hip and ankle roll, each through a yoke of 1 g taken out of thigh and foot.
    """

    m_a: float = 6.72
    l_a: float = 0.02632
    r_a: float = 0.0
    L_a: float = 0.100
    m_b: float = 0.95
    l_b: float = 0.200
    r_b: float = 0.0
    L_b: float = 0.400
    m_c: float = 1.16
    l_c: float = 0.250
    r_c: float = 0.0
    L_c: float = 0.500
    waist_mass: float = 0.94
    waist_l: float = 0.0
    waist_r: float = 0.0
    half_stance: float = 0.200
    sole_mass: float = 0.1
    cut_height: float = 0.020
    heel: float = -0.080
    toe: float = 0.160
    half_width: float = 0.050
    roll_joints: bool = False

    @property
    def sole(self) -> SolePlate:
        """The plate below each sensor."""
        return SolePlate(self.sole_mass, self.cut_height, self.heel, self.toe, self.half_width)

    @property
    def total_mass(self) -> float:
        """Mass of the whole robot [kg]."""
        return 2 * (self.m_a + self.m_b + self.m_c) + self.waist_mass


def table1_spec(parameters: Table1Parameters) -> RobotSpec:
    """Return the links and joints of the Table 1 robot, the waist being the root."""
    waist = cuboid_link(
        "waist",
        Lump(parameters.waist_mass, (parameters.waist_r, 0.0, parameters.waist_l)),
        Cuboid((0.10, 2 * parameters.half_stance, 0.08)),
    )
    links, joints = [waist], list[JointSpec]()
    for side, sign in SIDES.items():
        leg_links, leg_joints = _leg(parameters, side, sign)
        links += leg_links
        joints += leg_joints
    return RobotSpec("table1", tuple(links), tuple(joints))


def _leg(p: Table1Parameters, side: str, sign: float) -> tuple[list[LinkSpec], list[JointSpec]]:
    yoke = (YOKE,) if p.roll_joints else ()
    thigh = Lump(p.m_c, (p.r_c, 0.0, p.l_c - p.L_c)).without(*yoke)
    shin = Lump(p.m_b, (p.r_b, 0.0, p.l_b - p.L_b))
    foot = Lump(p.m_a, (p.r_a, 0.0, p.l_a - p.L_a)).without(p.sole.lump_seen_from(p.L_a), *yoke)
    foot_shape = Cuboid(
        (p.toe - p.heel, 2 * p.half_width, 0.04),
        ((p.toe + p.heel) / 2, 0.0, p.cut_height + 0.02 - p.L_a),
    )
    bodies = {
        "hip": cuboid_link(f"{side}_thigh", thigh, Cuboid((0.06, 0.06, p.L_c), _down(p.L_c / 2))),
        "knee": cuboid_link(f"{side}_shin", shin, Cuboid((0.05, 0.05, p.L_b), _down(p.L_b / 2))),
        "ankle": cuboid_link(f"{side}_foot", foot, foot_shape),
    }
    hip: Vector = (0.0, sign * p.half_stance, 0.0)
    links, joints = _hinges(p, f"{side}_hip", "waist", bodies["hip"], hip, roll_first=True)
    joints.append(_hinge(f"{side}_knee", f"{side}_thigh", f"{side}_shin", _down(p.L_c)))
    links.append(bodies["knee"])
    ankle_links, ankle_joints = _hinges(
        p, f"{side}_ankle", f"{side}_shin", bodies["ankle"], _down(p.L_b), roll_first=False
    )
    links += [*ankle_links, p.sole.link(f"{side}_sole")]
    joints += [
        *ankle_joints,
        p.sole.joint(f"{side}_foot_ft", f"{side}_foot", f"{side}_sole", p.L_a),
    ]
    return links, joints


def _hinges(
    p: Table1Parameters, name: str, parent: str, child: LinkSpec, at: Vector, *, roll_first: bool
) -> tuple[list[LinkSpec], list[JointSpec]]:
    """Return the pitch joint and, where asked for, the roll joint of a hip or an ankle."""
    if not p.roll_joints:
        return [child], [_hinge(f"{name}_pitch", parent, child.name, at)]
    yoke = LinkSpec(f"{name}_yoke", YOKE, YOKE_INERTIA)
    kinds = (
        (("roll", X_AXIS), ("pitch", Y_AXIS))
        if roll_first
        else (
            ("pitch", Y_AXIS),
            ("roll", X_AXIS),
        )
    )
    (first, first_axis), (second, second_axis) = kinds
    return [yoke, child], [
        _hinge(f"{name}_{first}", parent, yoke.name, at, first_axis),
        _hinge(f"{name}_{second}", yoke.name, child.name, ORIGIN, second_axis),
    ]


def _hinge(name: str, parent: str, child: str, origin: Vector, axis: Vector = Y_AXIS) -> JointSpec:
    return JointSpec(name, parent, child, origin, axis, lower=-REACH, upper=REACH)


def _down(distance: float) -> Vector:
    return (0.0, 0.0, -distance)
