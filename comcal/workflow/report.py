# SPDX-License-Identifier: Apache-2.0
"""``comcal report``: the newest diagnosis and result of one session or more on one page."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast

from comcal.errors import ConfigError, UsageError
from comcal.measure.files import write_new
from comcal.measure.session import Session
from comcal.report.diagnosis_html.page import PageSubject, comparison_page, diagnosis_page
from comcal.report.diagnosis_html.raw import raw_channels
from comcal.report.diagnosis_read import diagnosis_from_json
from comcal.workflow.calibrate import input_hashes, load_session
from comcal.workflow.latest_result import read_result


def report_sessions(directories: Sequence[Path], output: Path) -> Path:
    """Write one page about the newest diagnoses of sessions, and return its path.

    Parameters
    ----------
    directories : sequence of Path
        Session folders, each diagnosed before; one at least.
    output : Path
        A file that does not exist yet.

    Raises
    ------
    UsageError
        If a session was not diagnosed, or there is such a file.
    ConfigError
        If a result is damaged.
    """
    subjects = [_subject(directory) for directory in directories]
    page = diagnosis_page(subjects[0]) if len(subjects) == 1 else comparison_page(subjects)
    write_new(output, page.encode("utf-8"))
    return output


def _subject(directory: Path) -> PageSubject:
    session, robot, table = load_session(directory, doubtful=True)
    path = session.newest_result("diagnosis.json")
    if path is None:
        raise UsageError(
            "this session has no diagnosis yet",
            where=str(directory),
            next_step=f"diagnose it first: comcal diagnose {directory}",
        )
    content = _read(path)
    made_from = cast("dict[str, str]", content.get("sha256") or {})
    now = input_hashes(session, robot)
    facts = [("robot", robot.name), *_solved(session)]
    is_same = all(made_from.get(name) == digest for name, digest in now.items())
    if not is_same:
        facts.append(("robot.yaml, URDF or poses.csv", "changed since the diagnosis"))
    return PageSubject(
        title=str(directory),
        diagnosis=diagnosis_from_json(content, str(path)),
        raw=raw_channels(table) if is_same else (),
        facts=tuple(facts),
        made_from=made_from,
    )


def _read(path: Path) -> dict[str, Any]:
    try:
        content: object = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise ConfigError("cannot be read as JSON", where=str(path)) from error
    return cast("dict[str, Any]", content) if isinstance(content, dict) else {}


def _solved(session: Session) -> list[tuple[str, str]]:
    """Return what the newest calibration says, if there is one."""
    path = session.newest_result("result.json")
    if path is None:
        return []
    content = read_result(path)
    facts = [("calibration", str(content.get("verdict", "")).replace("_", " "))]
    mass, held_out = content.get("mass") or {}, content.get("held_out") or {}
    if mass.get("value") is not None:
        facts.append(("mass", f"{mass['value']:.3f} kg, {mass['urdf']:.3f} kg in the URDF"))
    if held_out.get("com_rms_mm") is not None:
        facts.append(("held-out CoM", f"{held_out['com_rms_mm']:.2f} mm rms"))
    return facts
