# SPDX-License-Identifier: Apache-2.0
"""``comcal diagnose``: a session folder in, what its model gets wrong and an extended model out."""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from comcal.diagnose.diagnose import diagnose
from comcal.diagnose.diagnosis import Diagnosis
from comcal.effects.registry import corrected, effects
from comcal.errors import UsageError
from comcal.measure.files import sha256_of, write_atomically
from comcal.measure.session import Session
from comcal.predict.assumed import Assumed
from comcal.report.diagnosis_html.page import PageSubject, diagnosis_page
from comcal.report.diagnosis_html.raw import raw_channels
from comcal.report.diagnosis_json import diagnosis_json
from comcal.report.rerun import RerunGain, rerun_json
from comcal.robot.changes import check_changes
from comcal.robot.changes_yaml import KnownChange, read_extension
from comcal.robot.effect_specs import effect_specs
from comcal.robot.validate import did_you_mean
from comcal.workflow.calibrate import input_hashes, load_session, without_poses
from comcal.workflow.diagnosed_model import extended_text
from comcal.workflow.rerun import check_engine, rerun_gain


@dataclass(frozen=True)
class Diagnosed:
    """A diagnosis and where its files lie.

    Parameters
    ----------
    files : tuple of Path
        Written files, ``diagnosis.json`` first.
    rerun : RerunGain or None
        The physics repeated with the model as given and as extended, if that was asked for.
    """

    session: Session
    diagnosis: Diagnosis
    files: tuple[Path, ...]
    rerun: RerunGain | None = None


def diagnose_session(
    directory: Path,
    *,
    model: Path | None = None,
    causes: Sequence[str] = (),
    drop: Sequence[int] = (),
    engine: str | None = None,
    seed: int = 0,
) -> Diagnosed:
    """Diagnose a session; write ``results/NNN`` with JSON, extended model, page and poses.

    Parameters
    ----------
    directory : Path
    model : Path, optional
        ``extended.yaml`` of the model that is assumed; by default the session's robot as it is.
    causes : sequence of str
        Effects to look for; by default the whole catalogue.
    drop : sequence of int
        Pose ids to leave out.
    engine : str, optional
        Simulated source in which the model as given and as extended are run again at the measured
        poses.
    seed : int
        Of that source, and of the bootstrap over poses.

    Returns
    -------
    Diagnosed

    Raises
    ------
    UsageError, ConfigError, DataError
        As of :func:`~comcal.workflow.calibrate.load_session`; if there is no such cause or
        engine, or the model does not fit the robot. Nothing is written then.
    """
    for name in causes:
        _check_cause(name)
    if engine is not None:
        check_engine(engine)
    session, robot, table = load_session(directory, doubtful=True)
    if not robot.tree.geometry_known:
        raise UsageError(
            "this session is of a chain without URDF, which has no model to diagnose",
            where=str(session.robot_yaml),
            next_step="give robot.yaml a `urdf:`",
        )
    hashes = input_hashes(session, robot)
    given: tuple[KnownChange, ...] = ()
    assumed, readings = Assumed(robot), table
    if model is not None:
        given = read_extension(model)
        changes = [known.change for known in given]
        check_changes(changes, robot, str(model))
        # With all poses: what drifts, or is anchored, counts from the first of them.
        assumed, readings = corrected(assumed, table, changes)
        hashes[f"--model {model.name}"] = sha256_of(model)
    readings = without_poses(readings, drop, session)
    # With few causes to choose from, tolerances that are learnt would swallow all the others.
    found = diagnose(assumed, readings, causes=tuple(causes) or None, learn=not causes)
    found = replace(found, notes=tuple(dict.fromkeys((*table.notes, *found.notes))))
    again = None
    if engine is not None and found.changes:
        again = rerun_gain(
            robot,
            without_poses(table, drop, session),
            engine,
            found.changes,
            np.random.default_rng(seed),
            given=[known.change for known in given],
            seed=seed,
        )
    subject = PageSubject(
        title=session.directory.resolve().name,
        diagnosis=found,
        raw=raw_channels(without_poses(table, drop, session)),
        facts=(("robot", robot.name),),
        made_from=hashes,
    )
    files = _write(session, subject, given, robot.name, again)
    return Diagnosed(session, found, files, again)


def _check_cause(name: str) -> None:
    sought = [effect.name for effect in effects().values() if effect.fault]
    if name in sought:
        return
    if name in effects():
        raise UsageError(
            f"{name} is a mistake of wiring or configuration, which is not searched for by size",
            where="--causes",
            next_step="leave out --causes: then every such mistake is tried first",
        )
    if name in effect_specs():
        raise UsageError(
            f"{name} is always looked for, whatever the causes",
            where="--causes",
            next_step="leave it out of --causes",
        )
    raise UsageError(
        f"there is no cause {name!r}",
        where="--causes",
        next_step=did_you_mean(name, sought) or f"there are {', '.join(sought)}",
    )


def _write(
    session: Session,
    subject: PageSubject,
    given: Sequence[KnownChange],
    robot: str,
    again: RerunGain | None,
) -> tuple[Path, ...]:
    """Write all files of a diagnosis into a new folder, and publish it when it is complete."""
    content = diagnosis_json(subject.diagnosis, subject.made_from, robot)
    if again is not None:
        content["rerun"] = rerun_json(again)
    # Everything is text before the first file is made: a fault leaves no half-filled folder.
    texts = {
        "extended.yaml": extended_text(given, subject.diagnosis),
        "report.html": diagnosis_page(subject),
        "diagnosis.json": json.dumps(content, indent=1, allow_nan=False) + "\n",
    }
    folder = session.new_result_folder()
    used = folder / "used.csv"
    shutil.copyfile(session.poses_csv, used)
    for name, text in texts.items():
        write_atomically(folder / name, text.encode("utf-8"))
    session.publish_result(folder)
    return (*(folder / name for name in reversed(texts)), used)
