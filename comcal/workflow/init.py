# SPDX-License-Identifier: Apache-2.0
"""``comcal init``: a commented robot.yaml from a URDF."""

from __future__ import annotations

import os
from pathlib import Path

from comcal.errors import UsageError
from comcal.measure.files import write_new
from comcal.robot.guess import Guess, guess_robot
from comcal.robot.robot_yaml import robot_yaml_text
from comcal.robot.urdf import read_urdf


def init_robot(path: Path, urdf: Path) -> Guess:
    """Write a robot.yaml for a URDF, and return what was guessed.

    Parameters
    ----------
    path : Path
        Of the file to write; nothing is ever overwritten.
    urdf : Path

    Raises
    ------
    UsageError
        If the file exists or its folder does not.
    UrdfError
        If the URDF is missing or wrong.
    """
    if path.exists() or path.is_symlink():
        raise UsageError(
            "exists already, and nothing is ever overwritten",
            where=str(path),
            next_step="give another name, or move it away",
        )
    folder = path.resolve().parent
    if not folder.is_dir():
        raise UsageError("there is no such folder", where=str(folder), next_step="make it first")
    tree = read_urdf(urdf)
    guess = guess_robot(tree)
    relative = os.path.relpath(urdf.resolve(), folder)
    write_new(path, robot_yaml_text(tree, guess, relative).encode("utf-8"))
    return guess
