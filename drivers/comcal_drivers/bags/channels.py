# SPDX-License-Identifier: Apache-2.0
"""Which topic of a bag is which channel: as configured, else by type and name if only one fits."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

from comcal.errors import ConfigError
from comcal.measure import cdr
from comcal.measure.raw import topic_words
from comcal.robot.model import Robot
from comcal_drivers.bags.configuration import CURRENTS, IMU, JOINTS, TEMPERATURE, BagSection
from comcal_drivers.bags.reader import Topic

_SIDES = {"l": "left", "r": "right"}
_FEWEST_TO_SHOW = 30


@dataclass(frozen=True)
class Channels:
    """Topics by what they measure.

    Parameters
    ----------
    joints, currents : tuple of str
        Topics of joint positions, and of motor currents (in the field ``effort``).
    wrenches : mapping from sensor or plate to str
    imu : str or None
    temperatures : mapping from sensor to str
    clock : str
        The channel whose samples make the rows.
    """

    joints: tuple[str, ...]
    currents: tuple[str, ...]
    wrenches: Mapping[str, str]
    imu: str | None
    temperatures: Mapping[str, str]
    clock: str

    @property
    def by_name(self) -> dict[str, tuple[str, ...]]:
        """Topics of every channel that is read."""
        found = {JOINTS: self.joints, CURRENTS: self.currents, IMU: (self.imu,) if self.imu else ()}
        found |= {name: (topic,) for name, topic in self.wrenches.items()}
        found |= {TEMPERATURE + name: (topic,) for name, topic in self.temperatures.items()}
        return {name: topics for name, topics in found.items() if topics}

    @property
    def topics(self) -> tuple[str, ...]:
        """All of them."""
        return tuple(topic for topics in self.by_name.values() for topic in topics)


def choose_channels(
    section: BagSection, topics: Mapping[str, Topic], robot: Robot, where: str
) -> Channels:
    """Give every channel of the robot its topics.

    Parameters
    ----------
    section : BagSection
        What it names is taken; the rest is found where it is beyond doubt.
    topics : mapping from str to Topic
        Of the bag.
    robot : Robot
    where : str
        The bag, for messages.

    Raises
    ------
    ConfigError
        If a topic is missing, of another type or wanted twice, or if it is not clear which one is
        meant. The message lists the topics that there are.
    """
    return _Choice(section, topics, robot, where).made()


def topic_list(topics: Mapping[str, Topic]) -> str:
    """Return all topics with their types and counts, those that can be read first."""
    order = sorted(topics, key=lambda name: (topics[name].kind not in cdr.DEFINITIONS, name))
    words = [f"{name} ({topics[name].kind}, {topics[name].count})" for name in order]
    more = len(words) - _FEWEST_TO_SHOW
    return "; ".join(words[:_FEWEST_TO_SHOW]) + (f"; and {more} more" if more > 0 else "")


class _Choice:
    """One choice in progress: ``free`` are the topics that nobody has yet."""

    def __init__(
        self, section: BagSection, topics: Mapping[str, Topic], robot: Robot, where: str
    ) -> None:
        self.section = section
        self.topics = topics
        self.robot = robot
        self.where = where
        self.free = [name for name, topic in topics.items() if topic.count]

    def made(self) -> Channels:
        """Return the channels: first what is configured, so that guesses cannot take it."""
        sensors = (*self.robot.sensors, *self.robot.plates)
        kinds = {JOINTS: cdr.JOINTS, CURRENTS: cdr.JOINTS, IMU: cdr.IMU}
        kinds |= dict.fromkeys(sensors, cdr.WRENCH)
        kinds |= {TEMPERATURE + name: cdr.TEMPERATURE for name in sensors}
        given = {channel: self._given(channel, kinds[channel]) for channel in self.section.topics}
        for channel in (CURRENTS, JOINTS, IMU):
            given.setdefault(channel, ())
            if channel not in self.section.topics:
                given[channel] = self._only(channel, kinds[channel])
        wrenches = self._by_sensor(sensors, given, "", required=True)
        temperatures = self._by_sensor(sensors, given, TEMPERATURE, required=False)
        imu = given[IMU]
        clock = self.section.clock or next(iter(wrenches), JOINTS)
        channels = Channels(
            joints=given[JOINTS],
            currents=given[CURRENTS],
            wrenches=wrenches,
            imu=imu[0] if imu else None,
            temperatures=temperatures,
            clock=clock,
        )
        if clock not in channels.by_name:
            raise ConfigError(
                f"the clock {clock!r} is not read",
                where=self.where,
                next_step="give it a topic, or take another channel as the clock: "
                + ", ".join(channels.by_name),
            )
        return channels

    def _given(self, channel: str, kind: str) -> tuple[str, ...]:
        """Return the topics configured for a channel."""
        value = self.section.topics[channel]
        names = () if not value else (value,) if isinstance(value, str) else tuple(value)
        for name in names:
            topic = self.topics.get(name)
            if topic is None:
                raise self._error(f"there is no topic {name} for {channel}")
            if topic.kind != kind:
                raise self._error(f"topic {name} is {topic.kind}, but {channel} needs {kind}")
            if topic.count == 0:
                raise self._error(f"topic {name} of {channel} has no messages")
            if name not in self.free:
                raise self._error(f"topic {name} is given to two channels")
            self.free.remove(name)
        return names

    def _only(self, channel: str, kind: str) -> tuple[str, ...]:
        """Return the topic of a channel that there is once in a robot."""
        if channel == IMU and self.robot.imu_link is None:
            return ()
        usual = {JOINTS: "joint_states", CURRENTS: "motor_currents", IMU: "imu"}[channel]
        found = [name for name in self.free if self.topics[name].kind == kind]
        named = [name for name in found if name.rsplit("/", 1)[-1] == usual]
        if len(named) == 1:
            found = named
        elif channel == CURRENTS:
            return ()  # efforts are currents only where somebody says so
        if not found and channel == IMU:
            return ()
        if len(found) != 1:
            few = "no topic" if not found else "more than one topic"
            raise self._error(f"{few} of type {kind} could be {channel}")
        self.free.remove(found[0])
        return (found[0],)

    def _by_sensor(
        self,
        sensors: Sequence[str],
        given: Mapping[str, tuple[str, ...]],
        prefix: str,
        *,
        required: bool,
    ) -> dict[str, str]:
        """Return a topic for each sensor: of its wrench, or of its temperature."""
        kind = cdr.WRENCH if required else cdr.TEMPERATURE
        wanted = [name for name in sensors if prefix + name not in self.section.topics]
        found = [name for name in self.free if self.topics[name].kind == kind]
        if required and len(wanted) == len(found) == 1 == len(sensors):
            guessed = {wanted[0]: found[0]}
        else:
            guessed = match_names(wanted, found)
        missing = [name for name in wanted if name not in guessed]
        if required and missing:
            raise self._error(f"it is not clear which topic has the wrench of {missing[0]}")
        for topic in guessed.values():
            self.free.remove(topic)
        chosen = {name: given[prefix + name][0] for name in sensors if given.get(prefix + name)}
        chosen |= guessed
        return {name: chosen[name] for name in sensors if name in chosen}

    def _error(self, what: str) -> ConfigError:
        return ConfigError(
            what,
            where=self.where,
            next_step="say it in robot.yaml, such as `sources: {bag: {topics: {l_foot: "
            f"/ft/left, joints: /joint_states}}}}}}`; the bag has: {topic_list(self.topics)}",
        )


def match_names(names: Sequence[str], topics: Sequence[str]) -> dict[str, str]:
    """Return the topic of each name for which exactly one fits, and which fits no other name.

    Parameters
    ----------
    names : sequence of str
        Of sensors.
    topics : sequence of str
        A topic fits if it contains all words of the name (``l`` is ``left``); those whose last
        part is the name itself go first; a side alone (``/ft/left``) is the last resort.
    """
    words = topic_words(names)
    matched: dict[str, str] = {}
    for rule in (partial(_is_named, words), _has_all_words, _is_on_its_side):
        names = [name for name in names if name not in matched]
        topics = [topic for topic in topics if topic not in matched.values()]
        fits = {name: [topic for topic in topics if rule(name, topic)] for name in names}
        for name, found in fits.items():
            if len(found) == 1 and sum(found[0] in other for other in fits.values()) == 1:
                matched[name] = found[0]
    return matched


def _is_named(words: Mapping[str, str], name: str, topic: str) -> bool:
    return topic.rsplit("/", 1)[-1] in (name, words[name])


def _has_all_words(name: str, topic: str) -> bool:
    return _words(name) <= _words(topic)


def _is_on_its_side(name: str, topic: str) -> bool:
    side = _words(name) & frozenset(_SIDES.values())
    return bool(side) and side <= _words(topic)


def _words(name: str) -> frozenset[str]:
    parts: list[str] = re.findall(
        r"[a-z]+|[0-9]+", re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name).lower()
    )
    return frozenset(_SIDES.get(part, part) for part in parts)
