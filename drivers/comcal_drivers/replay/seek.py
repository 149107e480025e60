# SPDX-License-Identifier: Apache-2.0
"""A log as a robot that can be sent to poses: moving means going to where it stood in them.

Nothing here knows what kind of log it is: CAN frames and ROS bags come as :class:`Log`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from typing import Protocol

import numpy as np

from comcal.errors import DataError, NotReachedError
from comcal.measure.plan import PlannedPose
from comcal.measure.source import Block
from comcal.robot.tree import Array
from comcal_drivers.replay.assign import assign_any_order, assign_in_order
from comcal_drivers.replay.reading import BlockReader
from comcal_drivers.replay.visits import Visit, Visits, find_visits


class Log(Protocol):
    """Recorded samples that can be read more than once."""

    @property
    def name(self) -> str:
        """The file, for messages."""
        ...

    def blocks(self, start: float) -> Iterator[Block]:
        """Return the samples from *start* [s] on, in order; minus infinity: all.

        Blocks may begin earlier than *start*. Every call begins anew; wherever it begins, a
        sample has the same values.
        """
        ...


class Order(Enum):
    """How the log and the plan go together."""

    PLANNED = "planned"
    """The robot was led through the poses in the order of the plan; some may be missing."""
    ANY = "any"
    """In whatever order."""


@dataclass(frozen=True)
class SeekOptions:
    """When the robot of a log counts as being in a planned pose.

    Parameters
    ----------
    arrival : float
        Largest distance of every joint from its planned position [rad] or [m].
    stay : float
        Shorter visits are passing through [s].
    order : Order
    """

    arrival: float = 0.05
    stay: float = 0.5
    order: Order = Order.PLANNED


class PoseSeeker:
    """Source and commander over a log.

    The log is read once for where the robot stood, when the first pose is asked for, and then
    again for the samples. :meth:`read` never goes past the end of the visit: what comes then
    belongs to another pose.

    Parameters
    ----------
    log : Log
    joint_names : sequence of str
        Of the columns of ``Block.q``.
    plan : sequence of PlannedPose
        All poses of the session; empty where nobody knows. Poses that are not among them (redone
        ones have new numbers) are found by their joint positions alone.
    options : SeekOptions
    """

    def __init__(
        self,
        log: Log,
        joint_names: Sequence[str],
        plan: Sequence[PlannedPose],
        options: SeekOptions | None = None,
    ) -> None:
        self._log = log
        self._joints = tuple(joint_names)
        self._plan = tuple(plan)
        self._options = options or SeekOptions()
        self._reader = BlockReader(log.blocks)
        self._pose: int | None = None
        self._left: list[Visit] = []
        self._visit: Visit | None = None
        self._others: dict[bytes, tuple[Visits, int]] = {}

    def move_to(self, pose: PlannedPose) -> None:
        """Go to where the robot stood in *pose*.

        Sent to the same pose once more, it goes on in the same visit as long as that lasts, then
        to the next one.

        Parameters
        ----------
        pose : PlannedPose

        Raises
        ------
        NotReachedError
            If the robot never stood there (any more, in the order of the plan).
        """
        again = pose.pose == self._pose
        if again and self._visit and self._visit.end - self._reader.t >= self._options.stay:
            return
        if not again:
            self._pose = pose.pose
            self._left = list(self._candidates(pose))
        self._visit = None
        if not self._left:
            raise self._not_reached(pose)
        self._visit = self._left.pop(0)
        self._reader.go_to(self._visit.start)

    def read(self, duration: float) -> Block:
        """Return the samples of the next *duration* seconds of the log, fewer where they end.

        Before the first pose is asked for, the log is read from its beginning.

        Parameters
        ----------
        duration : float
            [s]

        Raises
        ------
        NotReachedError
            If the robot left the pose before.
        DataError
            If the log has ended.
        """
        if self._pose is None:
            return self._read_on(duration)
        block = None if self._visit is None else self._reader.read(duration, self._visit.end)
        if block is None:
            seconds = 0.0 if self._visit is None else self._visit.seconds
            raise NotReachedError(
                "the robot has left the pose",
                where=f"{self._log.name}: pose {self._pose}",
                measured=f"it stood there for {seconds:.3g} s",
                next_step="stand longer in every pose",
            )
        return block

    def close(self) -> None:
        """Let go of the log."""
        self._reader.close()

    def _read_on(self, duration: float) -> Block:
        block = self._reader.read(duration)
        if block is None:
            raise DataError(
                "the log has ended" if self._reader.has_read else "the log has no samples",
                where=self._log.name,
                next_step="give one that lasts longer",
            )
        return block

    @cached_property
    def _places(self) -> tuple[Array, list[int]]:
        """Distinct joint positions of the plan, and which of them each pose is at."""
        index: dict[bytes, int] = {}
        of_pose = [index.setdefault(_key(pose.q), len(index)) for pose in self._plan]
        q = [np.frombuffer(key) for key in index]
        return np.array(q).reshape(len(q), len(self._joints)), of_pose

    @cached_property
    def _visits(self) -> Visits:
        return find_visits(self._log.blocks(-np.inf), self._places[0], self._options.arrival)

    @cached_property
    def _assigned(self) -> dict[int, tuple[Visit, ...]]:
        """The visits to try for each pose of the plan, by its number."""
        long_enough = [self._long(visits) for visits in self._visits.by_place]
        assign = assign_in_order if self._options.order is Order.PLANNED else assign_any_order
        found = assign(self._places[1], long_enough)
        return {pose.pose: visits for pose, visits in zip(self._plan, found, strict=True)}

    def _candidates(self, pose: PlannedPose) -> tuple[Visit, ...]:
        """Return the visits to try for a pose, planned or not."""
        planned = next((p for p in self._plan if p.pose == pose.pose), None)
        if planned is not None and _key(planned.q) == _key(pose.q):
            return self._assigned[pose.pose]
        visits, place = self._found(pose)
        long_enough = self._long(visits.by_place[place])
        if self._options.order is Order.ANY:
            return long_enough
        return tuple(visit for visit in long_enough if visit.end > self._reader.t)

    def _found(self, pose: PlannedPose) -> tuple[Visits, int]:
        """Return what is known of the place of a pose: where it stands in which visits."""
        key = _key(pose.q)
        for known, place in zip(self._plan, self._places[1], strict=True):
            if _key(known.q) == key:
                return self._visits, place
        if key not in self._others:
            places = np.vstack([self._places[0], np.frombuffer(key)])
            found = find_visits(self._log.blocks(-np.inf), places, self._options.arrival)
            self._others[key] = found, len(places) - 1
        return self._others[key]

    def _long(self, visits: Sequence[Visit]) -> tuple[Visit, ...]:
        return tuple(visit for visit in visits if visit.seconds >= self._options.stay)

    def _not_reached(self, pose: PlannedPose) -> NotReachedError:
        """Say why there is no visit to go to."""
        found, place = self._found(pose)
        visits, nearest = found.by_place[place], found.nearest[place]
        options = self._options
        measured = limit = ""
        if found.samples == 0:
            what, next_step = "the log has no samples", "give another file"
        elif found.unknown == found.samples:
            what = "no sample of the log has all joint positions"
            next_step = "their messages are too old or absent: check the topics and the timeout"
        elif not visits:
            joint = self._joints[nearest.joint] if nearest.joint >= 0 else "every joint"
            what = f"the robot is never in this pose; it is nearest at t = {nearest.t:.3f} s"
            measured = f"joint {joint} is {nearest.distance:.3g} rad (or m) off"
            limit = f"{options.arrival:.3g}"
            next_step = "lead the robot through all poses of the plan, or raise arrival"
        elif not self._long(visits):
            longest = max(visit.seconds for visit in visits)
            what = f"the robot only passes through this pose, at t = {visits[0].start:.3f} s"
            measured, limit = f"it stays for {longest:.3g} s", f"at least {options.stay:.3g} s"
            next_step = "stand longer in every pose"
        else:
            when = ", ".join(f"{visit.start:.3f}" for visit in self._long(visits)[:5])
            what = f"the log has no further visit of this pose; it is visited at t = {when} s"
            next_step = (
                "if the poses come in another order than planned, set order: any"
                if options.order is Order.PLANNED
                else "record it again"
            )
        return NotReachedError(
            what,
            where=f"{self._log.name}: pose {pose.pose}",
            measured=measured,
            limit=limit,
            next_step=next_step,
        )


def _key(q: Array) -> bytes:
    """Return joint positions as something that can be looked up; -0 is 0."""
    return (np.ascontiguousarray(q, dtype=np.float64) + 0.0).tobytes()
