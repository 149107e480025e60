# SPDX-License-Identifier: Apache-2.0
"""``comcal export``: the calibrated robot as URDF, as YAML and as C, never over an old file."""

from __future__ import annotations

import difflib
import platform
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from comcal.effects.extend import extend
from comcal.errors import UsageError
from comcal.identify.adjust import Adjustment
from comcal.identify.calibrated_model import CalibratedModel, calibrated_model
from comcal.identify.model_error import model_error
from comcal.measure.files import write_new
from comcal.measure.session import open_session
from comcal.report.export import Summary
from comcal.report.export_extension import ExtensionSummary
from comcal.report.export_yaml import model_document, model_yaml
from comcal.robot.changes_yaml import extension_text
from comcal.robot.findings import Finding, Level
from comcal.robot.health import check_health
from comcal.robot.model import Robot
from comcal.robot.tree import Array
from comcal.workflow.calibrate import load_extended
from comcal.workflow.known_model import KnownModel, model_json, model_of_result
from comcal.workflow.latest_result import (
    LatestResult,
    expect_same_links,
    latest_result,
    read_result,
)
from comcal.workflow.urdf_parts import Part, parts_of, rest_of, written_urdf


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
    model : KnownModel or None
        The model whose result is to be exported; where the newest result was made without it, the
        model alone, nothing being fitted. None: whatever the newest result was made with.
    rest : Path or None
        New file for what of the model no URDF can hold.
    """

    urdf: Path | None = None
    yaml: Path | None = None
    c: Path | None = None
    scale_masses: bool = False
    dry_run: bool = False
    model: KnownModel | None = None
    rest: Path | None = None


def export_session(directory: Path, order: ExportOrder) -> Summary | ExtensionSummary:
    """Hand the newest result of a session back as a model, or a model that it was not made with.

    Raises
    ------
    UsageError
        If the session has no result to export, or a file to be written exists.
    ConfigError, UrdfError, DataError
        If the session or its URDF cannot be read.
    """
    if order.model is not None and not order.model.is_same(_newest_model(directory)):
        return _export_extension(directory, order, order.model)
    result = latest_result(directory)
    model = calibrated_model(
        result.robot, result.table, result.scope, scale_masses=order.scale_masses
    )
    tares = _fitted_tares(model.fitted.adjustment)
    expect_same_links(result, model.solution.links)
    if result.model is not None:
        model = _against_urdf(model, result.nominal)
    parts = () if result.model is None else parts_of(result.nominal, result.model.known)
    written = _Written.of(result.nominal, model.robot, order, parts)
    document = model_document(model, _origin(result))
    if result.model is not None:
        document["mass"]["urdf"] = result.nominal.tree.total_mass
        document["mass"]["model"] = result.robot.tree.total_mass
        document["extension"] = _extension_document(result.model, parts)
    if order.yaml is not None:
        written.files[order.yaml] = model_yaml(document).encode("utf-8")
    return Summary(
        model=model,
        document=document,
        verdict=str(result.content["verdict"]),
        diff=written.diff,
        before=model_error(result.nominal, result.raw, tares),
        after=model_error(model.robot, result.table, tares),
        findings=new_findings(result.nominal, model.robot),
        files=written.to_disk(order),
        parts=tuple((part.name, part.belongs) for part in parts),
    )


def _newest_model(directory: Path) -> KnownModel | None:
    """Return the model of the newest result; None where there is no result or no model."""
    path = open_session(directory).newest_result("result.json")
    return None if path is None else model_of_result(read_result(path), path)


def _export_extension(directory: Path, order: ExportOrder, model: KnownModel) -> ExtensionSummary:
    """Write a model onto the session's URDF; nothing is fitted."""
    if order.yaml is not None or order.scale_masses:
        word = "--scale-masses" if order.yaml is None else "--yaml"
        raise UsageError(
            f"{word} is of a calibration, and the newest result was not made with this model",
            where=model.file,
            next_step=f"solve with it first: comcal solve {directory} --model {model.file}",
        )
    given = load_extended(directory, model)
    parts = parts_of(given.nominal, model.known)
    held = [part.known for part in parts if part.in_urdf]
    robot = extend(given.nominal, given.raw, held).robot
    written = _Written.of(given.nominal, robot, order, parts)
    return ExtensionSummary(
        robot=given.nominal.name,
        document={**model_json(model, given.extended), **_extension_document(model, parts)},
        parts=tuple((part.name, part.belongs) for part in parts),
        masses=(given.nominal.tree.total_mass, robot.tree.total_mass),
        diff=written.diff,
        before=model_error(given.nominal, given.raw),
        after=model_error(given.extended.robot, given.extended.table),
        findings=new_findings(given.nominal, robot),
        files=written.to_disk(order),
    )


def _against_urdf(model: CalibratedModel, nominal: Robot) -> CalibratedModel:
    """Count changes of links from the URDF, not from the model that the session was solved with."""
    links = tuple(
        replace(link, urdf_com=old.com, factor=link.mass / old.mass if old.mass else link.factor)
        for link, old in zip(model.links, nominal.tree.links, strict=True)
    )
    return replace(model, links=links)


def _extension_document(model: KnownModel, parts: tuple[Part, ...]) -> dict[str, Any]:
    return {
        "file": model.file,
        "sha256": model.sha256,
        "in_urdf": [part.name for part in parts if part.in_urdf],
        "elsewhere": {part.name: part.belongs for part in parts if not part.in_urdf},
    }


@dataclass(frozen=True)
class _Written:
    """New files, before any of them is written, and how the URDF differs from the old one."""

    files: dict[Path, bytes]
    diff: str

    @classmethod
    def of(
        cls, nominal: Robot, wanted: Robot, order: ExportOrder, parts: tuple[Part, ...]
    ) -> _Written:
        """Make the text of URDF, C and the rest of an extension."""
        path = nominal.urdf_path
        if path is None:
            raise UsageError("the robot has no URDF", where=str(nominal.yaml_path))
        old = path.read_bytes()
        new = written_urdf(old, path.name, nominal, wanted)
        files: dict[Path, bytes] = {}
        if order.urdf is not None:
            files[order.urdf] = new
        if order.c is not None:
            # Imported here: nobody who exports a URDF should wait for code generation.
            from comcal.workflow.export_c import export_c

            for name, text in export_c(wanted.tree, nominal.name).items():
                files[order.c / name] = text.encode("utf-8")
        if order.rest is not None:
            files[order.rest] = extension_text(rest_of(parts)).encode("utf-8")
        return cls(files, _diff(old, new, path.name, order.urdf))

    def to_disk(self, order: ExportOrder) -> tuple[Path, ...]:
        """Write all files, or none if one exists; return their paths."""
        _refuse_existing(self.files)
        if order.dry_run:
            return ()
        for path, content in self.files.items():
            path.parent.mkdir(parents=True, exist_ok=True)
            write_new(path, content)
        return tuple(self.files)


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
