# SPDX-License-Identifier: Apache-2.0
"""Reading and writing ``plan.csv``, the list of poses a robot is to be driven to.

Columns: ``pose, configuration, tilt, support, revisit, floor.roll, floor.pitch,
approach.<joint>..., q.<joint>...``; ``pose`` and every ``q`` are required. Since a plan moves a
robot, a column that is not understood is refused, unlike in ``poses.csv``.
"""

from __future__ import annotations

from collections.abc import Sequence
from difflib import get_close_matches
from pathlib import Path

import numpy as np

from comcal.errors import ConfigError, MissingColumnError, NotFiniteError
from comcal.measure.csv_file import CsvFile, Row, read_csv, write_csv
from comcal.measure.plan import DOUBLE, PlannedPose

PLAIN_COLUMNS = (
    *("pose", "configuration", "tilt", "support", "revisit"),
    *("floor.roll", "floor.pitch"),
)
DIRECTIONS = (-1, 0, 1)


def read_plan(path: Path | str, joint_names: Sequence[str]) -> tuple[PlannedPose, ...]:
    """Read the planned poses of a file, in its order.

    Parameters
    ----------
    path : Path or str
    joint_names : sequence of str
        ``tree.joint_names``: the joints a plan must give, in the order of ``PlannedPose.q``.

    Raises
    ------
    MissingColumnError
        If ``pose`` or the column of a joint is absent.
    NotFiniteError
        If a cell that is needed is empty, NaN or infinite.
    ConfigError
        If the file is not such a table, a column is unknown, or a pose id stands twice.
    """
    file = read_csv(path, error=ConfigError)
    columns = {name: i for i, name in enumerate(file.header)}
    allowed = [*PLAIN_COLUMNS, *(f"{f}.{j}" for f in ("q", "approach") for j in joint_names)]
    for name in columns:
        if name not in allowed:
            near = get_close_matches(name, allowed, n=1)
            raise ConfigError(
                f"column {name} is not a column of plan.csv",
                where=f"{file.path.name}",
                next_step=f"did you mean {near[0]}?" if near else "delete it",
            )
    for name in ("pose", *(f"q.{joint}" for joint in joint_names)):
        if name not in columns:
            raise MissingColumnError(
                f"column {name} is absent",
                where=f"{file.path.name}",
                next_step="a plan gives the position of every independent joint",
            )
    poses: dict[int, PlannedPose] = {}
    for row in file.rows:
        planned = _planned_pose(file, row, columns, joint_names)
        if planned.pose in poses:
            raise ConfigError(
                f"pose {planned.pose} stands in the plan twice",
                where=file.where(row),
                next_step="give every row its own number",
            )
        poses[planned.pose] = planned
    return tuple(poses.values())


def _planned_pose(
    file: CsvFile, row: Row, columns: dict[str, int], joint_names: Sequence[str]
) -> PlannedPose:
    def text(name: str) -> str:
        return row.cells[columns[name]] if name in columns else ""

    def number(name: str) -> float | None:
        return file.number(row, columns[name]) if name in columns else None

    approach: dict[str, int] = {}
    for joint in joint_names:
        if text(f"approach.{joint}"):
            direction = file.integer(row, columns[f"approach.{joint}"])
            if direction not in DIRECTIONS:
                raise ConfigError(
                    f"approach.{joint} is {direction}",
                    where=file.where(row),
                    next_step="write 1 (q increasing), -1 (decreasing), 0 or nothing",
                )
            approach[joint] = direction
    q = np.empty(len(joint_names))
    for k, joint in enumerate(joint_names):
        value = number(f"q.{joint}")
        if value is None:
            raise NotFiniteError(
                f"column q.{joint} is empty",
                where=file.where(row),
                next_step="give the position of every joint in rad (or m)",
            )
        q[k] = value
    return PlannedPose(
        pose=file.integer(row, columns["pose"]),
        q=q,
        support=text("support") or DOUBLE,
        configuration=text("configuration"),
        tilt=number("tilt"),
        approach=approach,
        floor_roll=number("floor.roll") or 0.0,
        floor_pitch=number("floor.pitch") or 0.0,
        revisit=text("revisit"),
    )


def write_plan(path: Path | str, poses: Sequence[PlannedPose], joint_names: Sequence[str]) -> None:
    """Write *poses* so that :func:`read_plan` gives them back exactly.

    Columns that no pose uses (configuration, tilt, revisit, floor, approach) are left out.

    Parameters
    ----------
    path : Path or str
        A file that does not exist yet.
    poses : sequence of PlannedPose
    joint_names : sequence of str
        ``tree.joint_names``.

    Raises
    ------
    ConfigError
        If the file exists, there is no pose, an id stands twice, or a number is not finite.
    """
    _check_writable(Path(path), poses, joint_names)
    moved = [j for j in joint_names if any(j in pose.approach for pose in poses)]
    used = {
        "pose": True,
        "configuration": any(pose.configuration for pose in poses),
        "tilt": any(pose.tilt is not None for pose in poses),
        "support": True,
        "revisit": any(pose.revisit for pose in poses),
        "floor.roll": any(pose.floor_roll for pose in poses),
        "floor.pitch": any(pose.floor_pitch for pose in poses),
    }
    header = [name for name in PLAIN_COLUMNS if used[name]]
    header += [f"approach.{joint}" for joint in moved] + [f"q.{joint}" for joint in joint_names]
    rows: list[list[object]] = []
    for pose in poses:
        cells: dict[str, object] = {
            "pose": pose.pose,
            "configuration": pose.configuration,
            "tilt": pose.tilt,
            "support": pose.support,
            "revisit": pose.revisit,
            "floor.roll": pose.floor_roll,
            "floor.pitch": pose.floor_pitch,
        }
        cells |= {f"approach.{joint}": pose.approach.get(joint) for joint in moved}
        cells |= {f"q.{joint}": float(x) for joint, x in zip(joint_names, pose.q, strict=True)}
        rows.append([cells[name] for name in header])
    write_csv(path, header, rows)


def _check_writable(path: Path, poses: Sequence[PlannedPose], joint_names: Sequence[str]) -> None:
    ids = [pose.pose for pose in poses]
    twice = sorted({i for i in ids if ids.count(i) > 1})
    if not poses or twice:
        raise ConfigError(
            f"pose {twice[0]} stands in the plan twice" if twice else "the plan has no poses",
            where=str(path),
            next_step="give every pose its own number",
        )
    for pose in poses:
        numbers = [*pose.q, pose.tilt or 0.0, pose.floor_roll, pose.floor_pitch]
        if len(pose.q) != len(joint_names) or not np.all(np.isfinite(numbers)):
            raise ConfigError(
                f"needs {len(joint_names)} finite joint positions and finite angles",
                where=f"{path.name} (pose {pose.pose})",
                next_step="check how the plan was made",
            )
