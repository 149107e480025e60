# SPDX-License-Identifier: Apache-2.0
"""``--avoid FILE``: poses or joint ranges that a plan must stay away from."""

from __future__ import annotations

from pathlib import Path
from typing import Any, cast

import numpy as np

from comcal.errors import ConfigError
from comcal.measure.csv_file import read_csv
from comcal.plan.avoid import Avoided, Region
from comcal.robot.locate import LocatedYaml, read_yaml
from comcal.robot.tree import Tree
from comcal.robot.validate import did_you_mean

PREFIX = "q."


def read_avoided(path: Path, tree: Tree) -> Avoided:
    """Read what is to be avoided.

    Parameters
    ----------
    path : Path
        A CSV with columns ``q.<joint>`` (a plan.csv or a poses.csv): no planned pose may be near
        one of its rows; empty cells and joints without a column do not matter. Or a YAML file::

            avoid:
              - {l_knee: [1.2, 2.0], r_knee: [1.2, 2.0]}   # never both at once
    tree : Tree

    Raises
    ------
    ConfigError
        If the file is neither, or names a joint that the robot does not have.
    """
    if path.suffix.lower() == ".csv":
        return _poses(path, tree)
    return _regions(read_yaml(path), tree)


def _poses(path: Path, tree: Tree) -> Avoided:
    file = read_csv(path, error=ConfigError)
    columns = {
        name.removeprefix(PREFIX): i
        for i, name in enumerate(file.header)
        if name.startswith(PREFIX)
    }
    if not columns:
        raise ConfigError(
            "there is no column q.<joint>",
            where=path.name,
            next_step="give a plan.csv or a poses.csv, or a YAML file with `avoid:`",
        )
    for joint in columns:
        _known(joint, tree, f"{path.name}:1")
    poses = []
    for row in file.rows:
        values = {joint: file.number(row, i) for joint, i in columns.items()}
        given = [values.get(name) for name in tree.joint_names]
        poses.append(np.array([np.nan if x is None else x for x in given], np.float64))
    return Avoided(poses=tuple(poses))


def _regions(located: LocatedYaml, tree: Tree) -> Avoided:
    regions = located.data.get("avoid")
    unknown = [key for key in located.data if key != "avoid"]
    if unknown or not isinstance(regions, list):
        raise ConfigError(
            f"{unknown[0]!r} is not a key of this file" if unknown else "`avoid:` must be a list",
            where=located.where(*(unknown[:1] or ["avoid"])),
            next_step="write `avoid:` with one map of joint: [lower, upper] per item",
        )
    found: list[Region] = []
    for i, item in enumerate(cast("list[object]", regions)):
        if not isinstance(item, dict) or not item:
            raise ConfigError(
                "a region is a map of joint: [lower, upper]", where=located.where("avoid", i)
            )
        region = cast("dict[str, Any]", item)
        for joint, ends in region.items():
            where = located.where("avoid", i, joint)
            _known(joint, tree, where)
            if not _is_interval(ends):
                raise ConfigError(
                    f"the range of {joint!r} must be two numbers, lower before upper",
                    where=where,
                    next_step="write them in rad or m, as [0.5, 1.2]",
                )
        found.append(
            Region(
                tuple(tree.joint_names.index(joint) for joint in region),
                tuple(float(ends[0]) for ends in region.values()),
                tuple(float(ends[1]) for ends in region.values()),
            )
        )
    return Avoided(regions=tuple(found))


def _known(joint: str, tree: Tree, where: str) -> None:
    if joint not in tree.joint_names:
        raise ConfigError(
            f"the robot has no independent joint {joint!r}",
            where=where,
            next_step=did_you_mean(joint, tree.joint_names),
        )


def _is_interval(value: object) -> bool:
    if not isinstance(value, list) or len(cast("list[object]", value)) != 2:
        return False
    lower, upper = cast("list[object]", value)
    return isinstance(lower, int | float) and isinstance(upper, int | float) and lower <= upper
