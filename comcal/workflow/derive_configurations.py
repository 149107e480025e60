# SPDX-License-Identifier: Apache-2.0
"""Configurations for ``comcal derive`` from a file, in numbers or names."""

from __future__ import annotations

import re
from pathlib import Path

from comcal.errors import ConfigError
from comcal.robot.locate import LocatedYaml, read_yaml
from comcal.symbolic.algebra import Expr
from comcal.symbolic.angle_text import angle_of
from comcal.symbolic.chain import Chain
from comcal.symbolic.program import Quantity, scalar
from comcal.symbolic.spatial import SpatialChain
from comcal.symbolic.spatial_system import Shapes
from comcal.symbolic.system import Angles, System, system_of

FILE_FORMAT = "comcal-configurations/1"
CONFIGURATION_NAME = re.compile(r"[A-Za-z][A-Za-z0-9]*")
ANGLE_NAME = re.compile(r"(theta|phi|psi)(_[A-Za-z0-9]+)*")


def read_pitches(path: Path, chain: Chain) -> System:
    """Read configurations of a planar chain as rows of absolute pitches.

    Parameters
    ----------
    path : Path
        YAML: ``format: comcal-configurations/1`` and ``configurations:`` with a line such as
        ``c: [0, theta_c]`` per configuration, from the ankle up.
    chain : Chain

    Raises
    ------
    ConfigError
        If the file is not of this form.
    """
    each = "angle for every segment, from the ankle up"
    names, angles, inputs = _read(path, len(chain.letters), each)
    return system_of(chain, angles, inputs, names)


def read_shapes(path: Path, chain: SpatialChain) -> Shapes:
    """Read configurations of a spatial chain as rows of joint positions.

    Parameters
    ----------
    path : Path
        YAML as for :func:`read_pitches`, from the base to the tip; a slide's position is in metres.
    chain : SpatialChain

    Raises
    ------
    ConfigError
        If the file is not of this form.
    """
    each = f"position for every joint: {', '.join(joint.name for joint in chain.joints)}"
    names, positions, inputs = _read(path, len(chain.joints), each)
    return Shapes(tuple(names), positions, tuple(inputs))


def _read(path: Path, n: int, each: str) -> tuple[list[str], Angles, list[Quantity]]:
    """Return names and rows of the configurations, and the names in the rows as inputs."""
    located = read_yaml(path)
    unknown = set(located.data) - {"format", "configurations"}
    if located.data.get("format") != FILE_FORMAT or unknown:
        raise ConfigError(
            f"the file holds unknown keys: {', '.join(sorted(unknown))}"
            if unknown
            else "the file does not say what it is",
            where=located.where("format"),
            next_step=f"write `format: {FILE_FORMAT}` and `configurations:`",
        )
    rows = located.data.get("configurations")
    if not isinstance(rows, dict) or not rows:
        raise ConfigError(
            "there are no configurations",
            where=located.where("configurations"),
            next_step="write one per line, as `c: [0, theta_c]`",
        )
    names = [str(name) for name in rows]
    angles: Angles = tuple(_row(located, name, rows[name], n, each) for name in names)
    found = {symbol.name for row in angles for phi in row for symbol in phi.free_symbols}
    inputs = [scalar(name, "angle of the configurations", "rad") for name in sorted(found)]
    return names, angles, inputs


def _row(located: LocatedYaml, name: str, row: object, n: int, each: str) -> tuple[Expr, ...]:
    where = located.where("configurations", name)
    if not CONFIGURATION_NAME.fullmatch(name):
        raise ConfigError(
            f"{name!r} cannot name a configuration in a formula",
            where=where,
            next_step="use a letter, then letters and digits",
        )
    if not isinstance(row, list) or len(row) != n:
        raise ConfigError(
            f"configuration {name!r} needs one {each}",
            where=where,
            measured=f"{len(row)} of them" if isinstance(row, list) else "no list",
            limit=f"{n}",
        )
    angles = tuple(angle_of(text, where) for text in row)
    for symbol in sorted({s.name for phi in angles for s in phi.free_symbols}):
        if not ANGLE_NAME.fullmatch(symbol):
            raise ConfigError(
                f"{symbol!r} does not look like an angle",
                where=where,
                next_step="begin names of angles with theta, phi or psi, as theta_b",
            )
    return angles
