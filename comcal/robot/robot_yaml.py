# SPDX-License-Identifier: Apache-2.0
"""The text of a robot.yaml to start from: every guess beside its reason."""

from __future__ import annotations

import io
import re

import numpy as np
from ruamel.yaml import YAML

from comcal.robot.guess import FootGuess, Guess
from comcal.robot.tree import Array, Tree

_WIDTH = 96
_GIMBAL = 1e-9


def robot_yaml_text(tree: Tree, guess: Guess, urdf: str) -> str:
    """Return a commented ``robot.yaml``.

    Parameters
    ----------
    tree : Tree
    guess : Guess
        Of the same tree.
    urdf : str
        Path of the URDF, relative to the folder of the file to be written.
    """
    lines = [
        *_comment(
            "A robot for comcal. What the URDF does not say is guessed, with the reason beside it: "
            "check every line, then run comcal check on this file. SI and radians; other units "
            "only when written, such as 26.32 mm or 2 deg."
        ),
        "format: comcal-robot/1",
        f"name: {_scalar(_name(tree.name))}",
        f"urdf: {_scalar(urdf)}  # relative to this file",
        "gravity: 9.81  # m/s^2 where the robot stands",
        "base: floating  # fixed: the root link is bolted down",
        "",
        *_sensors(guess),
        "",
        *_feet(guess),
        "",
        *_motors(tree),
        "",
        *_imu(guess),
        "",
        *_sources(tree, guess),
        "",
        *_comment(
            "Standard errors of the mean of a still pose, and under revisit: what differs between "
            "two visits of one pose. Typical values; record some pose several times to know yours."
        ),
        "noise:",
        "  ft_force: 0.1  # N",
        "  ft_moment: 0.01  # N m",
        "  revisit: {encoder: 0.02 deg}",
        "",
        *_comment(
            "How far a good robot is from its URDF (one sigma): what sums that the poses do not "
            "resolve are shared out by, and what the sigma of CAD values is."
        ),
        "tolerances:",
        "  link_mass: 0.005  # relative",
        "  link_com: 1 mm",
        "",
        *_comment("What must be met for a verdict; without them nothing passes or fails."),
        "limits: {com_error: 5 mm, mass_error: 0.5 kg}",
    ]
    return "\n".join(lines) + "\n"


def _sensors(guess: Guess) -> list[str]:
    lines = _comment(
        "Force/torque sensors. The wrench is expressed in, and taken about the origin of, the "
        "child frame of `joint`. sense: on_robot = what the part below (foot side) exerts on the "
        "part above: about +m g along z for a standing robot; on_ground = the opposite."
    )
    if not guess.feet:
        lines += [
            "sensors: {}",
            "#  left_foot: {joint: NAME, sense: on_robot}  # FILL IN",
        ]
    else:
        lines.append("sensors:")
        for foot in guess.feet:
            lines += _comment(foot.why_sensor, "  ")
            joint = _scalar(foot.sensor.joint)
            lines.append(f"  {foot.sensor.name}: {{joint: {joint}, sense: on_robot}}")
    if guess.other_sensors:
        names = ", ".join(guess.other_sensors)
        lines += _comment(f"these joints look like sensors too; add those that are read: {names}")
    return lines


def _feet(guess: Guess) -> list[str]:
    lines = _comment(
        "Feet. sole: corners in the sole frame (x to the toes, y left, z away from the ground) [m];"
        " ankle: the pitch joint about which twin poses tilt."
    )
    if not guess.feet:
        return [
            *lines,
            "feet: {}",
            "#  left: {link: NAME, sensor: left_foot}  # FILL IN: no leg was found in the URDF",
        ]
    lines.append("feet:")
    for foot in guess.feet:
        lines += _foot(foot)
    return lines


def _foot(guess: FootGuess) -> list[str]:
    foot = guess.foot
    lines = [
        f"  {foot.name}:",
        *_comment(guess.why_link, "    "),
        f"    link: {_scalar(foot.link)}",
        f"    sensor: {guess.sensor.name}",
        *_comment(f"sole {guess.why_sole}", "    "),
    ]
    if foot.sole is None:
        lines.append(
            "    # sole: [[0.1, 0.05], [-0.1, 0.05], [-0.1, -0.05], [0.1, -0.05]]  # FILL IN"
        )
    else:
        corners = ", ".join(_vector(corner) for corner in foot.sole)
        lines.append(f"    sole: [{corners}]")
    if not guess.frame_is_default:
        xyz = _vector(foot.T_link_sole[:3, 3])
        rpy = _vector(_rpy(foot.T_link_sole[:3, :3]))
        lines.append(f"    sole_frame: {{xyz: {xyz}, rpy: {rpy}}}  # in the foot link")
    if foot.ankle is None:
        lines.append("    # ankle: NAME  # FILL IN where there is one: no joint turns about y here")
    else:
        lines.append(f"    ankle: {_scalar(foot.ankle)}  # the nearest pitch joint above the foot")
    return lines


def _motors(tree: Tree) -> list[str]:
    return [
        *_comment(
            "Motors, for currents: torque at the joint [N m] = torque_constant * gear * sign * "
            "current [A]. No URDF holds these numbers; take them from the data sheets. sign: +1 "
            "if a positive current pushes towards a positive angle. Without currents, leave it."
        ),
        "# motors:",
        *(
            f"#   {_scalar(name)}: {{torque_constant: 0.1, gear: 100, sign: 1}}"
            for name in tree.joint_names
        ),
    ]


def _imu(guess: Guess) -> list[str]:
    if guess.imu_link is None:
        return [*_comment("No link is called imu."), "# imu: {link: NAME}"]
    return [
        *_comment(f"The link in whose axes the IMU reads: {guess.why_imu}"),
        f"imu: {{link: {_scalar(guess.imu_link)}}}",
    ]


def _sources(tree: Tree, guess: Guess) -> list[str]:
    sensors = [foot.sensor.name for foot in guess.feet] or ["left_foot"]
    return [
        *_comment(
            "What hangs on the robot's CAN buses, for --source can. Devices, their ids and what "
            "else they need are listed in README, On the robot. gear: turns of the motor per turn "
            "of the joint; sign, zero: of the joint's angle."
        ),
        "# sources:",
        "#   can:",
        "#     buses:",
        "#       can0: {interface: socketcan, channel: can0, bitrate: 1000000}",
        "#     sensors:",
        *(
            f"#       {_scalar(name)}: {{bus: can0, device: ati_netcanoem, "
            f"ids: {{base: 0x{base:02x}}}, period: 0.005}}"
            for base, name in enumerate(sensors, start=32)
        ),
        "#     joints:",
        *(
            f"#       {_scalar(name)}: {{bus: can0, device: cia402, ids: {{node: {node}}}, "
            "counts_per_turn: 4096, gear: 100, sign: 1, zero: 0 deg}"
            for node, name in enumerate(tree.joint_names, start=1)
        ),
    ]


def _comment(text: str, indent: str = "") -> list[str]:
    """Return *text* as comment lines."""
    lines: list[str] = []
    line = ""
    for word in text.split():
        if line and len(indent) + len(line) + len(word) + 3 > _WIDTH:
            lines.append(line)
            line = ""
        line = f"{line} {word}" if line else word
    return [f"{indent}# {line}" for line in [*lines, line]]


def _vector(values: Array) -> str:
    texts = [np.format_float_positional(v + 0.0, 6, trim="0") for v in np.round(values, 6)]
    return f"[{', '.join(texts)}]"


def _rpy(R: Array) -> Array:
    """Return the roll, pitch and yaw of URDF, R = Rz Ry Rx, shape (3,) [rad]."""
    across = float(np.hypot(R[0, 0], R[1, 0]))
    pitch = np.arctan2(-R[2, 0], across)
    if across < _GIMBAL:  # roll and yaw turn about one axis: all of it is called roll
        return np.array([np.arctan2(-R[1, 2], R[1, 1]), pitch, 0.0])
    return np.array([np.arctan2(R[2, 1], R[2, 2]), pitch, np.arctan2(R[1, 0], R[0, 0])])


def _name(name: str) -> str:
    """Return a name without line breaks."""
    return re.sub(r"\s+", " ", name).strip() or "robot"


def _scalar(text: str) -> str:
    """Return *text* as YAML writes it, in quotes where it needs them."""
    yaml = YAML(typ="safe", pure=True)
    yaml.default_flow_style = True
    yaml.width = 4096
    stream = io.StringIO()
    yaml.dump([text], stream)
    return stream.getvalue().strip()[1:-1]
