# SPDX-License-Identifier: Apache-2.0
"""One scenario: record over a bus on which something goes wrong, going on until all is recorded."""

from __future__ import annotations

import contextlib
import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any
from unittest import mock

from bus_fault_draw import FULL_DISK, KILL, OUTAGES, Scenario
from bus_fault_paths import emulated, stepping_clock, truths, write_faulty_log
from bus_fault_robot import SmallRobot

import comcal_drivers.bus.slcan
import comcal_drivers.commanders.emulated
from comcal.errors import ComcalError
from comcal.measure.pose_row import join
from comcal.measure.progress import (
    OnEvent,
    PoseFinished,
    PoseObserved,
    PoseRetried,
    PoseSkipped,
    PoseStarted,
)
from comcal.measure.raw import RawWriter
from comcal.measure.source import Block, SourceStatus
from comcal.measure.still import StillCriterion
from comcal.workflow.commanders import CommanderOrder
from comcal.workflow.record import RecordOrder, record_session
from comcal_drivers.source.live import CanSource

CRITERION = StillCriterion(settle=0.3, timeout=1.5, cop_sd=4e-3, drift=4e-3)
MOVE_PATIENCE = 3.0
"""How long the commander waits for the robot [s], instead of 20."""
RUNS = 5
"""Times that the same command is given until every pose is recorded."""
PAUSE = 0.3
"""Before it is given again [s]: all of them together outlast any outage."""
SLACK = 6.0
"""On top of the longest time-out that may have to pass, on a busy machine [s]."""
LONGEST = 120.0
"""Of a whole scenario [s]; then it counts as hanging."""
CHILD = Path(__file__).with_name("bus_fault_child.py")


class HangError(Exception):
    """It takes longer than anything may take."""


@dataclass
class Watched:
    """What was seen while a scenario ran.

    Parameters
    ----------
    folder : Path
        Where everything of it lies.
    status : mapping from name to int
        Largest counts that were reported.
    notes : set of str
    errors : list of str
        With which runs ended early.
    crashes : list of str
        Errors that are none of comcal's.
    blocks : mapping from pose to list of Block
        What was written as raw samples of its last attempt.
    rows : list of list of str
        Lines of poses.csv after every run.
    finished : set of int
        Poses that were reported as finished.
    """

    folder: Path
    status: dict[str, int] = field(default_factory=dict[str, int])
    notes: set[str] = field(default_factory=set[str])
    errors: list[str] = field(default_factory=list[str])
    crashes: list[str] = field(default_factory=list[str])
    blocks: dict[int, list[Block]] = field(default_factory=dict[int, list[Block]])
    rows: list[list[str]] = field(default_factory=list[list[str]])
    finished: set[int] = field(default_factory=set[int])
    samples_of: dict[int, int] = field(default_factory=dict[int, int])
    """Samples of the still window, by pose."""
    retried: int = 0
    skipped: int = 0
    runs: int = 0
    quiet: float = 0.0
    """Longest time without any sign of life [s]."""
    has_hung: bool = False
    was_struck: bool = False
    """The kill or the full disk came while it was recording."""
    _last: float = 0.0

    @property
    def session(self) -> Path:
        return self.folder / "session"

    @property
    def truth(self) -> list[dict[str, Any]]:
        return truths(self.folder / "truth.jsonl")

    @property
    def logs(self) -> list[Path]:
        """Frames that the reader got, in the order in which they were written."""
        given = self.folder / "faulty.log"
        if given.exists():
            return [given]
        return sorted(self.session.glob("can/*.log"), key=lambda path: path.stat().st_mtime_ns)

    def begin(self) -> None:
        """A run begins."""
        self.runs += 1
        self._last = time.monotonic()

    def breathe(self) -> None:
        """There is a sign of life."""
        now = time.monotonic()
        self.quiet = max(self.quiet, now - self._last)
        self._last = now

    def see(self, event: object) -> None:
        """Take note of an event of the recording."""
        self.breathe()
        if isinstance(event, PoseStarted):
            self.blocks.pop(event.pose, None)
        elif isinstance(event, PoseFinished):
            self.finished.add(event.pose)
            self.samples_of[event.pose] = event.samples
        elif isinstance(event, PoseRetried):
            self.retried += 1
        elif isinstance(event, PoseSkipped):
            self.skipped += 1
        elif isinstance(event, PoseObserved) and event.observation.status is not None:
            self.see_status(event.observation.status)

    def see_status(self, status: SourceStatus) -> None:
        """Take note of counts."""
        self.notes |= set(status.notes)
        for name, count in status.lost.items():
            self.status[name] = max(count, self.status.get(name, 0))

    def end(self) -> None:
        """A run is over."""
        self.breathe()
        table = self.session / "poses.csv"
        text = table.read_text("utf-8") if table.exists() else ""
        self.rows.append(text.splitlines())

    def samples(self, pose: int) -> Block | None:
        """Return the raw samples of a pose."""
        blocks = self.blocks.get(pose)
        return join(blocks) if blocks else None


def run_scenario(scenario: Scenario, robot: SmallRobot, folder: Path) -> Watched:
    """Record with what goes wrong in *scenario*, and go on until every pose is there.

    Parameters
    ----------
    scenario : Scenario
    robot : SmallRobot
    folder : Path
        Empty.
    """
    watched = Watched(folder)
    with contextlib.ExitStack() as stack:
        try:
            stack.enter_context(_alarm(LONGEST))
            stack.enter_context(_spies(watched))
            if scenario.kind == KILL:
                _run_killed(scenario, robot, watched)
            else:
                _run(scenario, robot, watched)
        except HangError:
            watched.has_hung = True
    return watched


def patience(scenario: Scenario) -> float:
    """Return how long a recording may give no sign of life [s]."""
    outage = 1.2 if scenario.kind in OUTAGES else 0.0
    # A source waits 3 s for samples; closing it and its threads takes time, too.
    return 3.0 + MOVE_PATIENCE + outage + SLACK


def _run(scenario: Scenario, robot: SmallRobot, watched: Watched) -> None:
    with _source(scenario, robot, watched.folder) as (yaml, source), contextlib.ExitStack() as jump:
        if scenario.kind == "clock_step" and scenario.number:
            begun = watched.session / "can" / f"pose_{1 + scenario.seed % 2:03d}.log"
            jump.enter_context(
                stepping_clock(comcal_drivers.bus.slcan, scenario.number, begun.exists)
            )
        for n in range(RUNS):
            limit = int(scenario.number) if scenario.kind == FULL_DISK and n == 0 else None
            with _disk_of(limit):
                _record(robot, yaml, source, watched)
            if len(watched.finished) == len(robot.plan):
                break
            time.sleep(PAUSE)


@contextlib.contextmanager
def _source(scenario: Scenario, robot: SmallRobot, folder: Path) -> Generator[tuple[Path, str]]:
    """Yield the description of the robot and the name of the source."""
    truth = folder / "truth.jsonl"
    if scenario.path == "replay":
        log = folder / "faulty.log"
        write_faulty_log(robot, scenario, log, truth)
        yield robot.yaml, f"replay:{log}"
        return
    with emulated(robot, scenario.path, scenario, truth) as connection:
        yield robot.at(connection, f"robot_{folder.name}.yaml"), "can"


def _record(robot: SmallRobot, yaml: Path, source: str, watched: Watched) -> None:
    watched.begin()
    commander = CommanderOrder("emulated", consent=_agree) if source == "can" else CommanderOrder()
    order = RecordOrder(
        yaml,
        watched.session,
        source,
        plan=robot.plan_path,
        criterion=CRITERION,
        timeout=CRITERION.timeout,
        commander=commander,
    )
    try:
        outcome = record_session(order, _listener(watched))
        if outcome.summary.status is not None:
            watched.see_status(outcome.summary.status)
    except (ComcalError, OSError) as error:
        watched.errors.append(str(error).replace(str(watched.folder), ""))
    except HangError:
        raise
    except Exception as error:  # noqa: BLE001 - counted as a failure of its own
        watched.crashes.append(repr(error))
    watched.end()


def _agree(text: str) -> bool:
    return bool(text)


def _listener(watched: Watched) -> OnEvent:
    def see(event: object) -> None:
        watched.see(event)

    return see


@contextlib.contextmanager
def _disk_of(size: int | None) -> Generator[None]:
    """Let no file grow beyond so many bytes, as on a disk that is full."""
    if size is None:
        yield
        return
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    before = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        signal.signal(signal.SIGXFSZ, before)


@contextlib.contextmanager
def _alarm(seconds: float) -> Generator[None]:
    """Interrupt what takes longer than anything may take."""

    def ring(number: int, frame: FrameType | None) -> None:
        del number, frame
        raise HangError

    before = signal.signal(signal.SIGALRM, ring)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


@contextlib.contextmanager
def _spies(watched: Watched) -> Generator[None]:
    """Look over the shoulder of what writes raw samples; shorten the commander's patience.

    What a source was still to count when it was closed is counted: its log has those frames, too.
    """
    write: Callable[[RawWriter, Block], None] = RawWriter.write
    begin: Callable[..., None] = RawWriter.__init__

    def init(self: RawWriter, path: Path, robot: Any) -> None:
        begin(self, path, robot)
        watched.blocks.pop(_number(path), None)
        paths[id(self)] = _number(path)

    def spy(self: RawWriter, block: Block) -> None:
        write(self, block)
        watched.blocks.setdefault(paths[id(self)], []).append(block)

    def close(self: CanSource) -> None:
        # Of a source that was never opened, or whose bus is gone, there is nothing more to count.
        with contextlib.suppress(ComcalError, AttributeError, TypeError, OSError):
            self.drop_earlier()
            watched.see_status(self.status())
        shut(self)

    paths: dict[int, int] = {}
    shut: Callable[[CanSource], None] = CanSource.close
    with (
        mock.patch.object(CanSource, "close", close),
        mock.patch.object(RawWriter, "__init__", init),
        mock.patch.object(RawWriter, "write", spy),
        mock.patch.object(comcal_drivers.commanders.emulated, "PATIENCE", MOVE_PATIENCE),
    ):
        yield


def _number(path: Path) -> int:
    return int(path.stem.partition("_")[2])


# --- kill -9 -------------------------------------------------------------------------------------


def _run_killed(scenario: Scenario, robot: SmallRobot, watched: Watched) -> None:
    """Kill the recording program at a random moment, then let it go on."""
    with contextlib.ExitStack() as stack:
        if scenario.path == "virtual":
            # Robot and reader share a process, and die together.
            yaml, source = robot.yaml, "virtual"
        else:
            yaml, source = stack.enter_context(_source(scenario, robot, watched.folder))
        command = [sys.executable, str(CHILD), str(yaml), str(robot.plan_path)]
        command += [str(watched.session), source, str(int(not scenario.asked))]
        watched.was_struck = _kill(command, watched, scenario.number)
        watched.end()
        environment = {**os.environ, "OMP_NUM_THREADS": "1"}
        for _ in range(RUNS):
            watched.begin()
            try:
                done = subprocess.run(
                    command, env=environment, capture_output=True, text=True, timeout=60.0
                )
            except subprocess.TimeoutExpired:
                watched.has_hung = True
                return
            watched.end()
            told = done.stdout + done.stderr
            # A pose that did not come to rest in time is named, and the same command tries again.
            if done.returncode == 0 and "left out" not in told:
                break
            watched.errors.append(told[-300:])


def _kill(command: list[str], watched: Watched, share: float) -> bool:
    """Return whether it was killed while it was recording."""
    environment: Mapping[str, str] = {**os.environ, "OMP_NUM_THREADS": "1"}
    watched.begin()
    with subprocess.Popen(
        command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    ) as child:
        ends = time.monotonic() + 30.0
        while not watched.session.exists() and child.poll() is None and time.monotonic() < ends:
            time.sleep(0.002)
        # Poses take about half a second each; some die while they open the bus or write a row.
        time.sleep(share * KILL_SPAN)
        child.kill()
        child.wait(10.0)
        return child.returncode == -signal.SIGKILL and watched.session.exists()


KILL_SPAN = 2.0
"""Seconds after the session was made within which the program is killed."""
