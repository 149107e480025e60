# SPDX-License-Identifier: Apache-2.0
"""Which parts of an extension a URDF can hold, and where the others belong.

A URDF says how masses are spread over rigid links, and where joints are. Bodies and lengths go
there. A joint's origin could be turned by the zero of its encoder too, but whoever then sets the
zero right has a wrong URDF; and the frame of a force sensor is a joint's, which carries links.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from comcal.effects.registry import effects
from comcal.robot.changes import Change
from comcal.robot.changes_yaml import KnownChange
from comcal.robot.model import Robot
from comcal.robot.tree import Link
from comcal.robot.urdf_write import InertialEdit, OriginEdit, write_inertials, write_origins

BODIES = frozenset({"payload", "link_mass", "link_com"})
"""Effects that change one link's ``<inertial>``."""
PROPORTIONAL = 1e-9
"""Relative deviation below which moments of inertia follow the mass."""

_SURROUNDINGS = "not of the robot: keep it in extended.yaml (record, solve, verify --model)"
_SENSOR_FRAME = (
    "the sensor's frame: the <origin> of its joint carries links too, so move it together with "
    "theirs, or turn the readings in the driver"
)
_MATRIX = "the sensor's calibration matrix: multiply it by the inverse"
_GEARBOX = "no rigid URDF holds it: the transmission's model in controller or simulator"
_WIRING = "cabling, driver or MAP.yaml"
_BELONGS = {
    "ft_gain": _MATRIX,
    "ft_crosstalk": _MATRIX,
    "ft_mounting": _SENSOR_FRAME,
    "ft_position": _SENSOR_FRAME,
    "ft_drift": "no file: tare more often",
    "ft_temperature": "the driver's temperature compensation, or tare at the working temperature",
    "joint_compliance": _GEARBOX,
    "backlash": _GEARBOX,
    "hysteresis": _GEARBOX,
    "joint_friction": "robot.yaml, tolerances: joint_friction says how much currents may hide",
    "current_offset": "the zero of the current sensor",
    "imu_mounting": "the <origin> of the joint that carries the IMU's link, or the driver",
    "ground_tilt": _SURROUNDINGS,
    "sole_compliance": _SURROUNDINGS,
    "cable_pull": _SURROUNDINGS,
    "tether": _SURROUNDINGS,
    "external_contact": _SURROUNDINGS,
    "channel_swap": _WIRING,
    "sign_flip": _WIRING,
    "unit_error": _WIRING,
    "frame_handedness": _WIRING,
    "left_right_swap": _WIRING,
}


@dataclass(frozen=True)
class Part:
    """One change of an extension, and where it is to be written.

    Parameters
    ----------
    known : KnownChange
    belongs : str
        Where it belongs, in words; empty where the URDF holds it.
    """

    known: KnownChange
    belongs: str

    @property
    def in_urdf(self) -> bool:
        """Whether the URDF holds it."""
        return not self.belongs

    @property
    def name(self) -> str:
        """``effect@target``."""
        return self.known.change.name


def parts_of(robot: Robot, known: Iterable[KnownChange]) -> tuple[Part, ...]:
    """Return where every change of an extension belongs.

    Parameters
    ----------
    robot : Robot
        As in its URDF.
    known : iterable of KnownChange
        Valid for this robot.
    """
    return tuple(Part(entry, _belongs(robot, entry.change)) for entry in known)


def rest_of(parts: Iterable[Part]) -> tuple[KnownChange, ...]:
    """Return the changes that the URDF does not hold."""
    return tuple(part.known for part in parts if not part.in_urdf)


def _belongs(robot: Robot, change: Change) -> str:
    if change.effect in BODIES:
        return _why_no_inertial(robot, change.target)
    if change.effect == "sole_mass":
        return _why_no_sole(robot, change.target)
    if change.effect == "link_length":
        return ""
    if change.effect == "ft_bias":
        return f"the tare of {change.target}: tare it again with nothing on it"
    if change.effect == "torque_constant":
        return f"robot.yaml: {_torque_constants(robot, change)}"
    if change.effect == "joint_offset":
        offset = change.number("offset")
        return f"the zero of the encoder: its reading is to be {offset:+.6g} larger"
    if change.effect == "foot_placement":
        return f"robot.yaml, feet.{change.target}.sole_frame"
    effect = effects().get(change.effect)
    remedy = "" if effect is None else effect.remedy
    return _BELONGS.get(change.effect, remedy) or "extended.yaml"


def _torque_constants(robot: Robot, change: Change) -> str:
    factor = 1.0 + change.number("relative")
    motors = [m for m in robot.motors.values() if change.target in (m.joint, "all")]
    if not motors:
        return f"motors.{change.target}.torque_constant, times {factor:.6g}"
    return ", ".join(
        f"motors.{m.joint}.torque_constant: {m.torque_constant * factor:.6g} instead of "
        f"{m.torque_constant:.6g}"
        for m in motors
    )


def _why_no_inertial(robot: Robot, name: str) -> str:
    k = robot.tree.link_index[name]
    stated = _stated_below(robot, k)
    if stated:
        return stated
    if not robot.tree.links[k].has_inertial:
        return f"link {name} has no <inertial>, and none is ever invented: give it one"
    return ""


def _why_no_sole(robot: Robot, sensor: str) -> str:
    for k in np.flatnonzero(robot.below_cut[sensor]):
        link = robot.tree.links[k]
        if link.mass and (_stated_below(robot, int(k)) or not link.has_inertial):
            return f"robot.yaml, sensors.{sensor}.below.mass"
    return ""


def _stated_below(robot: Robot, k: int) -> str:
    """Return where else robot.yaml states a link's mass and CoM, or an empty string."""
    for sensor in robot.sensors.values():
        if sensor.below is not None and robot.below_cut[sensor.name][k]:
            return f"robot.yaml, sensors.{sensor.name}.below: it stands for what hangs there"
    return ""


def written_urdf(raw: bytes, name: str, nominal: Robot, wanted: Robot) -> bytes:
    """Return a URDF with the masses, CoMs and joint origins of another robot of the same design.

    Parameters
    ----------
    raw : bytes
        The URDF of *nominal*.
    name : str
        Of the file, for messages.
    nominal, wanted : Robot

    Raises
    ------
    UrdfError, ComcalError
        As of :func:`~comcal.robot.urdf_write.write_inertials`.

    Notes
    -----
    What robot.yaml states of links below a cut stays there, and no ``<inertial>`` is invented.
    """
    links = [
        (old, new)
        for k, (old, new) in enumerate(zip(nominal.tree.links, wanted.tree.links, strict=True))
        if old.has_inertial and not _stated_below(nominal, k)
    ]
    inertials = [edit for edit in (_inertial_edit(*pair) for pair in links) if edit is not None]
    moved = write_origins(raw, name, _origin_edits(nominal, wanted))
    return write_inertials(moved, name, inertials)


def _inertial_edit(old: Link, new: Link) -> InertialEdit | None:
    x, y, z = (
        None if a == b else float(b)
        for a, b in zip(old.com.tolist(), new.com.tolist(), strict=True)
    )
    factor = new.mass / old.mass if old.mass and new.mass != old.mass else 1.0
    more = new.inertia - factor * old.inertia
    size = max(float(np.abs(new.inertia).max()), float(np.abs(old.inertia).max()))
    if float(np.abs(more).max()) > PROPORTIONAL * size or (new.mass != old.mass and not old.mass):
        joined = (new.mass - old.mass, new.inertia - old.inertia)
        return InertialEdit(old.name, (x, y, z), joined=joined)
    if (x, y, z) == (None, None, None) and factor == 1.0:
        return None
    return InertialEdit(old.name, (x, y, z), factor)


def _origin_edits(nominal: Robot, wanted: Robot) -> Sequence[OriginEdit]:
    edits: list[OriginEdit] = []
    for old, new in zip(nominal.tree.joints, wanted.tree.joints, strict=True):
        x, y, z = (new.T_parent_joint[:3, 3] - old.T_parent_joint[:3, 3]).tolist()
        if x or y or z:
            edits.append(OriginEdit(old.name, (x, y, z)))
    return edits
