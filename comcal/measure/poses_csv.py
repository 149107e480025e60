# SPDX-License-Identifier: Apache-2.0
"""Reading ``poses.csv``: the minimal input of comcal, which any logger can write.

What comes out is a :class:`~comcal.measure.table.PoseTable`: tares subtracted once, senses
resolved (every wrench is ground on robot), standard errors turned into variances. Nothing is
guessed: what is odd but harmless becomes a note, what is not is refused with file and line.
Whether the numbers can be true is asked by :mod:`comcal.measure.plausibility`.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

import numpy as np

from comcal.errors import DataError, MissingColumnError, NotFiniteError
from comcal.measure.columns import Family, Header, understand
from comcal.measure.csv_file import CsvFile, Row, read_csv, shorten
from comcal.measure.plan import DOUBLE, NONE
from comcal.measure.pose_cells import PoseCells
from comcal.measure.table import PoseTable
from comcal.measure.uncertainty import Variances, comparable_repeats, variances
from comcal.measure.wrench_columns import Tares, read_wrenches
from comcal.robot.model import Base, Robot
from comcal.robot.tree import Array

IMU_COLUMNS = ("imu.ax", "imu.ay", "imu.az")
MOTION_FAMILIES = (
    Family.JOINT_VELOCITY,
    Family.JOINT_ACCELERATION,
    Family.SLOPE,
    Family.DEVIATION,
)
MEASUREMENTS = (Family.WRENCH, Family.COM, Family.COP, Family.TORQUE, Family.CURRENT)


def read_poses(
    path: Path | str,
    robot: Robot,
    tares: Tares | None = None,
    *,
    superseded: Collection[int] = (),
    whole_lines: bool = False,
) -> PoseTable:
    """Read the static poses of a session or of any logger.

    Parameters
    ----------
    path : Path or str
        Comma-separated UTF-8 with a header row; columns as in :mod:`comcal.measure.columns`.
    robot : Robot
    tares : mapping from sensor name to (value, sigma), optional
        Unloaded readings, each shape (6,), subtracted here and nowhere else. Their error is the
        same in every pose, so it goes to ``PoseTable.tare_cov`` and not into ``wrench_cov``.
    superseded : collection of int, optional
        Poses that were measured again under another id; left out with a note.
    whole_lines : bool, optional
        The file is appended to by comcal: a last line without line end was cut off, and is left
        out with a note. Other files may end as they like.

    Returns
    -------
    PoseTable
        Rows with ``use`` = 0 left out. ``notes`` tell what was dropped, ignored or assumed.

    Raises
    ------
    ConfigError
        If the file does not exist or a tare is of no sensor of this robot.
    MissingColumnError
        If ``pose``, ``support``, the position of an independent joint, all channels of a loaded
        foot's sensor, or every measurement is absent.
    NotFiniteError
        If a cell that is needed is empty, or any cell is NaN or infinite.
    DataError
        If the file is not such a table, an id stands twice, or a support or sign is unknown.
    """
    file = read_csv(path, error=DataError, whole_lines=whole_lines)
    table = pose_table(file, robot, tares, superseded=superseded)
    if file.ends_with_newline:
        return table
    note = (
        "the last line was cut off while it was written and is left out"
        if whole_lines
        else "the last line has no line end: check that it was not cut off"
    )
    return replace(table, notes=(*table.notes, note))


def pose_table(
    file: CsvFile, robot: Robot, tares: Tares | None = None, *, superseded: Collection[int] = ()
) -> PoseTable:
    """Make a pose table of cells; see :func:`read_poses` for parameters and errors."""
    header = understand(file.header, robot)
    _require_columns(file, header, robot)
    rows, notes = _used_rows(file, header, superseded)
    cells = PoseCells(file, header, rows, robot)
    if header.unknown:
        notes.append(_note_on_unknown(header))

    joints = robot.tree.joint_names
    pose, support = cells.ids, cells.supports()
    q = np.zeros((len(rows), len(joints)))
    for k, joint in enumerate(joints):
        q[:, k] = cells.required(f"q.{joint}")
    anywhere = np.ones(len(rows), dtype=np.bool_)
    determinate = np.array([s != DOUBLE for s in support])
    revisit = cells.words("revisit")
    everywhere = comparable_repeats(revisit, q, anywhere)
    single = comparable_repeats(revisit, q, determinate)

    wrenches = read_wrenches(cells, support, single, tares or {})
    q_var = _variances(cells, [f"q.{j}" for j in joints], "encoder", None)
    tau = _variances(cells, [f"tau.{j}" for j in joints], "torque", single)
    current = _variances(cells, [f"i.{j}" for j in joints], "current", single)
    com = _variances(cells, ["com.x", "com.y", "com.z"], "com", everywhere)
    cop = _variances(cells, ["cop.x", "cop.y"], "com", everywhere)
    imu = _variances(cells, IMU_COLUMNS, "imu", everywhere)
    base_tilt = cells.columns(["base.roll", "base.pitch"])
    _require_gravity(cells, support, base_tilt)
    notes += [*wrenches.notes, *(note for v in (tau, current, com, cop) for note in v.notes)]
    return PoseTable(
        pose=pose,
        support=support,
        q=q,
        q_cov=q_var.total,
        wrench=wrenches.wrench,
        wrench_cov=wrenches.cov,
        torque=cells.columns([f"tau.{j}" for j in joints]),
        torque_var=tau.total,
        current=cells.columns([f"i.{j}" for j in joints]),
        current_var=current.total,
        com=cells.columns(["com.x", "com.y", "com.z"]),
        com_var=com.total,
        imu=cells.columns(IMU_COLUMNS),
        configuration=cells.words("configuration"),
        tilt=cells.optional("tilt"),
        stance=cells.words("stance"),
        condition=cells.words("condition"),
        revisit=revisit,
        heading=cells.optional("heading"),
        com_frame=cells.com_frame(),
        notes=tuple(dict.fromkeys(notes)),
        source=file.path,
        row_lines=tuple(row.line for row in rows),
        cop=cells.columns(["cop.x", "cop.y"]),
        cop_var=cop.total,
        imu_var=imu.total,
        base_tilt=base_tilt,
        approach=cells.approaches(),
        t=cells.optional("t"),
        temperature={c.target: cells.optional(c.name) for c in header.of(Family.TEMPERATURE)},
        motion={c.name: cells.optional(c.name) for f in MOTION_FAMILIES for c in header.of(f)},
        tare_cov=wrenches.tare_cov,
    )


def _variances(
    cells: PoseCells,
    columns: list[str] | tuple[str, ...],
    family: str,
    repeats: tuple[str, ...] | None,
) -> Variances:
    errors = np.full((len(cells.rows), len(columns)), np.nan)
    for k, name in enumerate(columns):
        errors[:, k] = cells.standard_error(f"se.{name}")
    return variances(cells.columns(columns), errors, family, cells.robot.noise, repeats)


def _require_columns(file: CsvFile, header: Header, robot: Robot) -> None:
    meant = {near: name for name, near in header.unknown.items() if near}
    needed = ("pose", "support", *(f"q.{joint}" for joint in robot.tree.joint_names))
    for name in needed:
        if name not in header.index:
            what = f"column {name} is absent"
            if name.startswith("q."):
                what += f": the position of joint {name[2:]} of {robot.name}"
            raise MissingColumnError(
                what,
                where=file.path.name,
                next_step=f"did you mean it by {meant[name]}?"
                if name in meant
                else "log it, or fill in the constant value it had",
            )
    if not any(header.of(family) for family in MEASUREMENTS):
        near = next((f"{name} -> {near}" for near, name in meant.items()), "")
        raise MissingColumnError(
            "no column holds a measurement (ft.*, com.*, cop.*, tau.* or i.*)",
            where=file.path.name,
            next_step=f"did you mean {near}?" if near else "add what the sensors measured",
        )


def _used_rows(
    file: CsvFile, header: Header, superseded: Collection[int]
) -> tuple[tuple[Row, ...], list[str]]:
    pose, use = header.index["pose"], header.index.get("use")
    used: list[Row] = []
    dropped: dict[str, list[str]] = {}
    for row in file.rows:
        flag = None if use is None else file.number(row, use)
        if flag not in (None, 0.0, 1.0):
            raise DataError(
                f"column use is {flag:g}",
                where=file.where(row),
                next_step="write 1 to use the pose, 0 to drop it",
            )
        reason = ""
        if flag == 0.0:
            reason = "dropped by use = 0"
        elif superseded and file.integer(row, pose) in superseded:
            reason = "measured again under another number"
        if reason:
            text = f"{shorten(row.cells[pose])} (line {row.line})"
            dropped.setdefault(reason, []).append(text)
        else:
            used.append(row)
    notes = [f"{reason}: pose {', '.join(poses)}" for reason, poses in dropped.items()]
    if not used:
        raise DataError(
            "no row is left to be used",
            where=file.path.name,
            measured="; ".join(f"{len(poses)} {reason}" for reason, poses in dropped.items()),
            next_step="set use = 1 in the rows to be used",
        )
    return tuple(used), notes


def _note_on_unknown(header: Header) -> str:
    names = [
        f"{shorten(name)} (did you mean {near}?)" if near else shorten(name)
        for name, near in header.unknown.items()
    ]
    return f"ignored unknown columns: {', '.join(names)}"


def _require_gravity(cells: PoseCells, support: tuple[str, ...], base_tilt: Array) -> None:
    """Refuse a held robot of which nothing tells how it leans."""
    if cells.robot.base is Base.FIXED:
        return
    known = np.isfinite(cells.columns(IMU_COLUMNS)).all(axis=1) | np.isfinite(base_tilt).all(axis=1)
    held = np.array([s == NONE for s in support])
    for i in np.flatnonzero(held & ~known):
        raise NotFiniteError(
            "the robot is held (support none) and nothing tells where down is",
            where=cells.where(int(i)),
            next_step="give imu.ax .ay .az, or base.roll and base.pitch",
        )
