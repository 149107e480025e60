# SPDX-License-Identifier: Apache-2.0
"""Entry point of ``--source bag:FILE``: a recording made with ROS, or by comcal itself."""

from __future__ import annotations

from pathlib import Path

from comcal.errors import UsageError
from comcal.measure.source import SourceRequest, SourceStatus
from comcal_drivers.bags.configuration import read_configuration
from comcal_drivers.bags.log import BagLog
from comcal_drivers.replay.seek import Order, PoseSeeker, SeekOptions
from comcal_drivers.replay.source import LogSource


class BagSource(LogSource):
    """A bag as source and commander.

    Parameters
    ----------
    log : BagLog
    seeker : PoseSeeker
        Over the same log.
    """

    def __init__(self, log: BagLog, seeker: PoseSeeker) -> None:
        super().__init__(seeker)
        self._log = log

    @property
    def name(self) -> str:
        """What reads the bag, and by which clock."""
        return self._log.engine

    def status(self) -> SourceStatus:
        """Return what was not used, and how the bag was understood."""
        return SourceStatus(lost=self._log.lost, notes=self._log.notes)


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
    request.refuse_effects()
    if not request.argument:
        raise UsageError(
            "no bag is given",
            where="--source bag",
            next_step="type --source bag:FILE, with a .bag, a .mcap or the folder of a ROS 2 bag",
        )
    section = read_configuration(request.options, request.robot)
    log = BagLog(Path(request.argument).expanduser(), request.robot, section)
    options = SeekOptions(section.arrival, section.stay, Order(section.order))
    joints = request.robot.tree.joint_names
    return BagSource(log, PoseSeeker(log, joints, request.plan, options))
