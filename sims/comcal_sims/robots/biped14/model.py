# SPDX-License-Identifier: Apache-2.0
"""A biped of 64 kg and 1.5 m with 14 joints and 10 massive links, rooted at the pelvis.

Legs: hip roll and pitch, knee, ankle pitch and roll; waist roll and pitch; one pitch joint per
shoulder. Axes that meet in one point are joined by a yoke of 1 g, taken out of the link beyond it.
At q = 0 it stands straight, every link frame is parallel to the pelvis, and pitch (+y) is positive
toes-ward: a thigh swings forward, and an arm up to the front, with *negative* angles.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from comcal_sims.robots.feet import SolePlate
from comcal_sims.robots.files import MotorSpec
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
"""Prefix of each side and the sign of its y."""

YOKE = Lump(0.001, ORIGIN)
YOKE_INERTIA: Vector = (1e-4, 1e-4, 1e-4)
"""[kg m^2], of the order of a geared motor's rotor, so that engines stay well conditioned."""


@dataclass(frozen=True)
class Biped14Parameters:
    """Masses, CoMs and lengths; the left side, of which the right one is the mirror image.

    Every :class:`Lump` is in the link frame, whose origin is the joint nearer to the pelvis (for
    the pelvis: the middle between the hips). *thigh*, *foot* and *torso* include their yoke, and
    *foot* its sole plate.

    Parameters
    ----------
    pelvis, torso, arm, thigh, shin, foot : Lump
    half_hip, half_shoulder : float
        y of hip and shoulder [m].
    thigh_length, shin_length, ankle_height : float
        [m]
    waist_height, torso_height, shoulder_height : float
        Waist joint above the hips; top of the head and shoulders above the waist joint [m].
    arm_length : float
        [m]
    sole_mass, cut_height, heel, toe, half_width : float
        Sole plate below the sensor's cut [kg, m].
    """

    pelvis: Lump = field(default=Lump(9.0, (-0.012, 0.003, 0.055)))
    torso: Lump = field(default=Lump(20.0, (0.018, -0.004, 0.235)))
    arm: Lump = field(default=Lump(3.5, (0.015, 0.020, -0.260)))
    thigh: Lump = field(default=Lump(7.0, (0.014, 0.011, -0.150)))
    shin: Lump = field(default=Lump(4.0, (-0.012, 0.006, -0.160)))
    foot: Lump = field(default=Lump(3.0, (0.025, 0.003, -0.055)))
    half_hip: float = 0.090
    half_shoulder: float = 0.210
    thigh_length: float = 0.360
    shin_length: float = 0.360
    ankle_height: float = 0.090
    waist_height: float = 0.100
    torso_height: float = 0.590
    shoulder_height: float = 0.360
    arm_length: float = 0.600
    sole_mass: float = 0.3
    cut_height: float = 0.030
    heel: float = -0.090
    toe: float = 0.150
    half_width: float = 0.055

    @property
    def sole(self) -> SolePlate:
        """The plate below each sensor."""
        return SolePlate(self.sole_mass, self.cut_height, self.heel, self.toe, self.half_width)

    @property
    def total_mass(self) -> float:
        """Mass of the whole robot [kg]."""
        sides = (self.arm, self.thigh, self.shin, self.foot)
        return self.pelvis.mass + self.torso.mass + 2 * sum(lump.mass for lump in sides)


@dataclass(frozen=True)
class _Drive:
    """Limits [rad], effort [N m], torque constant [N m/A] and gear of one kind of joint."""

    axis: Vector
    lower: float
    upper: float
    effort: float
    torque_constant: float
    gear: float


_DRIVES = {
    "hip_roll": _Drive(X_AXIS, -0.6, 0.6, 250.0, 0.14, 100.0),
    "hip_pitch": _Drive(Y_AXIS, -1.9, 0.9, 250.0, 0.14, 100.0),
    "knee": _Drive(Y_AXIS, -0.1, 2.4, 250.0, 0.14, 100.0),
    "ankle_pitch": _Drive(Y_AXIS, -1.2, 0.9, 200.0, 0.11, 120.0),
    "ankle_roll": _Drive(X_AXIS, -0.6, 0.6, 120.0, 0.11, 80.0),
    "waist_roll": _Drive(X_AXIS, -0.5, 0.5, 200.0, 0.14, 100.0),
    "waist_pitch": _Drive(Y_AXIS, -0.5, 1.0, 200.0, 0.14, 100.0),
    "shoulder": _Drive(Y_AXIS, -3.0, 1.2, 60.0, 0.07, 100.0),
}


def biped14_motors(spec: RobotSpec) -> dict[str, MotorSpec]:
    """Return the motor of every joint; those of the right side are mounted mirrored."""
    motors = dict[str, MotorSpec]()
    for joint in spec.joint_names:
        drive = _DRIVES[_kind(joint)]
        sign = -1 if joint.startswith("r_") else 1
        motors[joint] = MotorSpec(drive.torque_constant, drive.gear, sign)
    return motors


def biped14_spec(parameters: Biped14Parameters) -> RobotSpec:
    """Return the links and joints of the 14-joint biped, the pelvis being the root."""
    p = parameters
    pelvis = cuboid_link(
        "pelvis",
        p.pelvis,
        Cuboid((0.16, 2 * p.half_hip + 0.06, p.waist_height), (0.0, 0.0, p.waist_height / 2)),
    )
    links, joints = [pelvis], list[JointSpec]()
    for part_links, part_joints in (_upper_body(p), *(_leg(p, *side) for side in SIDES.items())):
        links += part_links
        joints += part_joints
    return RobotSpec("biped14", tuple(links), tuple(joints))


def _upper_body(p: Biped14Parameters) -> tuple[list[LinkSpec], list[JointSpec]]:
    torso_shape = Cuboid((0.18, 0.34, p.torso_height), (0.0, 0.0, p.torso_height / 2))
    links = [_yoke("waist"), cuboid_link("torso", p.torso.without(YOKE), torso_shape)]
    joints = [
        _hinge("waist_roll", "pelvis", "waist_yoke", (0.0, 0.0, p.waist_height)),
        _hinge("waist_pitch", "waist_yoke", "torso", ORIGIN),
    ]
    for side, sign in SIDES.items():
        shoulder = (0.0, sign * p.half_shoulder, p.shoulder_height)
        arm_shape = Cuboid((0.07, 0.07, p.arm_length), _down(p.arm_length / 2))
        links.append(cuboid_link(f"{side}_arm", _mirrored(p.arm, sign), arm_shape))
        joints.append(_hinge(f"{side}_shoulder", "torso", f"{side}_arm", shoulder))
    return links, joints


def _leg(p: Biped14Parameters, side: str, sign: float) -> tuple[list[LinkSpec], list[JointSpec]]:
    hip, ankle, thigh, shin, foot, sole = (
        f"{side}_{part}" for part in ("hip", "ankle", "thigh", "shin", "foot", "sole")
    )
    thigh_lump = _mirrored(p.thigh, sign).without(YOKE)
    shin_lump = _mirrored(p.shin, sign)
    foot_lump = _mirrored(p.foot, sign).without(p.sole.lump_seen_from(p.ankle_height), YOKE)
    foot_shape = Cuboid(
        (p.toe - p.heel, 2 * p.half_width, 0.03),
        ((p.toe + p.heel) / 2, 0.0, p.cut_height + 0.015 - p.ankle_height),
    )
    links = [
        _yoke(hip),
        cuboid_link(
            thigh, thigh_lump, Cuboid((0.12, 0.11, p.thigh_length), _down(p.thigh_length / 2))
        ),
        cuboid_link(shin, shin_lump, Cuboid((0.09, 0.09, p.shin_length), _down(p.shin_length / 2))),
        _yoke(ankle),
        cuboid_link(foot, foot_lump, foot_shape),
        p.sole.link(sole),
    ]
    joints = [
        _hinge(f"{hip}_roll", "pelvis", f"{hip}_yoke", (0.0, sign * p.half_hip, 0.0)),
        _hinge(f"{hip}_pitch", f"{hip}_yoke", thigh, ORIGIN),
        _hinge(f"{side}_knee", thigh, shin, _down(p.thigh_length)),
        _hinge(f"{ankle}_pitch", shin, f"{ankle}_yoke", _down(p.shin_length)),
        _hinge(f"{ankle}_roll", f"{ankle}_yoke", foot, ORIGIN),
        p.sole.joint(f"{foot}_ft", foot, sole, p.ankle_height),
    ]
    return links, joints


def _hinge(name: str, parent: str, child: str, origin: Vector) -> JointSpec:
    drive = _DRIVES[_kind(name)]
    return JointSpec(
        name, parent, child, origin, drive.axis, drive.lower, drive.upper, drive.effort
    )


def _kind(joint: str) -> str:
    return joint[2:] if joint[:2] in ("l_", "r_") else joint


def _yoke(name: str) -> LinkSpec:
    return LinkSpec(f"{name}_yoke", YOKE, YOKE_INERTIA)


def _mirrored(lump: Lump, sign: float) -> Lump:
    x, y, z = lump.com
    return Lump(lump.mass, (x, sign * y, z))


def _down(distance: float) -> Vector:
    return (0.0, 0.0, -distance)
