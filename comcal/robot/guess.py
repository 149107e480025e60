# SPDX-License-Identifier: Apache-2.0
"""What a URDF suggests about feet, sensors, motors and IMU; each guess with its reason.

Names and geometry at q = 0 (z of the root up) are all there is to go by: everything guessed here
is to be checked by somebody who knows the robot.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from comcal.robot.frames import transform_from
from comcal.robot.model import Foot, Sensor
from comcal.robot.soles import (
    default_ankle,
    default_sole_frame,
    place_at_zero,
    sole_rectangle,
)
from comcal.robot.standing import side_of
from comcal.robot.tree import Array, Tree

LEG_JOINTS = 2
"""A leg has at least this many joints that move."""
_WORDS = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")
_FOOT_WORDS = ("sole", "foot", "ankle")
_SENSOR_WORDS = ("ft", "force", "sensor")
_LEVEL = 0.02


@dataclass(frozen=True)
class FootGuess:
    """A foot and its sensor.

    Parameters
    ----------
    foot : Foot
        As robot.yaml would hold it.
    sensor : Sensor
    why_link, why_sensor, why_sole : str
        The reasons, for comments.
    frame_is_default : bool
        Whether robot.yaml's default gives the same sole frame.
    """

    foot: Foot
    sensor: Sensor
    why_link: str
    why_sensor: str
    why_sole: str
    frame_is_default: bool


@dataclass(frozen=True)
class Guess:
    """What a URDF suggests.

    Parameters
    ----------
    feet : tuple of FootGuess
        ``left`` first; empty where no leg was found.
    imu_link : str or None
    why_imu : str
    other_sensors : tuple of str
        Fixed joints that look like sensors but belong to no foot.
    """

    feet: tuple[FootGuess, ...]
    imu_link: str | None
    why_imu: str
    other_sensors: tuple[str, ...]


def guess_robot(tree: Tree) -> Guess:
    """Guess feet, sensors and IMU of a biped.

    Parameters
    ----------
    tree : Tree
    """
    links = _foot_links(tree)
    feet = tuple(
        _guess_foot(tree, name, link, why)
        for name, (link, why) in zip(_foot_names(tree, links), links, strict=True)
    )
    feet = tuple(sorted(feet, key=lambda guess: guess.foot.name))
    taken = {foot.sensor.joint for foot in feet}
    others = tuple(
        joint.name
        for joint in tree.joints
        if not joint.is_movable and joint.name not in taken and _has_word(joint.name, _SENSOR_WORDS)
    )
    imu, why = _guess_imu(tree)
    return Guess(feet, imu, why, others)


def _words(name: str) -> list[str]:
    return [word.lower() for word in _WORDS.findall(name)]


def _has_word(name: str, wanted: Sequence[str]) -> bool:
    return any(word in wanted for word in _words(name))


def _foot_links(tree: Tree) -> list[tuple[int, str]]:
    """Return the foot links from left to right with the reasons.

    The ends of legs are found by height: of the limbs that end lowest at q = 0, one on each side.
    Within the last body of a leg, a link called sole comes before one called foot.
    """
    z = place_at_zero(tree).p[0, :, 2]
    y = place_at_zero(tree).p[0, :, 1]
    moving = np.zeros(len(tree.links), dtype=int)
    for k, joint in enumerate(tree.joints, start=1):
        moving[k] = moving[tree.parents[k]] + joint.is_movable
    ends = [
        k
        for k in range(1, len(tree.links))
        if tree.joints[k - 1].is_movable
        and moving[k] >= LEG_JOINTS
        and not any(
            tree.joints[i - 1].is_movable
            for i in np.flatnonzero(tree.descendants[k])
            if i != k and i > 0
        )
    ]
    feet: list[tuple[int, str]] = []
    for sign in (1.0, -1.0):
        side = [k for k in ends if sign * y[k] > 0.0]
        if not side:
            continue
        end = min(side, key=lambda k: float(z[np.flatnonzero(tree.descendants[k])].min()))
        body = [int(k) for k in np.flatnonzero(tree.descendants[end])]
        named = [
            k
            for word in _FOOT_WORDS
            for k in body
            if word in _words(tree.links[k].name) and "frame" not in _words(tree.links[k].name)
        ]
        best = named[0] if named else end
        what = "by its name" if named else "its last link"
        feet.append((best, f"the limb that ends lowest on this side at q = 0; {what}"))
    lowest = [z[np.flatnonzero(tree.descendants[k])].min() for k, _ in feet]
    if len(feet) == 2 and abs(lowest[0] - lowest[1]) > 0.5 * abs(min(lowest) or 1.0):
        return []
    return feet


def _foot_names(tree: Tree, links: Sequence[tuple[int, str]]) -> list[str]:
    """Return ``left`` and ``right``: by the links' names where they say so, else by their side."""
    by_name = [side_of(tree.links[k].name) for k, _ in links]
    by_place = ["left", "right"][: len(links)]
    return by_name if len(set(by_name)) == len(links) and all(by_name) else by_place


def _guess_foot(tree: Tree, name: str, k: int, why_link: str) -> FootGuess:
    link = tree.links[k].name
    joint, why_sensor = _guess_sensor(tree, k)
    default = default_sole_frame(tree, link)
    T_link_sole, why_sole = _level_sole(tree, k, default)
    outline = sole_rectangle(tree, link, T_link_sole)
    if outline is None:
        why_sole = "no outline: its collision geometry is a mesh or missing; " + why_sole
    sensor = Sensor(f"{name}_foot", joint)
    ankle = default_ankle(tree, link)
    foot = Foot(name, link, sensor.name, outline, T_link_sole, ankle)
    is_default = bool(np.allclose(T_link_sole, default, atol=1e-9))
    return FootGuess(foot, sensor, why_link, why_sensor, why_sole, is_default)


def _guess_sensor(tree: Tree, k: int) -> tuple[str, str]:
    """Return the joint of a foot's sensor: from the foot upwards, the first that looks like one."""
    above: list[int] = []
    while k > 0:
        above.append(k - 1)
        k = int(tree.parents[k])
    for i in above:
        joint = tree.joints[i]
        if not joint.is_movable and _has_word(joint.name, _SENSOR_WORDS):
            return joint.name, "a fixed joint above the foot whose name says so"
    i = next(i for i in above if tree.joints[i].is_movable)
    return (
        tree.joints[i].name,
        "CHECK: no fixed joint is called ft, force or sensor, so the last joint of the leg stands "
        "here; better add the sensor to the URDF as a fixed joint, in its true frame",
    )


def _level_sole(tree: Tree, k: int, default: Array) -> tuple[Array, str]:
    """Return the sole frame: the default where that is level at q = 0, else a level one."""
    R, p = place_at_zero(tree).link(tree.links[k].name)
    up = R[0].T @ np.array([0.0, 0.0, 1.0])
    # A root whose x points backwards has its left foot on the right.
    side = side_of(tree.links[k].name)
    backwards = side in ("left", "right") and (side == "left") != bool(p[0][1] > 0.0)
    ahead = R[0].T @ np.array([-1.0 if backwards else 1.0, 0.0, 0.0])
    z_off = float(np.arccos(np.clip(default[:3, 2] @ up, -1.0, 1.0)))
    x_off = float(np.arccos(np.clip(default[:3, 0] @ ahead, -1.0, 1.0)))
    source = "collision geometry" if tree.links[k].boxes else "frame of the foot link"
    if z_off < _LEVEL and x_off < 0.5:
        return default, f"from the {source}"
    axes = np.column_stack([ahead, np.cross(up, ahead), up])
    origin = default[:3, 3]
    if tree.links[k].boxes and z_off >= _LEVEL:
        return default, f"from the {source}; it is not level at q = 0"
    return (
        transform_from(axes, origin),
        f"level at q = 0 and towards the toes, which the {source} is not",
    )


def _guess_imu(tree: Tree) -> tuple[str | None, str]:
    """Return the link of the IMU: its name says so; not in the head, where there is a choice."""
    found = [link.name for link in tree.links if any("imu" in w for w in _words(link.name))]
    if not found:
        return None, ""
    best = min(
        found,
        key=lambda name: (
            "head" in _words(name),
            not any(w.startswith("accel") for w in _words(name)),
            found.index(name),
        ),
    )
    others = [name for name in found if name != best]
    return best, "its name says so" + (f"; others: {', '.join(others)}" if others else "")
