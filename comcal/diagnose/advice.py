# SPDX-License-Identifier: Apache-2.0
"""What would tell rivals apart, and what is missing: pose types and channels, in words."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from comcal.diagnose.diagnosis import Rival
from comcal.diagnose.scene import Scene
from comcal.effects.registry import effects
from comcal.measure.plan import NONE
from comcal.measure.table import PoseTable
from comcal.robot.model import Robot

SAME = 0.02
"""Share of a cause that its rival leaves, below which no reading of these poses differs."""
BOTH_MEAN_THE_SAME = {
    frozenset({"cable_pull", "external_contact"}): "a cable and a contact that push alike in every "
    "pose are one and the same to all sensors: look, or unhook the cable",
    frozenset({"sole_mass", "payload"}): "mass below a cut is one and the same to that sensor, "
    "whoever carries it: weigh the foot",
}
PAIRS = {
    frozenset({"ft_drift", "ft_temperature"}): "revisit poses at another temperature: with one "
    "steady warm-up, time and temperature are the same thing",
    frozenset({"cable_pull", "link_mass"}): "move the trunk sideways, or unhook the cable once",
    frozenset({"cable_pull", "payload"}): "move the trunk sideways, or unhook the cable once",
    frozenset({"cable_pull", "tether"}): "move the trunk sideways, or unhook the cable once",
    frozenset({"backlash", "joint_offset"}): "poses in which the joint's torque has the other sign",
    frozenset({"backlash", "joint_compliance"}): "poses with less torque and with reversed torque",
    frozenset({"ft_mounting", "ground_tilt"}): "turn the robot round on the spot, or read an IMU",
    frozenset({"imu_mounting", "ground_tilt"}): "turn the robot round on the spot",
    frozenset({"torque_constant", "current_offset"}): "reverse the torque, or hang the robot up",
    frozenset({"joint_friction", "current_offset"}): "approach each pose from both sides",
    frozenset({"ft_gain", "link_mass"}): "put the load on one foot, then on the other; or add a "
    "known weight",
    frozenset({"ft_gain", "payload"}): "put the load on one foot, then on the other; or add a "
    "known weight",
    frozenset({"ft_bias", "payload"}): "lift that foot, or hang the robot up",
    frozenset({"ft_bias", "link_mass"}): "lift that foot, or hang the robot up",
    frozenset({"ft_bias", "ft_drift"}): "the same poses again, much later",
    frozenset({"sole_compliance", "joint_compliance"}): "single support with an IMU, with the "
    "centre of pressure at toes and at heel",
}
"""Advice on pairs of effects, whichever way round."""


def what_would_decide(groups: Sequence[Sequence[Rival]], about: Scene) -> tuple[str, ...]:
    """Return one line for each set of causes that the readings do not tell apart."""
    return tuple(
        dict.fromkeys(
            line
            for group in groups
            for rival in group[1:]
            for line in _pair(group[0], rival, about)
        )
    )


def _pair(first: Rival, other: Rival, about: Scene) -> list[str]:
    names = f"{first.name} or {other.name}"
    pair = frozenset({first.effect, other.effect})
    if other.left < SAME and pair in BOTH_MEAN_THE_SAME and first.target == other.target:
        return [f"{names}: {BOTH_MEAN_THE_SAME[pair]}"]
    if _is_arm_angle(first, other, about) or _is_arm_angle(other, first, about):
        return [
            f"{names}: no pose helps, only an angle reference on that arm (an IMU, a camera, a "
            "jig): behind a joint without closure its angle and the CoM turn together"
        ]
    if pair in PAIRS:
        return [f"{names}: {PAIRS[pair]}"]
    known = effects()
    texts = [known[name].separated_by for name in (first.effect, other.effect) if name in known]
    return [f"{names}: {'; '.join(dict.fromkeys(texts))}"]


def _is_arm_angle(angle: Rival, body: Rival, about: Scene) -> bool:
    """Whether one is the angle of a joint of a limb that neither stands nor carries the IMU."""
    robot = about.at.assumed.robot
    if angle.effect != "joint_offset" or body.effect not in ("link_com", "payload", "link_mass"):
        return False
    tree = robot.tree
    if angle.target not in tree.joint_index or body.target not in tree.link_index:
        return False
    beyond = tree.subtree(angle.target)
    imu = robot.imu_link
    return (
        bool(beyond[tree.link_index[body.target]])
        and not any(beyond[tree.link_index[foot.link]] for foot in robot.feet.values())
        and (imu is None or not beyond[tree.link_index[imu]])
    )


def missing_channels(robot: Robot, table: PoseTable) -> tuple[str, ...]:
    """Say which channels and pose types are missing, and what they would tell apart."""
    notes: list[str] = []
    supports = set(table.support)
    if (
        not (np.isfinite(table.current).any() and robot.motors)
        and not np.isfinite(table.torque).any()
    ):
        notes.append(
            "no currents or joint torques: the link that carries a body, and everything about "
            "motors, is known by moments about the feet alone"
        )
    if not np.isfinite(table.imu).any():
        notes.append(
            "no IMU: a slope, turned sensors and angles of the standing leg look much alike"
        )
    if not supports & set(robot.feet) and NONE not in supports:
        notes.append(
            "no lifted foot and no hanging pose: offsets of the sensors and masses of the feet "
            "look alike"
        )
    if "double" not in supports:
        notes.append("no pose on both feet: nothing closes, so angles and lengths show less")
    if not np.isfinite(table.approach).any():
        notes.append("the side of approach was not recorded: friction and hysteresis stay unseen")
    if np.isfinite(table.t).sum() < 2:
        notes.append("no times: drift cannot be told from offset")
    if not any(np.ptp(v[np.isfinite(v)]) > 0.5 for v in table.temperature.values() if len(v)):
        notes.append("no temperature, or always the same: its influence cannot be seen")
    return tuple(notes)
