# SPDX-License-Identifier: Apache-2.0
"""What a scenario has come to: did the fault reach the reader; what was accepted, what lost?"""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise

import numpy as np
from bus_fault_draw import FULL_DISK, KILL, OUTAGES, Scenario
from bus_fault_robot import PERIOD, Array, SmallRobot, said
from bus_fault_run import Watched, patience

from comcal.measure.pose_row import cut
from comcal.measure.source import Block
from comcal_drivers.bus.error_frames import bus_off_rows, is_gap
from comcal_drivers.devices.tables import bus_table
from comcal_drivers.emulator.robot import ARRIVED, STATE_ID
from comcal_drivers.frames.batch import ERROR, FrameBatch
from comcal_drivers.frames.batches import concatenate, take
from comcal_drivers.frames.logs import read_log

SINGLE = ("maxon_epos",)
"""Devices that send one frame a sample and count nothing: what is lost of them nothing tells."""
HOST_TIME = 1e8
"""Stamps beyond this are seconds since 1970."""
KNOWN_GAP = 0.12
"""A device that is silent for longer than its time-out of 0.1 s is missed [s]."""


@dataclass(frozen=True)
class Judgement:
    """What became of one scenario.

    Parameters
    ----------
    reached : bool
        The fault is in the frames that the reader got, or its error was told.
    wrong, lost, uncounted, hung : int
        Poses accepted with a sample that never was; finished poses that are gone or never came;
        losses that nobody was told of; time-outs exceeded.
    details : tuple of str
        What exactly, for each of these.
    """

    reached: bool
    wrong: int
    lost: int
    uncounted: int
    hung: int
    refused: int
    retried: int
    quiet: float
    details: tuple[str, ...] = ()

    @property
    def is_bad(self) -> bool:
        """Whether something happened that must not."""
        return bool(self.wrong or self.lost or self.uncounted or self.hung)

    def as_record(self) -> dict[str, object]:
        """Return it as JSON takes it."""
        return asdict(self)


@dataclass(frozen=True)
class Segment:
    """What the reader got while the robot stood in one pose."""

    pose: int
    batch: FrameBatch


def judge(scenario: Scenario, robot: SmallRobot, watched: Watched) -> Judgement:
    """Judge a scenario that is over."""
    segments = list(_segments(watched))
    details = list[str]()
    wrong = _wrong(robot, watched, details, scenario)
    lost = _lost(scenario, robot, watched, details)
    uncounted = 0
    if scenario.kind not in (FULL_DISK, KILL):
        uncounted = _uncounted(scenario, robot, watched, segments, details)
    is_slow = watched.quiet > patience(scenario) and not _killed(scenario)
    hung = int(watched.has_hung or is_slow)
    if hung:
        details.append(f"quiet for {watched.quiet:.1f} s")
    details += [f"crash: {crash}" for crash in watched.crashes]
    return Judgement(
        _reached(scenario, robot, watched, segments),
        wrong,
        lost,
        uncounted + len(watched.crashes),
        hung,
        len(watched.errors) + watched.skipped,
        watched.retried,
        round(watched.quiet, 2),
        tuple(details),
    )


def _killed(scenario: Scenario) -> bool:
    return scenario.kind == KILL


# --- did it reach the reader? --------------------------------------------------------------------


def _logged(watched: Watched) -> FrameBatch:
    """Return all frames that the reader got."""
    return concatenate([batch for path in watched.logs for batch in read_log(path)])


def _segments(watched: Watched) -> Sequence[Segment]:
    """Cut what the reader got at the robot's answers that it stands in a pose."""
    batch = _logged(watched)
    is_data = batch.kinds & ERROR == 0
    arrived = np.flatnonzero(
        (batch.ids == STATE_ID) & is_data & (batch.lengths >= 3) & (batch.data[:, 2] == ARRIVED)
    )
    edges = [*arrived.tolist(), len(batch)]
    return [
        Segment(
            int(batch.data[begin, 0]) | int(batch.data[begin, 1]) << 8,
            take(batch, np.arange(begin + 1, end)),
        )
        for begin, end in pairwise(edges)
    ]


def _reached(
    scenario: Scenario, robot: SmallRobot, watched: Watched, segments: Sequence[Segment]
) -> bool:
    if scenario.kind == FULL_DISK:
        return any("large" in error or "space" in error for error in watched.errors)
    if _killed(scenario):
        return watched.was_struck
    if scenario.kind in ("counter_jump", "counter_wrap"):
        return bool(_count_jumps(robot, segments, scenario.device))
    if scenario.kind == "clock_step":
        by = scenario.number or float(watched.truth[0]["by"]) if watched.truth else scenario.number
        return any(_has_step(segment.batch.t, by) for segment in segments)
    if scenario.kind in ("disconnect", "bus_off") and any(
        is_gap(segment.batch).any() or bus_off_rows(segment.batch).any() for segment in segments
    ):
        return True
    return any(_is_other(robot, segment) for segment in segments)


def _is_other(robot: SmallRobot, segment: Segment) -> bool:
    """Whether something else came than the robot says in this pose, as far as it came."""
    polled = not robot.asked
    came = said(segment.batch, robot.config, polled=polled)
    truth = robot.truth[segment.pose].said if polled else robot.unpolled[segment.pose]
    return tuple(came) != truth[: len(came)]


def _count_jumps(robot: SmallRobot, segments: Sequence[Segment], device: str) -> Sequence[int]:
    """Return what else than one a counter grew by, over all poses; 0 where it went round."""
    counts = np.concatenate([np.empty(0, int), *(_counts(robot, s, device) for s in segments)])
    steps = (np.diff(counts) % 65536).tolist()
    goes_round = [0 for a, b in pairwise(counts.tolist()) if (a, b) == (65535, 0)]
    return [*goes_round, *(step for step in steps if step not in (0, 1))]


def _counts(robot: SmallRobot, segment: Segment, device: str) -> Array:
    """Return what the first halves of a counting sensor count, in order."""
    config = robot.config.sensors[device].device
    number = bus_table(config).id_of(config.description.parts[0])
    rows = np.flatnonzero((segment.batch.ids == number) & (segment.batch.lengths == 8))
    return segment.batch.data[rows, 6:8].copy().view("<u2")[:, 0].astype(int)


def _has_step(t: Array, by: float) -> bool:
    """Whether stamps jump by that much; the reader's own frames bear the host's time."""
    of_the_host = t > HOST_TIME
    mine = t[of_the_host] if of_the_host.all() else t[~of_the_host]
    near = np.abs(np.diff(mine) - by) < max(3 * PERIOD, 0.2 * abs(by))
    return bool(near.any()) and abs(by) > 3 * PERIOD


# --- was anything wrong accepted? ----------------------------------------------------------------


def _wrong(robot: SmallRobot, watched: Watched, details: list[str], scenario: Scenario) -> int:
    """Return the number of accepted poses that hold what the robot never measured in them."""
    if not watched.rows or not watched.rows[-1]:
        return 0
    wrong = 0
    for row in csv.DictReader(io.StringIO("\n".join(watched.rows[-1]))):
        pose = int(row["pose"])
        problems = _row_problems(robot, pose, row)
        block = watched.samples(pose)
        if block is not None and scenario.kind != KILL:
            problems += _sample_problems(robot, pose, _window(block, row, watched))
        wrong += bool(problems)
        details += [f"pose {pose}: {problem}" for problem in problems]
    return wrong


def _window(block: Block, row: Mapping[str, str], watched: Watched) -> Block:
    """Return the samples of which the row is the mean."""
    n = watched.samples_of.get(int(row["pose"]), 0)
    middle = float(row["t"])
    if not n or block.t.size < n:
        return cut(block, slice(0, 0))
    sums = np.concatenate([[0.0], np.cumsum(block.t - middle)])
    begin = int(np.argmin(np.abs(sums[n:] - sums[:-n])))
    return cut(block, slice(begin, begin + n))


def _row_problems(robot: SmallRobot, pose: int, row: Mapping[str, str]) -> list[str]:
    """Compare means with what all samples of the pose lie between."""
    truth, found = robot.truth[pose], list[str]()
    joints = robot.robot.tree.joint_names
    for name, wrench in truth.wrenches.items():
        cells = [row[f"ft.{name}.{axis}"] for axis in ("fx", "fy", "fz", "tx", "ty", "tz")]
        found += _outside(f"ft.{name}", cells, wrench)
    found += _outside("q", [row[f"q.{joint}"] for joint in joints], truth.q)
    found += _outside("i", [row[f"i.{joint}"] for joint in joints], truth.currents)
    return found


def _outside(what: str, cells: Sequence[str], truth: Array) -> list[str]:
    if "" in cells:
        return [f"{what} has empty cells"]
    mean = np.array([float(cell) for cell in cells])
    # Of 25 samples and more with white errors; the host may ask four times for the same one.
    allowed = 6.0 * truth.std(axis=0) / 2.5 + 1e-9
    off = np.abs(mean - truth.mean(axis=0))
    return [f"the mean of {what} is off by {off.max():.3g}"] if (off > allowed).any() else []


def _sample_problems(robot: SmallRobot, pose: int, window: Block) -> list[str]:
    """Say which samples of a window were never measured in this pose."""
    truth, found = robot.truth[pose], list[str]()
    for name, wrench in window.wrenches.items():
        strange = _strangers(wrench, truth.wrenches[name])
        if strange:
            found.append(f"{strange} of {len(wrench)} samples of {name} never were")
    currents = window.currents if window.currents is not None else window.q * np.nan
    for k, joint in enumerate(robot.robot.tree.joint_names):
        pairs = np.column_stack([window.q[:, k], currents[:, k]])
        strange = _strangers(pairs, np.column_stack([truth.q[:, k], truth.currents[:, k]]))
        if strange:
            found.append(f"{strange} of {len(pairs)} samples of {joint} never were")
    return found


def _strangers(values: Array, truth: Array) -> int:
    known = {(row + 0.0).tobytes() for row in truth}
    return sum((row + 0.0).tobytes() not in known for row in values)


# --- was anything lost? --------------------------------------------------------------------------


def _lost(scenario: Scenario, robot: SmallRobot, watched: Watched, details: list[str]) -> int:
    """Return how many finished poses are gone, and how many never came at last."""
    final = watched.rows[-1] if watched.rows else []
    lost = 0
    for earlier in watched.rows:
        # A line that a kill tore was no finished pose: it is cut off when the recording goes on.
        whole = earlier[:-1] if _killed(scenario) else earlier
        if final[: len(whole)] != whole:
            lost += 1
            details.append("finished rows changed")
    there = {int(line.partition(",")[0]) for line in final[1:] if line}
    gone = watched.finished - there
    missing = {pose.pose for pose in robot.plan} - there - gone
    if scenario.path == "replay" and scenario.kind not in (FULL_DISK, KILL):
        missing = set[int]() if watched.skipped or watched.errors else missing
    details += [f"finished pose {pose} is gone" for pose in sorted(gone)]
    details += [f"pose {pose} was never recorded" for pose in sorted(missing)]
    return lost + len(gone) + len(missing)


# --- was every loss told? ------------------------------------------------------------------------


def _uncounted(
    scenario: Scenario,
    robot: SmallRobot,
    watched: Watched,
    segments: Sequence[Segment],
    details: list[str],
) -> int:
    """Return how many losses were not told, as far as they can be known."""
    if not _reached(scenario, robot, watched, segments):
        return 0
    told = {name: count for name, count in watched.status.items() if count}
    found = list[str]()
    device = scenario.device
    of_it = [name for name in told if name.startswith(f"{device} ")]
    noted = [note for note in watched.notes if device and device in note]
    provable = bool(device) and scenario.device_kind not in SINGLE
    duration = max((float(str(n.get("duration", 0))) for n in watched.truth), default=0.0)
    if scenario.kind in ("drop", "dlc") and provable and not of_it:
        found.append("nothing told of lost frames")
    elif scenario.kind in ("saturate", "status") and not (of_it or noted):
        found.append("nothing told of what the device said")
    elif scenario.kind in ("counter_jump", "counter_wrap") and not of_it:
        found.append("nothing told of the counter")
    elif (
        scenario.kind in OUTAGES
        and min(duration, _longest_pause(robot, segments, device)) > KNOWN_GAP
        and not (of_it if device else told or watched.errors)
    ):
        found.append(f"nothing told of {duration:g} s of {scenario.kind}")
    if watched.runs == 1:
        found += _miscounted(scenario, robot, _logged(watched), told)
    details += found
    return len(found)


def _longest_pause(robot: SmallRobot, segments: Sequence[Segment], device: str) -> float:
    """Return the longest time without a frame of a device, or of any, by the stamps in the log [s].

    A robot that talks faster than a real one is silent for less than its own time says.
    """
    longest = 0.0
    for segment in segments:
        t, mine = segment.batch.t, np.ones(len(segment.batch), np.bool_)
        if device:
            (config,) = (d.device for d in robot.config.every_device if d.name == device)
            table = bus_table(config)
            ids = [table.id_of(part) for part in config.description.parts]
            mine = np.isin(segment.batch.ids, ids)
        stamps = t[mine | (np.arange(len(t)) == len(t) - 1)]
        longest = max(longest, float(np.diff(stamps).max(initial=0.0)))
    return longest


def _miscounted(
    scenario: Scenario, robot: SmallRobot, batch: FrameBatch, told: Mapping[str, int]
) -> list[str]:
    """Compare the lost samples of counting sensors with the numbers missing in the frames."""
    if scenario.kind in ("counter_jump", "counter_wrap"):
        return []
    found = list[str]()
    for name, config in robot.config.sensors.items():
        if config.device.description.name != "jr3_uc3m":
            continue
        wanted = _missing_numbers(robot, batch, name)
        if told.get(f"{name} lost", 0) != wanted:
            found.append(f"{told.get(f'{name} lost', 0)} samples of {name} lost, truly {wanted}")
    return found


def _missing_numbers(robot: SmallRobot, batch: FrameBatch, device: str) -> int:
    """Return how many numbers between the first and the last are not there with both halves."""
    config = robot.config.sensors[device].device
    table = bus_table(config)
    halves = list[set[int]]()
    for part in config.description.parts:
        number = table.id_of(part)
        rows = np.flatnonzero((batch.ids == number) & (batch.lengths == 8))
        came = set(batch.data[rows, 6:8].copy().view("<u2")[:, 0].tolist())
        halves.append(came)
    whole = set.intersection(*halves)
    return max(whole) - min(whole) + 1 - len(whole) if whole else 0
