# SPDX-License-Identifier: Apache-2.0
"""Logs of frames as a source that can be sent to poses: ``--source replay:FILE``."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from comcal.errors import ConfigError, UsageError
from comcal.measure.source import Block, SourceRequest, SourceStatus
from comcal.robot.model import Robot
from comcal_drivers.bus.error_frames import bus_off_rows, is_gap
from comcal_drivers.devices.commands import DeviceValues
from comcal_drivers.devices.configuration import CanConfig, read_configuration
from comcal_drivers.frames.batch import ERROR, FrameBatch
from comcal_drivers.frames.logs import read_log
from comcal_drivers.replay.seek import Order, PoseSeeker, SeekOptions
from comcal_drivers.replay.source import LogSource
from comcal_drivers.source.fitted import fitted
from comcal_drivers.source.logs import FOLDER, devices_told, first_stamp
from comcal_drivers.source.stream import SampleStream

CHUNK = 20_000
"""Frames that are decoded at once."""


@dataclass
class CanLog:
    """One or more logs of frames, one after the other, as samples.

    Parameters
    ----------
    path : Path
        A log, or a folder of a session: then all its logs in the order of their first frames.
    config : CanConfig
    robot : Robot
    told : mapping from device to values
        What devices told when the logs were written.
    stream : SampleStream or None
        What makes samples of the frames; None before the first reading.
    torn : int
        Lines that were no frames, so far.
    noted : mapping from name to int
        What the adapter and the reader noted of the bus, so far.
    """

    path: Path
    config: CanConfig
    robot: Robot
    told: Mapping[str, DeviceValues]
    stream: SampleStream | None = None
    torn: int = 0
    noted: Counter[str] = field(default_factory=Counter[str])

    @property
    def name(self) -> str:
        """The file or folder."""
        return str(self.path)

    def blocks(self, start: float) -> Iterator[Block]:
        """Yield all samples from the beginning of the log.

        What came earlier than *start* has to be read to know what comes later; it is yielded too.
        """
        del start
        channel = self._channel()
        with fitted(self.config) as config:
            stream = SampleStream(config, self.robot, self.told)
            self.stream, self.torn, self.noted = stream, 0, Counter()
            for path in self._files():
                log = read_log(path, CHUNK)
                for batch in log:
                    self._note(batch, channel)
                    block = stream.feed({channel: batch})
                    if block.t.size:
                        yield block
                self.torn += log.torn
            block = stream.finish()
            if block.t.size:
                yield block

    def _note(self, batch: FrameBatch, channel: str) -> None:
        found = {
            "error frames": (batch.kinds & ERROR) != 0,
            "bus offs": bus_off_rows(batch),
            "gaps": is_gap(batch),
        }
        self.noted.update(
            {f"{channel} {what}": int(np.count_nonzero(rows)) for what, rows in found.items()}
        )

    def _channel(self) -> str:
        if len(self.config.buses) != 1:
            raise ConfigError(
                "a log is replayed of one bus, and robot.yaml has several",
                where="sources.can: buses",
                measured=f"{len(self.config.buses)}: {', '.join(self.config.buses)}",
                next_step="leave one bus in robot.yaml, with the devices that are on it",
            )
        return next(iter(self.config.buses))

    def _files(self) -> list[Path]:
        if self.path.is_file():
            return [self.path]
        found = [(first_stamp(path), path.name, path) for path in sorted(self.path.glob("*.log"))]
        if not found:
            raise UsageError(
                "there are no logs of frames",
                where=str(self.path),
                next_step="give a log, or a session that was recorded from a bus",
            )
        return [path for _, _, path in sorted(found)]


class ReplaySource(LogSource):
    """A log of frames as source and commander.

    Parameters
    ----------
    log : CanLog
    seeker : PoseSeeker
        Over the same log.
    """

    def __init__(self, log: CanLog, seeker: PoseSeeker) -> None:
        super().__init__(seeker)
        self._log = log

    @property
    def name(self) -> str:
        """The log."""
        return f"frames of {self._log.path.name}"

    def status(self) -> SourceStatus:
        """Return what was lost in what has been read of the log so far."""
        stream = self._log.stream
        if stream is None:
            return SourceStatus()
        torn = {"torn lines": self._log.torn} if self._log.torn else {}
        noted = {name: count for name, count in self._log.noted.items() if count}
        return SourceStatus({}, {**stream.lost, **noted, **torn}, stream.notes)


def open_replay(request: SourceRequest) -> ReplaySource:
    """Open a log of frames, to be understood as ``sources.can`` of robot.yaml says.

    Parameters
    ----------
    request : SourceRequest
        ``argument``: a log, a session that was recorded from a bus, or its folder ``can``.
        ``options``: of ``sources.replay``: ``arrival``, ``stay``, ``order`` as of bags.

    Raises
    ------
    UsageError
        If there is no such log, or effects are asked for.
    ConfigError
        If ``sources.can`` is missing or wrong.
    """
    request.refuse_effects()
    path = Path(request.argument).expanduser()
    if not request.argument or not path.exists():
        raise UsageError(
            "no log is given" if not request.argument else "there is no such log",
            where=f"--source replay:{request.argument}",
            next_step="type --source replay:FILE, with a log of frames or a session folder",
        )
    if (path / FOLDER).is_dir():
        path = path / FOLDER
    robot = request.robot
    config = read_configuration(robot.sources.get("can", {}), robot)
    folder = path if path.is_dir() else path.parent
    log = CanLog(path, config, robot, devices_told(folder))
    seeker = PoseSeeker(log, robot.tree.joint_names, request.plan, _options(request.options or {}))
    return ReplaySource(log, seeker)


def _options(given: Mapping[str, object]) -> SeekOptions:
    known = {"arrival", "stay", "order"}
    unknown = sorted(set(given) - known)
    if unknown:
        raise ConfigError(
            f"sources.replay has no {unknown[0]!r}",
            next_step=f"it has: {', '.join(sorted(known))}",
        )
    default = SeekOptions()
    try:
        return SeekOptions(
            float(str(given.get("arrival", default.arrival))),
            float(str(given.get("stay", default.stay))),
            Order(given.get("order", default.order.value)),
        )
    except ValueError as error:
        raise ConfigError(
            f"sources.replay: {error}",
            next_step="arrival and stay are numbers, order is planned or any",
        ) from error
