# SPDX-License-Identifier: Apache-2.0
"""The newest result of a session, and the poses that it was made from."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np

from comcal.errors import ConfigError, UsageError
from comcal.identify.scope import Scope
from comcal.identify.solution import LinkCom
from comcal.measure.session import Session, open_session
from comcal.measure.table import PoseTable
from comcal.report.calibration_json import FORMAT
from comcal.robot.description import load_robot
from comcal.robot.model import Robot
from comcal.workflow.calibrate import input_hashes, load_extended, load_session
from comcal.workflow.known_model import KnownModel, model_of_result

SAME_NUMBER = 1e-6
"""A CoM computed again differs by rounding alone [m]."""


@dataclass(frozen=True)
class LatestResult:
    """A session as its newest result saw it.

    Parameters
    ----------
    path : Path
        Of ``result.json``.
    content : dict
        Of ``result.json``.
    robot : Robot
        As the result's model describes it.
    table : PoseTable
        The poses that the all-data route used, as the result's model understands them.
    scope : Scope
        What it used and looked for.
    nominal : Robot
        As in the session's URDF.
    raw : PoseTable
        The same poses as they were read.
    model : KnownModel or None
        What the session was solved with; None: the nominal robot.
    """

    session: Session
    robot: Robot
    table: PoseTable
    path: Path
    content: dict[str, Any]
    scope: Scope
    nominal: Robot
    raw: PoseTable
    model: KnownModel | None = None


def latest_result(directory: Path) -> LatestResult:
    """Open a session together with its newest result.

    Raises
    ------
    UsageError
        If it was not solved, or by the paper's route alone, or its robot has no URDF.
    ConfigError
        If robot.yaml, URDF or poses.csv have changed since then.
    DataError
        As of :func:`~comcal.workflow.calibrate.load_session`.
    """
    session = open_session(directory)
    robot = load_robot(session.robot_yaml)
    if not robot.tree.geometry_known:
        raise UsageError(
            "this robot is a chain without URDF, so there is no model to hand back",
            where=str(session.robot_yaml),
            next_step="give robot.yaml a `urdf:`",
        )
    path = session.newest_result("result.json")
    if path is None:
        raise UsageError(
            "this session has no result yet",
            where=str(directory),
            next_step=f"solve it first: comcal solve {directory}",
        )
    content = read_result(path)
    again = f"solve it again: comcal solve {directory}"
    now, then = input_hashes(session, robot), cast("dict[str, str]", content.get("sha256") or {})
    changed = sorted(name for name in now if now[name] != then.get(name))
    if changed:
        raise ConfigError(
            f"{', '.join(changed)} changed since the newest result was made",
            where=str(path),
            next_step=again,
        )
    if not content["links"] or "fitted" not in content:
        raise UsageError(
            "the newest result says nothing about single links: it is of the paper's route alone, "
            "or of an older version",
            where=str(path),
            next_step=again,
        )
    model = model_of_result(content, path)
    if model is None:
        _, robot, table = load_session(directory)
        nominal, raw = robot, table
    else:
        given = load_extended(directory, model)
        nominal, raw = given.nominal, given.raw
        robot, table = given.extended.robot, given.extended.table
    fitted = set(content["fitted"])
    kept = np.array([pose in fitted for pose in table.pose], dtype=np.bool_)
    scope = Scope(**(content.get("scope") or {}))
    return LatestResult(
        session, robot, table.select(kept), path, content, scope, nominal, raw.select(kept), model
    )


def read_result(path: Path) -> dict[str, Any]:
    """Read a ``result.json``.

    Raises
    ------
    ConfigError
        If it is none.
    """
    try:
        content: object = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ConfigError("cannot be read as JSON", where=str(path)) from error
    found = cast("dict[str, Any]", content) if isinstance(content, dict) else {}
    if found.get("format") != FORMAT:
        raise ConfigError(
            "is not the result of a calibration",
            where=str(path),
            measured=f"format {found.get('format')!r}",
            limit=FORMAT,
            next_step="give a session folder or the result.json of one",
        )
    return found


def expect_same_links(result: LatestResult, links: tuple[LinkCom, ...]) -> None:
    """Refuse a result whose CoMs are not those that its poses give today.

    Raises
    ------
    UsageError
        If a measured component differs: it was solved with other settings, or by another version.
    """
    stored = {link["link"]: link["com"] for link in result.content["links"]}
    for link in links:
        for axis in np.flatnonzero(link.identifiable):
            value = (stored.get(link.link) or [None] * 3)[axis]
            if value is None or abs(value - link.com[axis]) > SAME_NUMBER:
                raise UsageError(
                    f"the newest result has another CoM of {link.link!r} than its poses give now",
                    where=str(result.path),
                    next_step="solve the session again with this version of comcal",
                )
