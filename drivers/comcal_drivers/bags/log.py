# SPDX-License-Identifier: Apache-2.0
"""A bag as blocks of samples: what :mod:`comcal_drivers.replay` replays."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from comcal.measure.source import Block
from comcal.robot.model import Robot
from comcal_drivers.bags.channels import choose_channels
from comcal_drivers.bags.configuration import BagSection
from comcal_drivers.bags.messages import NANOSECONDS
from comcal_drivers.bags.reader import Bag
from comcal_drivers.bags.rows import SLOW, RowMaker
from comcal_drivers.bags.stream import LATENESS, Counts
from comcal_drivers.bags.survey import survey

_PIECE = NANOSECONDS
"""Length of log that makes a block [ns]."""
_MARGIN = 5 * NANOSECONDS
"""Stamps and times of writing may drift apart by this much [ns] in the course of a bag."""


class BagLog:
    """The samples of a bag; see :class:`comcal_drivers.replay.seek.Log`.

    Parameters
    ----------
    path : Path
    robot : Robot
    section : BagSection

    Raises
    ------
    ConfigError
        If it is not clear which topic is what, or joints are missing.
    MissingExtraError, UsageError, DataError
        As :class:`comcal_drivers.bags.reader.Bag`.
    """

    def __init__(self, path: Path, robot: Robot, section: BagSection) -> None:
        self._bag = Bag(path)
        self._robot = robot
        self._section = section
        self._channels = choose_channels(section, self._bag.topics, robot, self._bag.name)
        self._survey = survey(self._bag, self._channels, section, robot)
        self._effort = self._meaning_of_effort()
        self._most = Counts()

    @property
    def name(self) -> str:
        """The file, for messages."""
        return self._bag.name

    @property
    def engine(self) -> str:
        """What reads it, for the session file."""
        stamps = "header stamps" if self._survey.header else "times of writing"
        return f"{self._bag.library}, {stamps}, clock {self._channels.clock}"

    @property
    def notes(self) -> tuple[str, ...]:
        """What was decided, in words."""
        topics = (
            f"{channel}: {', '.join(topics)}" for channel, topics in self._channels.by_name.items()
        )
        torn = (f"{name} breaks off; what is before is read" for name in self._bag.torn)
        return (*torn, *self._survey.notes, "topics read: " + "; ".join(topics))

    @property
    def lost(self) -> dict[str, int]:
        """Messages and rows that were not used, by channel and reason, in the longest reading."""
        return self._most.lost()

    def blocks(self, start: float) -> Iterator[Block]:
        """Return the samples from *start* [s] on, or somewhat before; minus infinity: all.

        Parameters
        ----------
        start : float
            In the time of ``Block.t`` [s].

        Raises
        ------
        DataError
            If the bag is damaged or its stamps go back.
        """
        counts = Counts()
        rows = RowMaker(
            self._robot, self._channels, self._section, self._effort, self._survey, counts
        )
        due: int | None = None
        for message in self._bag.messages(self._channels.topics, self._first_to_read(start)):
            due = message.log_ns + _PIECE if due is None else due
            if message.log_ns > due:
                due = message.log_ns + _PIECE
                block = rows.blocks(message.log_ns)
                if block is not None:
                    yield block
            rows.add(message)
        block = rows.blocks(None)
        if block is not None:
            yield block
        self._keep(counts)

    def _first_to_read(self, start: float) -> int | None:
        """Return the log time from which on everything that a row at *start* needs is read."""
        if np.isneginf(start):
            return None
        oldest = SLOW if self._channels.temperatures else self._section.timeout
        begin = self._survey.origin + round((start - oldest) * NANOSECONDS)
        return max(begin + self._survey.delay - LATENESS - _MARGIN, 0)

    def _meaning_of_effort(self) -> str:
        """Return ``torque``, ``current`` or ``ignore``; in our own recordings it is torque."""
        if not self._survey.has_effort:
            return "ignore"
        return self._section.effort or ("torque" if self._bag.is_own else "ignore")

    def _keep(self, counts: Counts) -> None:
        if sum(counts.lost().values()) >= sum(self._most.lost().values()):
            self._most = counts
