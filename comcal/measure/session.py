# SPDX-License-Identifier: Apache-2.0
"""Making and opening session folders."""

from __future__ import annotations

import platform
import secrets
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import NoReturn

import numpy as np

from comcal.errors import ConfigError, UsageError
from comcal.measure.files import sync_folder
from comcal.measure.frozen import freeze_robot, input_hashes
from comcal.measure.session_folder import FORMAT, LOCK, Session, locked
from comcal.measure.session_yaml import as_mapping, write_metadata
from comcal.robot.model import Robot

__all__ = ["Session", "check_same_experiment", "create_session", "is_session", "open_session"]


FRAMES = "can"
"""Folder of raw frames, made by the source that receives them."""


def create_session(
    directory: Path,
    robot: Robot,
    *,
    source: str = "",
    seed: int | None = None,
    details: Mapping[str, object] | None = None,
) -> Session:
    """Make a session folder, or open one that the same robot and source began.

    Parameters
    ----------
    directory : Path
        Absent, empty, or a session.
    robot : Robot
        Read from a ``robot.yaml``, which is copied together with its URDF.
    source : str
        Name of the source, as in ``--source``; empty for imported data.
    seed : int or None
        Master seed of a simulated source.
    details : mapping
        Further entries of ``session.yaml``, such as ``engine``, ``noise`` or ``tare``.

    Raises
    ------
    UsageError
        If the folder holds something else, another recording runs in it, or it was begun with
        another source or seed.
    ConfigError
        If it was begun with another robot.yaml or URDF.
    """
    directory = Path(directory)
    if not _is_ours(directory):
        raise UsageError(
            "the folder is not empty and is no session",
            where=str(directory),
            next_step="give a new folder with -s",
        )
    session = Session(directory)
    if not session.session_yaml.exists():
        directory.mkdir(parents=True, exist_ok=True)
        with locked(directory):
            # Somebody else may have made it while we waited for the lock.
            if not session.session_yaml.exists():
                _begin(session, robot, source, seed, details or {})
                return session
    check_same_experiment(session, robot, source, seed)
    return session


def open_session(directory: Path) -> Session:
    """Open a session folder for reading: a recorded or imported one, or one made by hand.

    A folder that holds ``robot.yaml``, its URDF and ``poses.csv`` is enough.

    Raises
    ------
    UsageError
        If there is none.
    ConfigError
        If its ``session.yaml`` is damaged, of another format, or lost.
    """
    session = Session(Path(directory))
    if not session.directory.is_dir():
        raise UsageError(
            "there is no such folder",
            where=str(directory),
            next_step="check the path, or make a session with comcal record or comcal import",
        )
    if session.session_yaml.is_file():
        _ = session.metadata
    elif not session.is_handmade:
        _refuse(session)
    return session


def _refuse(session: Session) -> NoReturn:
    """Say what a folder without ``session.yaml`` lacks.

    Raises
    ------
    UsageError
        If it is no session.
    ConfigError
        If it was one.
    """
    if session.poses_csv.is_file() and session.robot_yaml.is_file():
        raise ConfigError(
            "session.yaml is gone, and with it the tares and which poses were measured again",
            where=str(session.directory),
            next_step="restore it from a copy; or solve robot.yaml, its URDF and poses.csv alone, "
            "copied to another folder",
        )
    needed = (session.robot_yaml.name, session.poses_csv.name)
    lacking = " and ".join(name for name in needed if not (session.directory / name).is_file())
    raise UsageError(
        f"is no session: it has no session.yaml, and no {lacking} either",
        where=str(session.directory),
        next_step="make one with comcal record or comcal import; or put robot.yaml, its URDF and "
        "poses.csv into a folder",
    )


def is_session(directory: Path) -> bool:
    """Whether *directory* holds a session."""
    return (Path(directory) / "session.yaml").is_file()


def check_same_experiment(session: Session, robot: Robot, source: str, seed: int | None) -> None:
    """Refuse to mix two experiments in one folder.

    Raises
    ------
    UsageError
        If the source or a given seed is another one.
    ConfigError
        If robot.yaml or the URDF have another content than when the session was begun.
    """
    known = session.metadata
    for what, now, before in (
        ("source", source, known.get("source")),
        ("seed", known.get("seed") if seed is None else seed, known.get("seed")),
    ):
        if now != before:
            raise UsageError(
                f"this session was begun with another {what}",
                where=str(session.directory),
                measured=f"{what} {now}, before {before}",
                next_step=f"use {what} {before}, or give a new folder with -s",
            )
    if robot.yaml_path is not None and robot.yaml_path.resolve() == session.robot_yaml.resolve():
        return  # the frozen copy itself
    before = as_mapping(known.get("sha256"))
    for name, digest in input_hashes(robot).items():
        if before.get(name) != digest:
            raise ConfigError(
                "has changed since the session was begun",
                where=str(robot.yaml_path if name == "robot.yaml" else robot.urdf_path),
                next_step=f"restore it, go on with {session.robot_yaml}, or give a new folder "
                "with -s",
            )


def _begin(
    session: Session, robot: Robot, source: str, seed: int | None, details: Mapping[str, object]
) -> None:
    """Write the files of a new session; session.yaml last, since it makes the folder one."""
    freeze_robot(robot, session.directory)
    entries: dict[str, object] = {
        "format": FORMAT,
        "id": secrets.token_hex(8),
        "versions": {
            "comcal": version("comcal"),
            "python": platform.python_version(),
            "numpy": np.__version__,
        },
        "gravity": robot.gravity,
        "source": source,
    }
    if seed is not None:
        entries["seed"] = seed
    write_metadata(session.session_yaml, {**entries, **details, "sha256": input_hashes(robot)})
    sync_folder(session.directory.parent)


def _is_ours(directory: Path) -> bool:
    """Whether a session may be in *directory*; the lock is the first file that we write.

    A source that keeps frames begins with them, before anybody knows whether it will work.
    """
    if not directory.exists():
        return True
    if not directory.is_dir():
        return False
    names = {path.name for path in directory.iterdir()}
    return names <= {FRAMES} or "session.yaml" in names or LOCK in names
