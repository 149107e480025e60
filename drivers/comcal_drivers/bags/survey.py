# SPDX-License-Identifier: Apache-2.0
"""A first look into a bag: whose clock counts, where the log begins, what its messages hold."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice

from comcal.errors import ConfigError
from comcal.robot.model import Robot
from comcal.robot.validate import did_you_mean
from comcal_drivers.bags.channels import Channels
from comcal_drivers.bags.configuration import BagSection
from comcal_drivers.bags.messages import NANOSECONDS, Message
from comcal_drivers.bags.reader import Bag

_SAME_CLOCK = NANOSECONDS
"""Delays between measuring and writing that differ by more [ns] are different clocks."""
_UPTIME = 1_000_000 * NANOSECONDS
"""Stamps below this [ns] count from a start; larger ones from an epoch, and nanoseconds since the
epoch do not fit into a float64."""
_NAMES_WITHIN = 200
"""Messages in which every sender of joint positions has spoken once."""


@dataclass(frozen=True)
class Survey:
    """What holds for the whole bag.

    Parameters
    ----------
    header : bool
        Whether the stamps in the messages count, instead of the times of writing.
    notes : tuple of str
        What was decided, in words.
    origin : int
        Stamp at which ``Block.t`` is zero [ns].
    delay : int
        From the stamp of the clock's first message to its writing [ns].
    has_effort : bool
        Whether messages of joint positions hold efforts.
    """

    header: bool
    notes: tuple[str, ...]
    origin: int
    delay: int
    has_effort: bool


def survey(bag: Bag, channels: Channels, section: BagSection, robot: Robot) -> Survey:
    """Look at the first messages of every topic.

    Parameters
    ----------
    bag : Bag
    channels : Channels
    section : BagSection
    robot : Robot

    Raises
    ------
    ConfigError
        If joints of the robot are not in the messages.
    """
    joint_messages = [
        message
        for topic in channels.joints
        for message in islice(bag.messages([topic]), _NAMES_WITHIN)
    ]
    _check_joints(joint_messages, section, robot, bag.name)
    first = {topic: next(bag.messages([topic])) for topic in channels.topics}
    header, why = _decide_stamps(first, section)
    clock = min(
        (first[topic] for topic in channels.by_name[channels.clock]), key=lambda m: m.log_ns
    )
    stamp = clock.stamp_ns if header else clock.log_ns
    notes = [why, *_frames(first, channels, robot)]
    has_effort = any(message.shape.counts[1] > 0 for message in joint_messages)
    if has_effort and section.effort is None and not bag.is_own:
        notes.append(
            f"{channels.joints[0]}: efforts are not read; set effort: torque or effort: current"
        )
    return Survey(
        header=header,
        notes=tuple(notes),
        origin=0 if 0 <= stamp < _UPTIME else stamp,
        delay=clock.log_ns - stamp,
        has_effort=has_effort,
    )


def _decide_stamps(first: dict[str, Message], section: BagSection) -> tuple[bool, str]:
    """Return whether the stamps in the messages are to be used, and why, in words."""
    if section.stamps != "auto":
        words = "header stamps" if section.stamps == "header" else "times of writing"
        return section.stamps == "header", f"{words} are used, as configured"
    unset = [topic for topic, message in first.items() if message.stamp_ns == 0]
    if unset:
        return False, f"times of writing are used: {unset[0]} has no header stamps"
    delays = {topic: m.log_ns - m.stamp_ns for topic, m in first.items()}
    low, high = min(delays, key=lambda t: delays[t]), max(delays, key=lambda t: delays[t])
    apart = delays[high] - delays[low]
    if apart > _SAME_CLOCK:
        return False, (
            f"times of writing are used: the clocks of {low} and {high} are "
            f"{apart / NANOSECONDS:.3g} s apart"
        )
    return True, "header stamps are used"


def _check_joints(
    messages: Sequence[Message], section: BagSection, robot: Robot, where: str
) -> None:
    """Refuse a bag that does not have every joint."""
    seen: dict[str, None] = {}
    for message in messages:
        seen.update(dict.fromkeys(message.shape.names))
    for joint in robot.tree.joint_names:
        name = section.joint_names.get(joint, joint)
        if name not in seen:
            topics = sorted({message.topic for message in messages})
            raise ConfigError(
                f"joint {name} is not in the messages of {', '.join(topics)}",
                where=where,
                next_step=f"{did_you_mean(name, list(seen))}".rstrip()
                + " give its name there in sources.bag.joint_names, or another topic",
            )


def _frames(first: dict[str, Message], channels: Channels, robot: Robot) -> list[str]:
    """Say which wrenches are in the frame of another link than robot.yaml says."""
    notes: list[str] = []
    for name, topic in channels.wrenches.items():
        frame = first[topic].shape.frame.lstrip("/")
        if name not in robot.sensors or frame not in robot.tree.link_index:
            continue
        joint = robot.tree.joints[robot.tree.joint_index[robot.sensors[name].joint]]
        if frame != joint.child:
            notes.append(
                f"{topic}: its messages are in frame {frame}, robot.yaml says {joint.child} "
                f"(the child of {joint.name}): the numbers are taken as they are"
            )
    return notes
