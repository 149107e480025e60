# SPDX-License-Identifier: Apache-2.0
"""The physics simulation once more, at the measured poses: as the model was given, and extended.

The simulated robot is sent to the measured encoder readings, sensors without errors. Bodies,
lengths, encoders, springs, soles, floor and what pulls at the robot are in the engine's physics.
Errors of readings alone (offsets, gains, drifts, currents, wiring) are taken out of the measured
readings instead: put into the simulated ones they would cancel, and drifts know another clock.

Compared is what statics determines: the sum of what the feet carry, about P, and the torques of
joints that hold the same however two feet share the load. Both tables are understood by the same
model, so that a wrong angle in one leg does not make the sum depend on that share either.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from comcal.effects.readings import arrivals
from comcal.effects.registry import corrected
from comcal.errors import NotBalancedError, RankError, UsageError
from comcal.measure.plan import NONE, PlannedPose
from comcal.measure.source import Block, SourceRequest
from comcal.measure.table import PoseTable
from comcal.predict.assumed import Assumed
from comcal.report.rerun import RerunGain
from comcal.robot.changes import Change, check_changes, spec_of
from comcal.robot.changes_kinds import Realisation
from comcal.robot.changes_text import change_text
from comcal.robot.model import Robot, Sense
from comcal.robot.tree import Array
from comcal.workflow.rerun_errors import Understood, measure_gain
from comcal.workflow.sources import open_source

ENGINES = ("pybullet", "mujoco", "builtin")
"""Sources that simulate: nothing real is ever moved here."""
WINDOW = 0.1
"""Seconds that are averaged once the simulated robot has settled."""
_PHYSICAL = (Realisation.ENGINE, Realisation.SENSOR_FRAME)
_READ_TOO_EARLY = "not_settled"
_PLACEMENT, _IN_PLANE = "foot_placement", {"x", "y", "yaw"}


def rerun(
    robot: Robot,
    table: PoseTable,
    source: str,
    changes: Sequence[Change] = (),
    seed: int = 0,
    *,
    chosen: npt.ArrayLike | None = None,
) -> PoseTable:
    """Simulate measured poses, without noise.

    Parameters
    ----------
    robot : Robot
        The nominal one; its URDF is what the engine builds.
    table : PoseTable
        All poses of the session, as the encoders read them.
    source : str
        One of :data:`ENGINES`.
    changes : sequence of Change
        What is true besides; errors of readings alone are left out.
    seed : int
        Master seed of the source.
    chosen : array of int or of bool, optional
        Rows to simulate; by default all. Hanging poses are left out: nothing says how they hang.

    Returns
    -------
    PoseTable
        Readings of the simulated sensors in the poses in which the simulated robot stands. Its
        encoders read what was commanded, which is ``table.q``; legs that do not close there give
        by what is missing.

    Raises
    ------
    UsageError
        If there is no such engine, or the changes are not valid for this robot.
    MissingExtraError
        If the engine is not installed.
    RankError
        If the simulated robot stands in none of the poses.
    """
    check_engine(source)
    check_changes(changes, robot, "--rerun")
    plan = _plan(robot, table)
    every = np.arange(len(table))
    rows = every if chosen is None else every[np.asarray(chosen)]
    rows = [int(i) for i in rows if table.support[i] != NONE]
    request = SourceRequest(
        robot=_with_room(robot, table.q),
        seed=seed,
        effects=tuple(change_text(change) for change in physical(changes)),
        noise=False,
        options=robot.sources.get(source),
        plan=plan,
    )
    found: list[tuple[int, Block]] = []
    refused: list[str] = []
    with open_source(source, request) as engine:
        name = engine.name
        for i in rows:
            try:
                engine.move_to(plan[i])
            except (NotBalancedError, UsageError) as problem:
                refused.append(f"{name} cannot stand there: {problem}")
                continue
            found.append((i, engine.read(WINDOW)))
    if not found:
        raise RankError(
            f"{name} stands in none of the poses",
            where="--rerun",
            measured=refused[0] if refused else "no pose stands",
            next_step="record poses with support 'double' or one foot",
        )
    simulated = table.select([i for i, _ in found])
    blocks = [block for _, block in found]
    return replace(
        _with_readings(robot, simulated, blocks),
        approach=arrivals(table)[[i for i, _ in found]],
        notes=(name, *refused),
        shared={},
    )


def rerun_gain(
    robot: Robot,
    table: PoseTable,
    source: str,
    changes: Sequence[Change],
    rng: np.random.Generator,
    *,
    given: Sequence[Change] = (),
    chosen: npt.ArrayLike | None = None,
    seed: int = 0,
) -> RerunGain:
    """Simulate poses with a model as given and as extended, and compare both with the readings.

    Parameters
    ----------
    robot, table, source
        As of :func:`rerun`.
    changes : sequence of Change
        What was found, on top of *given*.
    rng : numpy.random.Generator
        For the bootstrap over poses.
    given : sequence of Change
        The model that was diagnosed; by default the nominal robot.
    chosen : array of int or of bool, optional
        Rows to compare, best those that took no part in finding *changes*.
    seed : int
        Master seed of the source.

    Raises
    ------
    UsageError, MissingExtraError, RankError
        As of :func:`rerun`; RankError if the engine measures nothing that was measured, too.
    """
    models = {"given": tuple(given), "extended": (*given, *changes)}
    every = np.arange(len(table))
    rows = every if chosen is None else every[np.asarray(chosen)]
    simulated = {
        name: rerun(robot, table, source, model, seed, chosen=rows)
        for name, model in models.items()
    }
    both = set.intersection(*(set(part.pose) for part in simulated.values()))
    poses = [pose for pose in simulated["given"].pose if pose in both]
    if not poses:
        raise RankError(
            "the simulated robot stands in no pose both as given and as extended",
            where="--rerun",
            next_step="record poses that are further from falling over",
        )
    pairs = [
        _understood(robot, table, part, models[name], poses) for name, part in simulated.items()
    ]
    notes = [f"left out of the simulation: {name}" for name in _not_simulated(models["extended"])]
    standing = sum(table.support[int(i)] != NONE for i in rows)
    if len(poses) < standing:
        refusals = [note for part in simulated.values() for note in part.notes[1:]]
        notes.append(f"{standing - len(poses)} of {standing} poses not simulated: {refusals[0]}")
    return measure_gain(pairs[0], pairs[1], simulated["given"].notes[0], tuple(notes), rng)


def check_engine(source: str) -> None:
    """Make sure that a source can run models again.

    Raises
    ------
    UsageError
        If it is none of :data:`ENGINES`.
    """
    if source not in ENGINES:
        raise UsageError(
            f"{source!r} does not simulate",
            where="--rerun",
            next_step=f"give one of {', '.join(ENGINES)}",
        )


def physical(changes: Sequence[Change]) -> tuple[Change, ...]:
    """Return the changes that a physics engine is given: all but errors of readings alone."""
    return tuple(
        change
        for change in where_encoders_stand(changes)
        if spec_of(change.effect).realisation in _PHYSICAL and change.effect != _READ_TOO_EARLY
    )


def where_encoders_stand(changes: Sequence[Change]) -> tuple[Change, ...]:
    """Return the changes of a robot that is sent where its encoders stood.

    Where in the plane of the floor a foot stands is what they read: shifted once more, it would
    stand elsewhere.
    """
    found = list[Change]()
    for change in changes:
        if change.effect == _PLACEMENT:
            kept = {k: v for k, v in change.parameters.items() if k not in _IN_PLANE}
            if kept:
                found.append(replace(change, parameters=kept))
        else:
            found.append(change)
    return tuple(found)


def _not_simulated(changes: Sequence[Change]) -> Iterator[str]:
    """Yield the effects that no simulator can have, nor any reading be freed of."""
    for change in changes:
        if spec_of(change.effect).realisation is Realisation.NONE:
            yield change.effect


def _understood(
    robot: Robot,
    table: PoseTable,
    simulated: PoseTable,
    changes: Sequence[Change],
    poses: Sequence[int],
) -> Understood:
    """Return measured and simulated readings of some poses as one model understands them."""
    assumed, measured = corrected(Assumed(robot), table, changes)
    _, predicted = corrected(Assumed(robot), simulated, physical(changes))
    row = {pose: i for i, pose in enumerate(table.pose)}
    simulated_row = {pose: i for i, pose in enumerate(simulated.pose)}
    part = table.select([row[pose] for pose in poses])
    gap = np.abs(simulated.q[[simulated_row[pose] for pose in poses]] - part.q)
    return Understood(
        assumed=assumed,
        measured=measured.select([row[pose] for pose in poses]),
        simulated=predicted.select([simulated_row[pose] for pose in poses]),
        angle_gap=float(gap.max(initial=0.0)),
    )


def _plan(robot: Robot, table: PoseTable) -> tuple[PlannedPose, ...]:
    """Return the measured poses as ones to be commanded."""
    came = np.nan_to_num(arrivals(table))
    names = robot.tree.joint_names
    return tuple(
        PlannedPose(
            pose=pose,
            q=table.q[i],
            support=table.support[i],
            approach={name: int(side) for name, side in zip(names, came[i], strict=True)},
        )
        for i, pose in enumerate(table.pose)
    )


def _with_room(robot: Robot, q: Array) -> Robot:
    """Widen joint limits to what the encoders read: a reading is no command to be refused."""
    low = dict(zip(robot.tree.joint_names, q.min(axis=0), strict=True))
    high = dict(zip(robot.tree.joint_names, q.max(axis=0), strict=True))
    joints = tuple(
        replace(
            joint,
            lower=min(joint.lower, float(low[joint.name])),
            upper=max(joint.upper, float(high[joint.name])),
        )
        if joint.name in low
        else joint
        for joint in robot.tree.joints
    )
    return replace(robot, tree=replace(robot.tree, joints=joints))


def _with_readings(robot: Robot, table: PoseTable, blocks: Sequence[Block]) -> PoseTable:
    """Return *table* with the means of simulated windows in the place of what was measured."""

    def means(parts: Sequence[Array | None], like: Array) -> Array:
        known = [np.full(like.shape[1], np.nan) if p is None else p.mean(axis=0) for p in parts]
        return np.array(known, np.float64)

    wrench = {name: np.full((len(table), 6), np.nan) for name in table.wrench}
    for name, sensor in robot.sensors.items():
        sign = 1.0 if sensor.sense is Sense.ON_ROBOT else -1.0
        if name in wrench and all(name in block.wrenches for block in blocks):
            wrench[name] = sign * np.array([b.wrenches[name].mean(axis=0) for b in blocks])
    return replace(
        table,
        q=np.array([block.q.mean(axis=0) for block in blocks]),
        wrench=wrench,
        torque=means([block.torques for block in blocks], table.torque),
        current=means([block.currents for block in blocks], table.current),
        imu=means([block.imu for block in blocks], table.imu),
        motion={},
    )
