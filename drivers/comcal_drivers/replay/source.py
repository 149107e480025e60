# SPDX-License-Identifier: Apache-2.0
"""A log of any kind as source and commander: what sources of CAN logs and of bags share."""

from __future__ import annotations

from abc import ABC, abstractmethod
from types import TracebackType

from comcal.measure.plan import PlannedPose
from comcal.measure.source import Block, SourceStatus
from comcal_drivers.replay.seek import PoseSeeker


class LogSource(ABC):
    """Moving means going to where the robot stood in the pose.

    Parameters
    ----------
    seeker : PoseSeeker
        Over the log.
    """

    def __init__(self, seeker: PoseSeeker) -> None:
        self._seeker = seeker

    @property
    @abstractmethod
    def name(self) -> str:
        """What the log is, for the session file."""

    @abstractmethod
    def status(self) -> SourceStatus:
        """Return what was not used of what has been read so far."""

    def move_to(self, pose: PlannedPose) -> None:
        """Go to where the robot stood in *pose*.

        Raises
        ------
        NotReachedError
            If it never did; the message says how near it came.
        """
        self._seeker.move_to(pose)

    def read(self, duration: float) -> Block:
        """Return the samples of the next *duration* seconds of the log.

        Raises
        ------
        NotReachedError
            If the robot left the pose before.
        DataError
            If the log is damaged, or has ended before the first pose was asked for.
        """
        return self._seeker.read(duration)

    def close(self) -> None:
        """Close the log."""
        self._seeker.close()

    def __enter__(self) -> LogSource:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()
