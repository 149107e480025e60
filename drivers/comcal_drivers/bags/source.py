# SPDX-License-Identifier: Apache-2.0
"""Entry point of ``--source bag:FILE``: a recording made with ROS, or by comcal itself."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType

from comcal.errors import UsageError
from comcal.measure.plan import PlannedPose
from comcal.measure.source import Block, SourceRequest, SourceStatus
from comcal_drivers.bags.configuration import read_configuration
from comcal_drivers.bags.log import BagLog
from comcal_drivers.replay.seek import Order, PoseSeeker, SeekOptions


class BagSource:
    """A bag as source and commander: moving means going to where the robot stood in the pose.

    Parameters
    ----------
    log : BagLog
    seeker : PoseSeeker
        Over the same log.
    """

    def __init__(self, log: BagLog, seeker: PoseSeeker) -> None:
        self._log = log
        self._seeker = seeker

    @property
    def name(self) -> str:
        """What reads the bag, and by which clock."""
        return self._log.engine

    def move_to(self, pose: PlannedPose) -> None:
        """Go to where the robot stood in *pose*.

        Raises
        ------
        NotReachedError
            If it never did; the message says how near it came.
        """
        self._seeker.move_to(pose)

    def read(self, duration: float) -> Block:
        """Return the samples of the next *duration* seconds of the bag.

        Raises
        ------
        NotReachedError
            If the robot left the pose before.
        DataError
            If the bag is damaged, or has ended before the first pose was asked for.
        """
        return self._seeker.read(duration)

    def status(self) -> SourceStatus:
        """Return what was not used, and how the bag was understood."""
        return SourceStatus(lost=self._log.lost, notes=self._log.notes)

    def close(self) -> None:
        """Close the bag."""
        self._seeker.close()

    def __enter__(self) -> BagSource:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


def open_bag(request: SourceRequest) -> BagSource:
    """Open a ROS 1 or ROS 2 bag, or raw samples of comcal.

    Parameters
    ----------
    request : SourceRequest
        ``argument`` is the path; ``options`` are described in
        :mod:`comcal_drivers.bags.configuration`.

    Raises
    ------
    UsageError
        If no file is given, there is none, or effects are asked for.
    ConfigError
        If ``sources.bag`` is wrong, or it is not clear which topic is what.
    MissingExtraError
        If ``rosbags`` is not installed.
    DataError
        If the bag cannot be read.
    """
    if not request.argument:
        raise UsageError(
            "no bag is given",
            where="--source bag",
            next_step="type --source bag:FILE, with a .bag, a .mcap or the folder of a ROS 2 bag",
        )
    if request.effects:
        raise UsageError(
            "effects can be hidden in simulated robots only",
            where="--effect",
            next_step="leave it out, or take a simulated source",
        )
    section = read_configuration(request.options, request.robot)
    log = BagLog(Path(request.argument).expanduser(), request.robot, section)
    options = SeekOptions(section.arrival, section.stay, Order(section.order))
    joints = request.robot.tree.joint_names
    return BagSource(log, PoseSeeker(log, joints, request.plan, options))
