# SPDX-License-Identifier: Apache-2.0
"""Read ``conventions.yaml`` (format ``comcal-conventions/1``): what a table of angles may mean.

It stands beside robot.yaml. Every key but ``format`` and ``orders`` may be left out::

    format: comcal-conventions/1
    joints:                        # what each joint of the chain is, in words
      theta1: ankle of the standing leg
      theta2: hip of the standing leg
    orders:                        # NAME: the column read as each joint, in the order of robot.yaml
      as printed: [theta1, theta2]
      exchanged: [theta2, theta1]
    signs: [theta2]                # joints that may turn the other way; the others turn as stated
    offset: [zero, unknown]        # CoM counted from the first joint, or from an unknown point
    closure:                       # both feet flat on the floor:
      link: other_foot             # a link that is parallel to the root in poses on both feet,
      two_feet_below: 5 deg        # which are those with no joint between bent more than this
      scatter: 1.5 deg             # standard error of one angle, rounding aside
    rounding: {angle: 0.5 deg, length: 0.5 mm}     # half of the last digit printed

Columns carry the names of the chain's joints, because poses.csv names them so: ``q.theta1`` is the
column, and an order says as which joint it is read.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from comcal.errors import ConfigError
from comcal.identify.conventions import Closure, Conventions, Offset, Rounding
from comcal.robot.locate import Key, LocatedYaml, read_yaml
from comcal.robot.schema import Angle, Length, NonNegative, Section, Text
from comcal.robot.tree import Tree
from comcal.robot.validate import did_you_mean, validate_file

FILE_NAME = "conventions.yaml"
MOST_CANDIDATES = 20_000
"""More combinations than this are a mistake, not a question."""


class ClosureSection(Section):
    """The link that is parallel to the root in poses on both feet."""

    link: Text
    two_feet_below: Annotated[Angle, NonNegative]
    scatter: Annotated[Angle, NonNegative]


class RoundingSection(Section):
    """Half of the last digit printed."""

    angle: Annotated[Angle, NonNegative] = 0.0
    length: Annotated[Length, NonNegative] = 0.0


class ConventionsFile(Section):
    """The whole of ``conventions.yaml``."""

    format: Literal["comcal-conventions/1"]
    joints: dict[Text, Text] = Field(default_factory=dict)
    orders: Annotated[dict[Text, list[Text]], Field(min_length=1)]
    signs: list[Text] = Field(default_factory=list)
    offset: list[Literal["zero", "unknown"]] = Field(default_factory=lambda: ["unknown"])
    closure: ClosureSection | None = None
    rounding: RoundingSection = RoundingSection()


def read_conventions(path: Path, tree: Tree) -> Conventions:
    """Read a conventions file for a chain.

    Parameters
    ----------
    path : Path
    tree : Tree
        Its ``joint_names`` are the names of joints and of columns.

    Returns
    -------
    Conventions

    Raises
    ------
    ConfigError
        If the file is missing or not valid; the message names the line and the word that was
        probably meant.
    """
    located = read_yaml(path)
    file = validate_file(located, ConventionsFile)
    names = tree.joint_names
    for name in file.joints:
        _known("joint", name, names, located, ("joints", name))
    for i, name in enumerate(file.signs):
        _known("joint", name, names, located, ("signs", i))
    closure = file.closure
    if closure is not None:
        _known("link", closure.link, tuple(tree.link_index), located, ("closure", "link"))
    conventions = Conventions(
        orders={
            order: _columns(order, columns, names, located)
            for order, columns in file.orders.items()
        },
        free_signs=tuple(i for i, name in enumerate(names) if name in file.signs),
        offsets=tuple(Offset(word) for word in dict.fromkeys(file.offset or ["unknown"])),
        closure=Closure(**closure.model_dump()) if closure is not None else None,
        rounding=Rounding(**file.rounding.model_dump()),
        words=tuple(file.joints.get(name, name) for name in names),
    )
    combinations = len(conventions.orders) * len(conventions.offsets)
    combinations *= 2 ** len(conventions.free_signs)
    if combinations > MOST_CANDIDATES:
        raise ConfigError(
            "too many combinations of orders, signs and offsets",
            where=located.where("signs"),
            measured=f"{combinations}",
            limit=f"{MOST_CANDIDATES}",
            next_step="leave out the signs that are known",
        )
    return conventions


def _columns(
    order: str, columns: Sequence[str], names: tuple[str, ...], located: LocatedYaml
) -> tuple[int, ...]:
    """Return the column read as each joint, refusing an order that is not a permutation."""
    for i, column in enumerate(columns):
        _known("column", column, names, located, ("orders", order, i))
    if sorted(columns) != sorted(names):
        raise ConfigError(
            f"order {order!r} must name every column once",
            where=located.where("orders", order),
            measured=f"got {', '.join(columns)}",
            next_step=f"the columns are {', '.join(names)}",
        )
    return tuple(names.index(column) for column in columns)


def _known(
    what: str, name: str, known: Sequence[str], located: LocatedYaml, path: tuple[Key, ...]
) -> None:
    """Refuse a name that the chain does not have."""
    if name not in known:
        raise ConfigError(
            f"the chain has no {what} {name!r}",
            where=located.where(*path),
            next_step=did_you_mean(name, known),
        )
