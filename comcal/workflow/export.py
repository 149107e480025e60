# SPDX-License-Identifier: Apache-2.0
"""``comcal export``: the calibrated robot as URDF, as YAML and as C, never over an old file."""

from __future__ import annotations

import difflib
import platform
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from comcal.errors import UsageError
from comcal.identify.adjust import Adjustment
from comcal.identify.calibrated_model import CalibratedModel, calibrated_model
from comcal.identify.model_error import model_error
from comcal.measure.files import write_new
from comcal.report.export import Summary
from comcal.report.export_yaml import model_document, model_yaml
from comcal.robot.findings import Finding, Level
from comcal.robot.health import check_health
from comcal.robot.model import Robot
from comcal.robot.tree import Array
from comcal.robot.urdf_write import InertialEdit, write_inertials
from comcal.workflow.latest_result import LatestResult, expect_same_links, latest_result


@dataclass(frozen=True)
class ExportOrder:
    """What to write, and where.

    Parameters
    ----------
    urdf, yaml : Path or None
        New files.
    c : Path or None
        Folder for the C files; made if it is not there.
    scale_masses : bool
        Multiply the masses too, so that their sum is the one measured.
    dry_run : bool
        Write nothing.
    """

    urdf: Path | None = None
    yaml: Path | None = None
    c: Path | None = None
    scale_masses: bool = False
    dry_run: bool = False


def export_session(directory: Path, order: ExportOrder) -> Summary:
    """Hand the newest result of a session back as a model.

    Raises
    ------
    UsageError
        If the session has no result to export, or a file to be written exists.
    ConfigError, UrdfError, DataError
        If the session or its URDF cannot be read.
    """
    result = latest_result(directory)
    model = calibrated_model(
        result.robot, result.table, result.scope, scale_masses=order.scale_masses
    )
    tares = _fitted_tares(model.fitted.adjustment)
    expect_same_links(result, model.solution.links)
    urdf_path = result.robot.urdf_path
    if urdf_path is None:
        raise UsageError("the robot has no URDF", where=str(result.session.robot_yaml))
    old = urdf_path.read_bytes()
    new = write_inertials(old, urdf_path.name, inertial_edits(model))
    document = model_document(model, _origin(result))
    files: dict[Path, bytes] = {}
    if order.urdf is not None:
        files[order.urdf] = new
    if order.yaml is not None:
        files[order.yaml] = model_yaml(document).encode("utf-8")
    if order.c is not None:
        # Imported here: nobody who exports a URDF should wait for code generation.
        from comcal.workflow.export_c import export_c

        for name, text in export_c(model.robot.tree, result.robot.name).items():
            files[order.c / name] = text.encode("utf-8")
    _refuse_existing(files)
    if not order.dry_run:
        for path, content in files.items():
            path.parent.mkdir(parents=True, exist_ok=True)
            write_new(path, content)
    return Summary(
        model=model,
        document=document,
        verdict=str(result.content["verdict"]),
        diff=_diff(old, new, urdf_path.name, order.urdf),
        before=model_error(result.robot, result.table, tares),
        after=model_error(model.robot, result.table, tares),
        findings=new_findings(result.robot, model.robot),
        files=() if order.dry_run else tuple(files),
    )


def inertial_edits(model: CalibratedModel) -> tuple[InertialEdit, ...]:
    """Return what changes in the URDF: fitted components, and masses if they were to change.

    Parameters
    ----------
    model : CalibratedModel
    """
    edits: list[InertialEdit] = []
    for link, built in zip(model.links, model.robot.tree.links, strict=True):
        if not built.has_inertial or (link.kept and link.factor == 1.0):
            continue
        x, y, z = (
            float(value) if source != "prior" else None
            for value, source in zip(link.com, link.provenance, strict=True)
        )
        edits.append(InertialEdit(link.link, (x, y, z), link.factor))
    return tuple(edits)


def new_findings(before: Robot, after: Robot) -> tuple[Finding, ...]:
    """Return the errors and warnings of the health check that the new model brings.

    Parameters
    ----------
    before, after : Robot
    """
    known = {(f.where, f.what) for f in check_health(before)}
    return tuple(
        f
        for f in check_health(after)
        if f.level is not Level.INFO and (f.where, f.what) not in known
    )


def _fitted_tares(fit: Adjustment) -> dict[str, Array]:
    """Return the tares that were found together with the CoMs."""
    found = {sensor: fit.unknowns.offset_columns(sensor) for sensor in fit.unknowns.offsets}
    return {sensor: fit.theta[at] for sensor, at in found.items() if at is not None}


def _refuse_existing(files: dict[Path, bytes]) -> None:
    for path in files:
        if path.exists() or path.is_symlink():
            raise UsageError(
                "exists already, and nothing is ever overwritten",
                where=str(path),
                next_step="give another name, or move it away",
            )


def _origin(result: LatestResult) -> dict[str, Any]:
    """Return what the model was made from."""
    folder = result.path.resolve().parent
    return {
        "session": result.session.metadata.get("id", "made by hand"),
        "result": f"results/{folder.name}/result.json",
        "verdict": result.content["verdict"],
        "sha256": result.content["sha256"],
        "versions": {
            "comcal": version("comcal"),
            "python": platform.python_version(),
            "numpy": np.__version__,
        },
    }


def _diff(old: bytes, new: bytes, name: str, target: Path | None) -> str:
    """Return the difference of two URDFs; bytes that are no UTF-8 survive it."""
    before, after = (raw.decode("utf-8", "surrogateescape") for raw in (old, new))
    return "".join(
        line if line.endswith("\n") else line + "\n\\ No newline at end of file\n"
        for line in difflib.unified_diff(
            _lines(before),
            _lines(after),
            f"a/{name}",
            f"b/{target.name if target is not None else name}",
        )
    )


def _lines(text: str) -> list[str]:
    r"""Split after every ``\n`` only; a ``\r`` before it stays visible to ``patch``."""
    return [line for line in text.replace("\n", "\n\0").split("\0") if line]
