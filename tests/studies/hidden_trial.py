# SPDX-License-Identifier: Apache-2.0
"""One trial: a robot hides something, is recorded and diagnosed; what was said goes to a record."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any
from zlib import crc32

import numpy as np
from hidden_columns import rows_of
from hidden_judge import as_recorded, same_change, values_of
from hidden_lines import LINES, Case, an_engine
from hidden_ruler import ruler
from hidden_scenario import scenario
from hidden_world import hidden_table, record, table_of, without_currents

from comcal.diagnose.diagnose import diagnose
from comcal.diagnose.diagnosis import Diagnosis
from comcal.errors import ComcalError, NotBalancedError, UsageError
from comcal.measure.table import PoseTable
from comcal.predict.assumed import Assumed
from comcal.robot.changes import Change
from comcal.robot.changes_table import EFFECTS
from comcal.robot.changes_text import change_text
from comcal.robot.healthy import draw_healthy
from comcal.workflow.rerun import where_encoders_stand

Record = dict[str, Any]
AGAIN_SEED = 1


def generator(master: int, line: str, index: int) -> np.random.Generator:
    """Return the generator of one trial, whatever was drawn before."""
    return np.random.default_rng([master, crc32(line.encode()), index])


def run_trial(line: str, master: int, index: int, engine: str = "") -> Record:
    """Draw, record, diagnose and note what was said.

    Parameters
    ----------
    line : str
        One of :data:`hidden_lines.LINES`.
    master, index : int
        Seed of the study and number of the trial.
    engine : str
        Empty: drawn.

    Returns
    -------
    dict
        Ready for JSON. A robot that could not be recorded has ``refused`` instead of a verdict.
    """
    rng = generator(master, line, index)
    drawn = an_engine(rng)
    found: Record = {"line": line, "master": master, "index": index}
    try:
        case = LINES[line](rng, engine or drawn)
    except (ComcalError, LookupError, ArithmeticError, ValueError) as failure:
        # Such as a robot that falls with it in every pose: told, and no reason to end the study.
        return {**found, "refused": f"not drawn: {type(failure).__name__}: {failure}"}
    found |= {"engine": case.engine, "poses": case.poses, "note": case.note, "truth": _truth(case)}
    robot = scenario().robot
    changes = (*draw_healthy(robot, rng), *(() if case.published else case.hidden))
    seed = int(rng.integers(2**31))
    stage, samples = scenario().stage(case.poses), scenario().samples
    try:
        table = hidden_table(stage, changes, samples, engine=case.engine, seed=seed)
    except (NotBalancedError, UsageError) as refusal:
        return {**found, "refused": str(refusal)}
    if not case.currents:
        table = without_currents(table)
    found["fell"] = len(stage.poses) - len(table)
    seen = _recorded(case, table)
    if case.hidden and not seen.hidden:
        return {**found, "refused": "the robot stood in none of the poses that hide anything"}
    found["truth"] = truth = _truth(seen)
    began = time.process_time()
    try:
        said = diagnose(_assumed(case), table)
    except (ComcalError, ArithmeticError, ValueError, KeyError, IndexError) as failure:
        return {**found, "crashed": f"{type(failure).__name__}: {failure}"}
    found["cpu"] = time.process_time() - began
    found |= _said(said)
    found["named"] = [_cause(said, i, seen.hidden, changes) for i in range(len(said.causes))]
    for entry, change in zip(truth, seen.hidden, strict=True):
        entry["found"] = [
            *(c.name for c in said.causes if same_change(change, c.change)),
            *(f.effect for f in said.findings if same_change(change, f.change)),
        ]
    if case.again:
        found["again"] = _again(case, changes, said, seed + AGAIN_SEED)
    return found


def _assumed(case: Case) -> Assumed:
    return Assumed(case.assumed, internal_torque=1.0 if case.published else 0.0)


def _recorded(case: Case, table: PoseTable) -> Case:
    """Return the case with what was hidden in poses that are in the table."""
    hidden = [as_recorded(change, table.pose) for change in case.hidden]
    sizes = [size for size, change in zip(case.sizes, hidden, strict=False) if change is not None]
    seen = tuple(change for change in hidden if change is not None)
    return replace(case, hidden=seen, sizes=tuple(sizes))


def _truth(case: Case) -> list[Record]:
    return [_hidden(case, k) for k in range(len(case.hidden))]


def _hidden(case: Case, k: int) -> Record:
    change = case.hidden[k]
    entry: Record = {"name": change.name, "change": change_text(change)}
    entry["realisation"] = EFFECTS[change.effect].realisation.value
    if k < len(case.sizes):
        size = case.sizes[k]
        entry |= {"s": size.s, "d": size.d, "rival": "@".join(size.rival)}
    return entry


def _said(said: Diagnosis) -> Record:
    place = said.place
    return {
        "verdict": said.verdict.value,
        "sentence": said.sentence,
        "groups": [[rival.name for rival in group] for group in said.groups],
        "findings": [
            {"effect": f.effect, "target": f.target, "poses": list(f.poses)} for f in said.findings
        ],
        "place": None if place is None else [place.place, place.target, place.function],
        "p": [said.misfit.p_before, said.misfit.chance],
        "chi2": [said.misfit.chi2_before, said.misfit.chi2, said.misfit.dof],
        "scales": {family: float(scale) for family, scale in said.scales.items()},
        "advice": list(said.would_decide),
    }


def _cause(
    said: Diagnosis, i: int, hidden: Sequence[Change], changes: Sequence[Change]
) -> Mapping[str, Any]:
    cause = said.causes[i]
    gain = cause.gain
    return {
        "name": cause.name,
        "change": change_text(cause.change),
        "size": float(cause.size),
        "log_odds": float(min(cause.log_odds, 1e9)),
        "gain": None if gain is None else [float(end) for end in gain.interval],
        "outside": list(cause.outside),
        "values": values_of(cause, hidden, changes),
    }


def _again(case: Case, changes: Sequence[Change], said: Diagnosis, seed: int) -> float | None:
    """Return how far new readings are from the extended model run again in pybullet.

    Whitened root mean square of the rows of poses that the diagnosis never saw, the extended model
    standing where the encoders said that the robot stood. None where it could not stand there.
    """
    stage = scenario().stage(case.again)
    try:
        new = hidden_table(stage, changes, scenario().samples, engine=case.engine, seed=seed)
        at = {pose: q for pose, q in zip(new.pose, new.q, strict=True)}
        poses = [replace(p, q=_within(at[p.pose])) for p in stage.poses if p.pose in at]
        there = replace(stage, poses=tuple(poses))
        engine = case.engine if case.engine == "mujoco" else "pybullet"
        known = where_encoders_stand(said.changes)
        run = table_of(there, record(there, known, engine=engine, noise=False))
    except (NotBalancedError, UsageError):
        return None
    return _distance(case, new, run)


def _within(q: np.ndarray) -> np.ndarray:
    tree = scenario().robot.tree
    joints = [tree.joints[tree.joint_index[name]] for name in tree.joint_names]
    return np.clip(q, [j.lower for j in joints], [j.upper for j in joints])


def _distance(case: Case, one: PoseTable, other: PoseTable) -> float:
    measure = ruler(case.again, case.engine)
    both = [pose for pose in one.pose if pose in other.pose]
    parts = [
        rows_of(measure.stage, t.select([t.pose.index(pose) for pose in both]))
        for t in (one, other)
    ]
    z = measure.whitened_of(parts[0].values - parts[1].values, tuple(both))
    return float(np.sqrt(np.mean(z**2)))
