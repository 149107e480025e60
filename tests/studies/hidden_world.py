# SPDX-License-Identifier: Apache-2.0
"""Readings of a robot that hides something, through the same worlds as ``comcal record``."""

from __future__ import annotations

import csv
import io
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from hidden_scenario import Stage

from comcal.errors import NotBalancedError
from comcal.measure.csv_file import format_cell
from comcal.measure.plan import PlannedPose
from comcal.measure.pose_row import approaches, pose_row
from comcal.measure.poses_csv import read_poses
from comcal.measure.source import Block, SourceRequest
from comcal.measure.table import PoseTable
from comcal.robot.changes import Change
from comcal.robot.changes_text import change_text
from comcal.robot.model import Robot, Sense
from comcal.workflow.sources import open_source

BUILTIN = "builtin"
RATE = 120.0
"""Samples per second of simulated sources."""
NOTHING = Change("ground_tilt", "", {"roll": 0.0})
"""Hides nothing, and makes the source measure temperatures as it does otherwise."""

Reading = tuple[PlannedPose, Block]


def record(
    stage: Stage,
    changes: Sequence[Change],
    *,
    engine: str = BUILTIN,
    seed: int = 0,
    noise: bool = True,
    samples: int = 1,
) -> list[Reading]:
    """Let a robot stand in every pose and return its samples.

    Poses in which it falls over are left out.
    """
    request = SourceRequest(
        robot=stage.robot,
        seed=seed,
        effects=tuple(change_text(change) for change in changes or (NOTHING,)),
        noise=noise,
        options=stage.options,
        plan=stage.poses,
    )
    found = list[Reading]()
    with open_source(engine, request) as source:
        for pose in stage.poses:
            try:
                source.move_to(pose)
            except NotBalancedError:
                continue
            found.append((pose, source.read(samples / RATE)))
    return found


def table_of(stage: Stage, readings: Sequence[Reading]) -> PoseTable:
    """Return what ``comcal`` reads of a recording: poses.csv written and read back."""
    robot, names = stage.robot, stage.robot.tree.joint_names
    before = dict(zip([p.pose for p in stage.poses], (None, *stage.poses[:-1]), strict=True))
    rows = [
        pose_row(pose, block, robot, approaches(pose, before[pose.pose], names), with_floor=False)
        for pose, block in readings
    ]
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(rows[0])
    writer.writerows([[format_cell(cell) for cell in row.values()] for row in rows])
    with tempfile.TemporaryDirectory() as scratch:
        path = Path(scratch) / "poses.csv"
        path.write_text(text.getvalue(), "utf-8")
        return read_poses(path, robot)


def hidden_table(
    stage: Stage, changes: Sequence[Change], samples: int, *, engine: str, seed: int
) -> PoseTable:
    """Record with noise and return the pose table."""
    return table_of(stage, record(stage, changes, engine=engine, seed=seed, samples=samples))


def with_readings(robot: Robot, table: PoseTable, readings: Sequence[Reading]) -> PoseTable:
    """Return *table* with other readings of the same poses: the last sample of each."""
    blocks = [block for _, block in readings]
    signs = {s.name: 1.0 if s.sense is Sense.ON_ROBOT else -1.0 for s in robot.sensors.values()}

    def last(name: str, missing: np.ndarray) -> np.ndarray:
        values = [getattr(block, name) for block in blocks]
        return missing if any(v is None for v in values) else np.array([v[-1] for v in values])

    return replace(
        table,
        q=last("q", table.q),
        wrench={
            s: sign * np.array([block.wrenches[s][-1] for block in blocks])
            for s, sign in signs.items()
        },
        current=last("currents", table.current),
        torque=last("torques", table.torque),
        imu=last("imu", table.imu),
    )


def without_currents(table: PoseTable) -> PoseTable:
    """Return *table* as it would be without current sensors."""
    nothing = np.full_like(table.current, np.nan)
    return replace(table, current=nothing, current_var=nothing)
