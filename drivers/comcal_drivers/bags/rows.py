# SPDX-License-Identifier: Apache-2.0
"""From messages to blocks: a row for every sample of the clock, with the newest of all the rest."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from comcal.measure.source import Block
from comcal.robot.model import Robot
from comcal.robot.tree import Array, JointType
from comcal_drivers.bags.channels import Channels
from comcal_drivers.bags.configuration import CURRENTS, IMU, JOINTS, TEMPERATURE, BagSection
from comcal_drivers.bags.messages import NANOSECONDS, Message, Shape
from comcal_drivers.bags.stream import LATENESS, Counts, Stamps, Stream, count
from comcal_drivers.bags.survey import Survey

Indices = npt.NDArray[np.intp]

SLOW = 60.0
"""Temperatures change slowly and are sent seldom: they count for this long [s]."""
_NAN = np.array(np.nan, dtype="<f8").tobytes()


class _Sender(NamedTuple):
    """What one sender says, which of its numbers are the robot's, and their columns."""

    stream: Stream
    picks: Indices
    columns: Indices


class _Route(NamedTuple):
    """What becomes of the numbers of a message: bytes ``start`` to ``stop``, then ``lacking``."""

    channel: str
    stream: Stream | None
    start: int = 0
    stop: int | None = None
    lacking: bytes = b""
    is_malformed: bool = False


class RowMaker:
    """Takes messages in the order in which they were written, gives blocks.

    Parameters
    ----------
    robot : Robot
    channels : Channels
    section : BagSection
    effort : str
        What the efforts of the joints' messages are: ``torque``, ``current`` or ``ignore``.
    survey : Survey
    counts : Counts
        Is counted up.
    """

    def __init__(
        self,
        robot: Robot,
        channels: Channels,
        section: BagSection,
        effort: str,
        survey: Survey,
        counts: Counts,
    ) -> None:
        self._robot = robot
        self._channels = channels
        self._section = section
        self._effort = effort
        self._survey = survey
        self._counts = counts
        self._channel_of = {t: name for name, ts in channels.by_name.items() for t in ts}
        self._senders: dict[tuple[str, tuple[str, ...]], _Sender] = {}
        self._routes: dict[Shape, _Route] = {}
        self._rows = Stream(channels.clock, 0, Counts())
        self._columns = {
            section.joint_names.get(joint, joint): k
            for k, joint in enumerate(robot.tree.joint_names)
        }
        self._factors = _factors(section, robot)

    def add(self, message: Message) -> None:
        """Take the next message.

        Raises
        ------
        DataError
            If stamps go back by more than messages can be late.
        """
        topic, logged, stamp, shape, numbers = message
        if not self._survey.header:
            stamp = logged
        route = self._routes.get(shape)
        if route is None:
            route = self._routes[shape] = self._route(topic, shape)
        if route.stream is not None:
            route.stream.add(stamp, logged, numbers[route.start : route.stop] + route.lacking)
        elif route.is_malformed:
            count(self._counts.malformed, route.channel)
        if route.channel == self._channels.clock:
            self._rows.add(stamp, logged, b"")

    def blocks(self, now: int | None) -> Block | None:
        """Return the rows that are complete, None if there are none.

        Parameters
        ----------
        now : int or None
            When the newest message was written [ns]; None: no more will come.
        """
        last = np.iinfo(np.int64).max if now is None else now - LATENESS
        stamps, logged = self._rows.take(last)
        block = self._block(stamps, logged) if stamps.size else None
        if now is not None:
            for sender in self._senders.values():
                sender.stream.forget(now)
        return block

    def _route(self, topic: str, shape: Shape) -> _Route:
        """Say which numbers of messages of a shape go where."""
        channel = self._channel_of[topic]
        if channel not in (JOINTS, CURRENTS):
            every = np.arange(self._width(channel))
            return _Route(channel, self._stream(topic, channel, (), every, every))
        n, names, (positions, efforts) = len(self._columns), shape.names, shape.counts
        own = np.array([k for k, name in enumerate(names) if name in self._columns], dtype=np.intp)
        to = np.array([self._columns[names[k]] for k in own], dtype=np.intp)
        if own.size == 0:
            return _Route(channel, None)
        if channel == CURRENTS:
            start, is_malformed, lacking = 8 * positions, efforts != len(names), b""
        elif self._effort == "ignore":
            start, is_malformed, lacking, efforts = 0, positions != len(names), b"", 0
        else:
            start, lacking = 0, b"" if efforts else _NAN * len(names)
            is_malformed = positions != len(names) or efforts not in (0, len(names))
            own, to = np.append(own, len(names) + own), np.append(to, n + to)
        if is_malformed:
            return _Route(channel, None, is_malformed=True)
        stream = self._stream(topic, channel, names, own, to)
        return _Route(channel, stream, start, 8 * (positions + efforts), lacking)

    def _stream(
        self, topic: str, channel: str, names: tuple[str, ...], own: Indices, to: Indices
    ) -> Stream:
        """Return the stream of a sender, made when it is first heard of."""
        if (topic, names) not in self._senders:
            width = self._width(channel) if not names else len(names)
            if channel == JOINTS and self._effort != "ignore":
                width *= 2
            self._senders[topic, names] = _Sender(Stream(channel, width, self._counts), own, to)
        return self._senders[topic, names].stream

    def _width(self, channel: str) -> int:
        n = len(self._columns)
        if channel == JOINTS:
            return n if self._effort == "ignore" else 2 * n
        if channel == CURRENTS:
            return n
        return 3 if channel == IMU else 1 if channel.startswith(TEMPERATURE) else 6

    def _block(self, stamps: Stamps, logged: Stamps) -> Block:
        values = {name: self._at(name, stamps, logged) for name in self._channels.by_name}
        n = len(self._columns)
        effort = values[JOINTS][:, n:] if self._effort != "ignore" else None
        torques = effort if self._effort == "torque" else None
        currents = effort if self._effort == "current" else values.get(CURRENTS)
        f = self._factors
        return Block(
            t=(stamps - self._survey.origin) / NANOSECONDS,
            q=values[JOINTS][:, :n] * f.q,
            wrenches={name: values[name] * f.wrench for name in self._channels.wrenches},
            torques=None if torques is None else torques * f.torque,
            currents=None if currents is None else currents * f.current,
            imu=values[IMU] * f.acceleration if IMU in values else None,
            temperatures={
                name: values[TEMPERATURE + name][:, 0] for name in self._channels.temperatures
            },
        )

    def _at(self, channel: str, stamps: Stamps, logged: Stamps) -> Array:
        """Return the values of a channel in every row; NaN where they are too old."""
        width = self._width(channel)
        numbers = np.full((len(stamps), width), np.nan)
        newest = np.full((len(stamps), width), np.iinfo(np.int64).min)
        timeout = SLOW if channel.startswith(TEMPERATURE) else self._section.timeout
        topics = self._channels.by_name[channel]
        for (topic, _), sender in self._senders.items():
            if topic not in topics:
                continue
            own, found = sender.stream.at(stamps, logged)
            fresh = stamps - own <= round(timeout * NANOSECONDS)
            rows, k = np.nonzero(fresh[:, None] & (own[:, None] > newest[:, sender.columns]))
            numbers[rows, sender.columns[k]] = found[rows, sender.picks[k]]
            newest[rows, sender.columns[k]] = own[rows]
        stale = int(np.count_nonzero((newest == np.iinfo(np.int64).min).any(axis=1)))
        if stale:
            count(self._counts.stale, channel, stale)
        return numbers


@dataclass(frozen=True)
class _Factors:
    """From the units of the messages to SI: of each joint, and of the others."""

    q: Array
    wrench: Array
    torque: Array
    current: float
    acceleration: float


def _factors(section: BagSection, robot: Robot) -> _Factors:
    units, tree = section.units, robot.tree
    slides = np.array(
        [
            tree.joints[tree.joint_index[name]].kind is JointType.PRISMATIC
            for name in tree.joint_names
        ],
        dtype=np.bool_,
    )
    return _Factors(
        q=np.where(slides, units.length, units.angle),
        wrench=np.array([units.force] * 3 + [units.moment] * 3),
        torque=np.where(slides, units.force, units.torque),
        current=units.current,
        acceleration=units.acceleration,
    )
