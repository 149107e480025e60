# SPDX-License-Identifier: Apache-2.0
"""From a logger's CSV to a session folder: ``comcal import``.

Nothing is left behind by a refused import: the session is made in a folder beside its final place,
and renamed when all of it is sound.
"""

from __future__ import annotations

import shutil
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from comcal.errors import ConfigError, DataError
from comcal.measure.csv_file import CsvFile, Row, format_cell, read_csv, write_csv
from comcal.measure.files import sync_folder
from comcal.measure.log_poses import log_poses
from comcal.measure.logger_table import convert
from comcal.measure.map_file import mapped_robot, read_map_section, resolve_map
from comcal.measure.plausibility import check_plausible
from comcal.measure.poses_csv import pose_table
from comcal.measure.quasi_static_poses import quasi_static_poses
from comcal.measure.session import Session, create_session, open_session
from comcal.robot.description import load_robot

SOURCE = "import"


@dataclass(frozen=True)
class Imported:
    """What an import made.

    Parameters
    ----------
    session : Session
    poses : int
        Number of rows of ``poses.csv``.
    notes : tuple of str
        What the reader of the new table noted, and what was left out.
    """

    session: Session
    poses: int
    notes: tuple[str, ...]


def import_csv(
    file: Path | str,
    map_path: Path | str,
    directory: Path | str,
    *,
    quasi_static: bool = False,
    robot_yaml: Path | str | None = None,
    between: tuple[float, float] | None = None,
) -> Imported:
    """Make a session of a logger's CSV.

    Parameters
    ----------
    file : Path or str
        Comma-separated, one header row; lines before it may start with ``#``.
    map_path : Path or str
        MAP.yaml, see :mod:`comcal.measure.map_file`.
    directory : Path or str
        The session folder to make; must not exist, or be empty.
    quasi_static : bool
        Take the slowest windows of a continuous log and add the error of the neglected inertia.
    robot_yaml : Path or str, optional
        Instead of the ``robot`` of the map.
    between : (start, end), optional
        Only samples from *start* to less than *end*, in the time of the log [s].

    Raises
    ------
    ConfigError
        If the map is wrong or *directory* holds something.
    DataError
        If the numbers cannot be used: not finite, not still, wrong unit or sign.
    MissingColumnError
        If the log lacks a mapped column, or the map a required one.
    """
    directory = Path(directory)
    if directory.exists() and (not directory.is_dir() or any(directory.iterdir())):
        raise ConfigError(
            "exists already and nothing is ever overwritten",
            where=str(directory),
            next_step="give a new folder with -s",
        )
    section, located = read_map_section(map_path)
    robot = load_robot(mapped_robot(section, located) if robot_yaml is None else Path(robot_yaml))
    plan = resolve_map(section, located, robot)
    log = convert(read_csv(file, error=DataError), plan)
    if between is not None:
        log = log.between(*between)
    notes: tuple[str, ...] = ()
    if quasi_static:
        poses, notes = quasi_static_poses(log, robot, plan)
    else:
        poses = log_poses(log, robot, plan)
    header = list(dict.fromkeys(name for pose in poses for name in pose.cells))
    cells = [[format_cell(pose.cells.get(name)) for name in header] for pose in poses]
    # Lines of the log stand in for those of poses.csv, which does not exist if this is refused.
    rows = tuple(Row(p.line, tuple(line)) for p, line in zip(poses, cells, strict=True))
    cells_file = CsvFile(log.file.path, tuple(header), rows, True, DataError)
    table = pose_table(cells_file, robot, plan.tares)
    check_plausible(table, robot)
    made: dict[str, object] = {
        "log": Path(file).name,
        "map": Path(map_path).name,
        "quasi_static": quasi_static,
        "poses": len(poses),
    }
    if between is not None and np.isfinite(between).any():
        made["between"] = [x if np.isfinite(x) else None for x in between]
    details: dict[str, object] = {"import": made}
    if plan.tares:
        details["tare"] = {
            sensor: {"value": list(value), "sigma": list(sigma)}
            for sensor, (value, sigma) in plan.tares.items()
        }
    with _beside(directory) as staging:
        session = create_session(staging, robot, source=SOURCE, details=details)
        write_csv(session.poses_csv, header, cells)
        for path in (Path(file), Path(map_path)):
            session.note_input(path)
    return Imported(open_session(directory), len(poses), (*notes, *table.notes))


@contextmanager
def _beside(directory: Path) -> Generator[Path, None, None]:
    """Yield a new folder that becomes *directory* if all goes well and vanishes otherwise."""
    parent = directory.resolve().parent
    staging = parent / f".{directory.name}.importing"
    try:
        parent.mkdir(parents=True, exist_ok=True)
        staging.mkdir()
    except FileExistsError as problem:
        raise ConfigError(
            "another import into this folder is under way, or was killed",
            where=str(staging),
            next_step="delete this folder if no import is running",
        ) from problem
    except OSError as problem:
        raise ConfigError(
            f"cannot be made: {problem.strerror}", where=str(staging), next_step="check the path"
        ) from problem
    try:
        yield staging
        staging.rename(directory)  # replaces an empty folder, fails on any other
        sync_folder(parent)
    finally:
        if staging.exists():
            shutil.rmtree(staging)
