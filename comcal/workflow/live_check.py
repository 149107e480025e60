# SPDX-License-Identifier: Apache-2.0
"""``comcal check --live``: does what the robot sends make sense, before a day is spent on it?"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from comcal.errors import DataError, UsageError
from comcal.measure.channel_check import Channel, State, channels_of
from comcal.measure.hanging import IMU_TOLERANCE
from comcal.measure.observe import Look, Observation, observe
from comcal.measure.plan import DOUBLE, NONE, PlannedPose
from comcal.measure.plan_csv import read_plan
from comcal.measure.plausibility import implausibilities
from comcal.measure.pose_row import join
from comcal.measure.reading import mean_of, reading_table
from comcal.measure.source import Block, Commander, CountingSource, SourceRequest, SourceStatus
from comcal.measure.still import StillCriterion
from comcal.measure.waiting import STEP, read_samples
from comcal.robot.description import load_robot
from comcal.robot.findings import Finding, Level
from comcal.robot.model import Robot
from comcal.workflow.sources import open_measuring, source_names


@dataclass(frozen=True)
class LiveOrder:
    """What to look at.

    Parameters
    ----------
    robot_yaml : Path
    source : str
        ``NAME`` or ``NAME:ARGUMENT``; empty: the one that robot.yaml describes.
    seconds : float
        How long [s].
    support : str
        What the robot stands on: ``double``, ``none`` or a foot.
    seed : int
        Of a simulated source.
    """

    robot_yaml: Path
    source: str = ""
    seconds: float = 5.0
    support: str = DOUBLE
    seed: int = 0


@dataclass(frozen=True)
class LiveCheck:
    """What was seen.

    Parameters
    ----------
    robot : Robot
    source, engine : str
        As asked for, and what it says of itself.
    seconds : float
        That were read [s].
    rate : float
        Of the samples [1/s].
    channels : tuple of Channel
    observation : Observation
        Load, CoP and motion at the end.
    findings : tuple of Finding
    status : SourceStatus or None
    """

    robot: Robot
    source: str
    engine: str
    seconds: float
    rate: float
    channels: tuple[Channel, ...]
    observation: Observation
    findings: tuple[Finding, ...]
    status: SourceStatus | None

    @property
    def is_usable(self) -> bool:
        """Whether a recording could be used."""
        return all(finding.level is not Level.ERROR for finding in self.findings)


def check_live(order: LiveOrder) -> LiveCheck:
    """Open a source, read for a while, and judge what it sends.

    Parameters
    ----------
    order : LiveOrder

    Raises
    ------
    UsageError
        If robot, source or support are not usable together.
    HardwareError
        If the source does not answer, or delivers nothing.
    MissingExtraError
        If a package that the source needs is not installed.
    """
    robot = load_robot(order.robot_yaml)
    if order.support not in (DOUBLE, NONE, *robot.feet):
        raise UsageError(
            f"the robot cannot stand on {order.support!r}",
            where="--support",
            next_step=f"supports of this robot: {', '.join((DOUBLE, NONE, *robot.feet))}",
        )
    support = order.support if robot.feet else NONE
    asked = order.source or _only_source(robot)
    name, _, argument = asked.partition(":")
    request = SourceRequest(robot, order.seed, argument=argument, options=robot.sources.get(name))
    with closing(open_measuring(name, request)) as source:
        pose = _pose(order, robot, support)
        if isinstance(source, Commander):
            source.move_to(pose)
        blocks = [read_samples(source, STEP)]
        start = float(blocks[0].t[0])
        while float(blocks[-1].t[-1]) - start < order.seconds - STEP / 2.0:
            blocks.append(read_samples(source, STEP))
        status = source.status() if isinstance(source, CountingSource) else None
        engine = source.name
    block = join(blocks)
    channels = channels_of(block, robot)
    seen = PlannedPose(0, mean_of(block.q), support)
    look = Look(seen, False, order.seconds, "", status)
    period = float(np.median(np.diff(block.t))) if block.t.size > 1 else np.nan
    return LiveCheck(
        robot=robot,
        source=asked,
        engine=engine,
        seconds=float(block.t[-1] - start),
        rate=1.0 / period if period > 0.0 else np.nan,
        channels=channels,
        observation=observe(look, block, robot, StillCriterion()),
        findings=tuple(_findings(channels, block, robot, support, status)),
        status=status,
    )


def _only_source(robot: Robot) -> str:
    """Return the source that robot.yaml describes.

    Raises
    ------
    UsageError
        If it describes none, or several.
    """
    if len(robot.sources) == 1:
        return next(iter(robot.sources))
    raise UsageError(
        "which source is to be read is not clear",
        where=str(robot.yaml_path or robot.name),
        measured=f"described are: {', '.join(robot.sources) or 'none'}",
        next_step=f"name it with --source; installed are: {', '.join(source_names())}",
    )


def _pose(order: LiveOrder, robot: Robot, support: str) -> PlannedPose:
    """Return where a simulated robot stands: the first such pose of the plan, or q = 0."""
    path = order.robot_yaml.parent / "plan.csv"
    names = robot.tree.joint_names
    plan = read_plan(path, names) if path.is_file() else ()
    for pose in plan:
        if pose.support == support:
            return pose
    return PlannedPose(0, np.zeros(len(names)), support)


def _findings(
    channels: tuple[Channel, ...],
    block: Block,
    robot: Robot,
    support: str,
    status: SourceStatus | None,
) -> Iterator[Finding]:
    yield from _of_channels(channels)
    yield from _of_losses(status)
    yield from _of_imu(block, robot)
    try:
        for error in implausibilities(reading_table(block, robot, support), robot):
            yield _as_finding(error)
    except DataError as error:
        yield _as_finding(error)


def _as_finding(error: DataError) -> Finding:
    return Finding(
        Level.ERROR, error.what, error.where, error.measured, error.limit, error.next_step
    )


ADVICE = {
    State.SILENT: (Level.ERROR, "sends nothing", "check cable, power, id and bus of this device"),
    State.FROZEN: (Level.ERROR, "always reads the same", "start the sensor, or look for its error"),
    State.GAPS: (Level.WARNING, "has gaps", "look at the losses and the load of the bus"),
    State.NOISY: (
        Level.WARNING,
        "is noisier than robot.yaml states",
        "hold the robot still, look for interference, or correct `noise` in robot.yaml",
    ),
}


def _of_channels(channels: tuple[Channel, ...]) -> Iterator[Finding]:
    """Yield one finding per device and state, however many of its channels have it."""
    groups: dict[tuple[str, State], list[Channel]] = {}
    for channel in channels:
        device = channel.name.rpartition(".")[0] if channel.name.count(".") > 1 else channel.name
        if channel.name.startswith("imu."):
            device = "imu"
        if channel.state is not State.OK:
            groups.setdefault((device, channel.state), []).append(channel)
    for (device, state), members in groups.items():
        level, what, advice = ADVICE[state]
        worst = max(members, key=lambda c: c.standard_error)
        measured = limit = ""
        if state is State.NOISY:
            measured = f"{worst.standard_error:.3g} {worst.unit} per pose ({worst.name})"
            limit = f"{worst.stated:.3g}"
        elif state is State.GAPS:
            measured = f"{100 * max(c.missing for c in members):.1f} % missing"
        elif state is State.FROZEN:
            measured = f"{len(members)} channels, {members[0].mean:.6g} {members[0].unit}"
        yield Finding(level, what, device, measured, limit, advice)


def _of_losses(status: SourceStatus | None) -> Iterator[Finding]:
    groups: dict[tuple[str, int], list[str]] = {}
    for key, count in (status.lost if status is not None else {}).items():
        name, _, kind = key.rpartition(" ")
        if count:
            groups.setdefault((kind if name else "", count), []).append(name or kind)
    for (kind, count), names in groups.items():
        more = f" and {len(names) - 1} more" if len(names) > 1 else ""
        yield Finding(
            Level.WARNING,
            "has lost samples",
            f"{names[0]}{more}",
            f"{count} {kind}".rstrip(),
            "",
            "look at cable, termination and load of the bus",
        )
    for note in status.notes if status is not None else ():
        yield Finding(Level.INFO, note)


def _of_imu(block: Block, robot: Robot) -> Iterator[Finding]:
    if block.imu is None or robot.imu_link is None:
        return
    size = float(np.linalg.norm(mean_of(block.imu)))
    if np.isfinite(size) and abs(size / robot.gravity - 1.0) > IMU_TOLERANCE:
        yield Finding(
            Level.WARNING,
            "does not read gravity",
            "imu",
            f"{size:.3g} m/s^2",
            f"{robot.gravity:.4g} m/s^2 +- {100 * IMU_TOLERANCE:.0f} %",
            "check its unit and range, and that the robot is still",
        )


def live_as_json(result: LiveCheck) -> dict[str, object]:
    """Return the result as plain data, for ``--json``; ``null`` where something is not known.

    Parameters
    ----------
    result : LiveCheck
    """
    seen = result.observation
    status = result.status
    return {
        "format": "comcal-live-check/1",
        "robot": result.robot.name,
        "source": result.source,
        "engine": result.engine,
        "verdict": "usable" if result.is_usable else "not_usable",
        "seconds": result.seconds,
        "rate": _known(result.rate),
        "channels": [
            {
                "channel": c.name,
                "unit": c.unit,
                "state": c.state.value,
                "mean": _known(c.mean),
                "sd": _known(c.sd),
                "standard_error": _known(c.standard_error),
                "stated": c.stated,
                "missing": c.missing,
            }
            for c in result.channels
        ],
        "force": _known(seen.force),
        "weight": _known(seen.weight),
        "cop_margin": None if seen.footprint is None else seen.footprint.margin,
        "rates": {} if status is None else dict(status.rates),
        "lost": None if status is None else dict(status.lost),
        "findings": [
            {
                "level": f.level.value,
                "what": f.what,
                "where": f.where,
                "measured": f.measured,
                "limit": f.limit,
                "next_step": f.next_step,
            }
            for f in result.findings
        ],
    }


def _known(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
