# SPDX-License-Identifier: Apache-2.0
"""The frozen copy of robot.yaml and what belongs to it in a session folder."""

from __future__ import annotations

import io
from pathlib import Path, PurePosixPath
from typing import Any, cast

from ruamel.yaml import YAML

from comcal.errors import UsageError
from comcal.measure.files import sha256_of, write_atomically
from comcal.robot.model import Robot

COMPANIONS = ("conventions.yaml",)
"""Files beside robot.yaml that a session keeps too, where they exist."""


def freeze_robot(robot: Robot, directory: Path) -> None:
    """Copy ``robot.yaml``, its URDF and ``conventions.yaml`` (where there is one).

    The copy loads by itself. The YAML is copied byte by byte where its ``urdf:`` is a plain file
    name; otherwise that one value becomes the name of the copied URDF.

    Parameters
    ----------
    robot : Robot
    directory : Path

    Raises
    ------
    UsageError
        If the robot was not read from a file.
    """
    yaml_path = _yaml_path(robot)
    content = yaml_path.read_bytes()
    if robot.urdf_path is not None:
        name = _urdf_name(robot.urdf_path)
        write_atomically(directory / name, robot.urdf_path.read_bytes())
        content = _with_urdf(content, name)
    for companion in _companions(yaml_path):
        write_atomically(directory / companion.name, companion.read_bytes())
    write_atomically(directory / "robot.yaml", content)


def input_hashes(robot: Robot) -> dict[str, str]:
    """Return the SHA-256 of the robot's own files, under the names of their copies."""
    hashes = {"robot.yaml": sha256_of(_yaml_path(robot))}
    if robot.urdf_path is not None:
        hashes[_urdf_name(robot.urdf_path)] = sha256_of(robot.urdf_path)
    for companion in _companions(_yaml_path(robot)):
        hashes[companion.name] = sha256_of(companion)
    return hashes


def _companions(yaml_path: Path) -> list[Path]:
    """Return the optional files beside robot.yaml that say how to read its data."""
    return [path for path in (yaml_path.with_name(name) for name in COMPANIONS) if path.is_file()]


def _yaml_path(robot: Robot) -> Path:
    if robot.yaml_path is None:
        raise UsageError(
            "the robot was not read from a robot.yaml, so no copy of it can be kept",
            where=robot.name,
            next_step="write one and load it",
        )
    return robot.yaml_path


def _urdf_name(path: Path) -> str:
    return path.name if path.suffix == ".urdf" else f"{path.name}.urdf"


def _with_urdf(content: bytes, name: str) -> bytes:
    """Return robot.yaml with another ``urdf:``; comments and order stay."""
    yaml = YAML()
    yaml.preserve_quotes = True
    yaml.width = 4096
    document = cast("dict[str, Any]", yaml.load(content.decode("utf-8-sig")))
    if PurePosixPath(str(document["urdf"])) == PurePosixPath(name):
        return content
    document["urdf"] = name
    stream = io.BytesIO()
    yaml.dump(document, stream)
    return stream.getvalue()
