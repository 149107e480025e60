# SPDX-License-Identifier: Apache-2.0
"""How the rows of a pose set move with every parameter, by the built-in simulated world.

Differences between two simulated robots, never the corrections that a diagnosis is made of: what is
held against the diagnosis must not come from it. The world is linear in forces and first moments,
so a payload is put together from a link's mass and CoM, and a tether from a cable.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from hidden_scenario import FILE, Pair, Stage, scenario, targets
from hidden_world import BUILTIN, RATE, Reading, record, table_of, with_readings

import comcal
import comcal_sims
from comcal.measure.plan import NONE
from comcal.measure.table import PoseTable
from comcal.predict.assumed import Assumed
from comcal.predict.parity import Parity, parity
from comcal.robot.changes import ALL, Change
from comcal.robot.changes_table import STIFFNESS
from comcal.robot.kinematics import place_links
from comcal_sims.adapter import EXACT, SensorAdapter
from comcal_sims.builtin_world import BuiltinWorld
from comcal_sims.climate import Climate
from comcal_sims.footing import base_in_world
from comcal_sims.sources import SLOT
from comcal_sims.world import World, WorldState

STEP = 0.05
"""Of the differences, in faults: large against what the world leaves of its iterations."""
MOTORS = ("joint_friction", "torque_constant", "current_offset")
READING = ("ft_bias", "ft_gain", "ft_crosstalk", "ft_drift", "ft_temperature", *MOTORS[1:])
"""Effects of the readings alone: the robot stands as it stood, and is read again."""
BY_LOAD = (
    *READING,
    "ft_mounting",
    "ft_position",
    "joint_friction",
    "joint_compliance",
    "backlash",
    "sole_compliance",
)
"""Effects that grow with the load of a foot or a joint."""
MUJOCO = "mujoco"
"""Shares the load of two feet otherwise than the other two."""
FORCE = ("force_x", "force_y", "force_z")
COM = ("com_x", "com_y", "com_z")

COUNTING = ("hidden_medians", "hidden_rates", "hidden_store", "hidden_table")

Columns = Mapping[Pair, np.ndarray]
"""By effect and target, shape (n_rows, n_keys), in the order of the keys of a fault."""


def nominal(stage: Stage, engine: str = BUILTIN) -> PoseTable:
    """Return exact readings of the robot as designed."""
    return table_of(stage, record(stage, (), engine=engine, noise=False))


def rows_of(stage: Stage, table: PoseTable) -> Parity:
    """Return the rows of readings against the robot as designed."""
    return parity(Assumed(stage.robot), table)


def keys_of(pair: Pair) -> tuple[str, ...]:
    """Return the keys along which an effect is a fault."""
    return tuple(scenario().fault(pair[0]))


def change_at(pair: Pair, coordinates: np.ndarray) -> Change:
    """Return the change with these parameters; a stiffness is given by its compliance."""
    values = dict(zip(keys_of(pair), coordinates.tolist(), strict=True))
    if "stiffness" in values:
        values["stiffness"] = 1.0 / values["stiffness"]
    return Change(*pair, {key: value for key, value in values.items() if value})


def _placed(stage: Stage, engine: str) -> Iterator[WorldState]:
    """Yield the states of the robot as designed."""
    if engine == MUJOCO:
        from comcal_sims.mujoco_world import MujocoWorld

        world: World = MujocoWorld(stage.robot)
    else:
        world = BuiltinWorld(stage.robot)
    for pose in stage.poses:
        world.place(pose)
        world.advance(1.0 / RATE)
        yield world.state()
    world.close()


class _Differences:
    """Differences of the built-in world about the robot as designed."""

    def __init__(self, stage: Stage, engine: str = BUILTIN) -> None:
        self._stage, self._engine = stage, engine
        self.table = nominal(stage, engine)
        self.rows = rows_of(stage, self.table)
        climate = {
            name.removeprefix("temperature_"): value
            for name, value in stage.options.items()
            if name.startswith("temperature_")
        }
        self._climate = Climate(**climate, first=SLOT * stage.poses[0].pose)
        self._motors: dict[tuple[str, int], np.ndarray] = {}
        self._states = list(_placed(stage, engine))

    def _moved(self, readings: list[Reading], step: float) -> np.ndarray:
        """Return a difference quotient; NaN in poses in which the robot did not stand."""
        stood = np.isin(self.table.pose, [pose.pose for pose, _ in readings])
        table = with_readings(self._stage.robot, self.table.select(stood), readings)
        found = np.full(len(self.rows.values), np.nan)
        here = stood[self.rows.pose]
        found[here] = (rows_of(self._stage, table).values - self.rows.values[here]) / step
        return found

    def world(self, pair: Pair, k: int) -> np.ndarray:
        """Return the column of one parameter, of a robot that is built and stands anew."""
        step, change = self._step(pair, k)
        return self._moved(record(self._stage, (change,), engine=self._engine, noise=False), step)

    def reading(self, pair: Pair, k: int) -> np.ndarray:
        """Return the column of one parameter of the sensors' electronics."""
        step, change = self._step(pair, k)
        adapter = SensorAdapter(self._stage.robot, EXACT, 0, (change,), self._climate)
        found = list[Reading]()
        for pose, state in zip(self._stage.poses, self._states, strict=True):
            adapter.begin(pose.pose)
            t = np.array([SLOT * pose.pose + 1.0 / RATE])
            found.append((pose, adapter.block(t, [state])))
        return self._moved(found, step)

    def motor(self, pair: Pair, k: int) -> np.ndarray:
        """Return the column of one parameter of one motor: only its own current tells of it."""
        effect, joint = pair
        if (effect, k) not in self._motors:
            every = (effect, ALL)
            column = self.reading if effect in READING else self.world
            self._motors[effect, k] = column(every, k)
        own = np.array([row.kind == "torque" and row.of == joint for row in self.rows.row])
        return np.where(own, self._motors[effect, k], 0.0)

    def column(self, pair: Pair, k: int) -> np.ndarray:
        """Return the column of one parameter."""
        if pair[0] in MOTORS:
            return self.motor(pair, k)
        return self.reading(pair, k) if pair[0] in READING else self.world(pair, k)

    @staticmethod
    def _step(pair: Pair, k: int) -> tuple[float, Change]:
        fault = np.array(list(scenario().fault(pair[0]).values()))
        at = np.zeros_like(fault)
        at[k] = STEP * fault[k]
        return float(at[k]), change_at(pair, at)


def columns(stage: Stage) -> dict[Pair, np.ndarray]:
    """Return the columns of every effect that is hidden singly, and of every healthy spread."""
    d, robot = _Differences(stage), stage.robot
    made = ("payload", "tether", "external_contact")
    found = _filled(stage, d, [e for e in scenario().single_effects() if e not in made])
    for link in robot.tree.links:
        mass, com = found["link_mass", link.name], found["link_com", link.name]
        moments = com / link.mass
        found["payload", link.name] = np.hstack([mass - moments @ link.com[:, None], moments])
    found.update(_held(stage, d, found))
    return found


def columns_by_load(stage: Stage, engine: str) -> dict[Pair, np.ndarray]:
    """Return the columns of effects that depend on how two feet share the load in an engine."""
    return _filled(stage, _Differences(stage, engine), BY_LOAD)


def _filled(stage: Stage, d: _Differences, effects: Iterable[str]) -> dict[Pair, np.ndarray]:
    robot, found = stage.robot, dict[Pair, np.ndarray]()
    for effect in effects:
        for target in targets(robot, effect):
            pair = (effect, target)
            if target == ALL:
                joints = [found[effect, other] for other in targets(robot, effect) if other != ALL]
                found[pair] = np.sum(joints, axis=0)
            else:
                n = len(keys_of(pair))
                found[pair] = np.column_stack([d.column(pair, k) for k in range(n)])
    return found


def _held(stage: Stage, d: _Differences, found: Columns) -> Iterator[tuple[Pair, np.ndarray]]:
    """Yield the columns of tethers and contacts, from those of cables at the same links."""
    hangs = np.array([s == NONE for s in d.table.support])[d.rows.pose]
    held = [pose for pose in stage.poses if pose.support == NONE]
    hanging = Stage(stage.robot, tuple(held), stage.options)
    contact = _Differences(hanging) if held else None
    for k, link in enumerate(stage.robot.tree.links):
        if ("cable_pull", link.name) not in found:  # its origin is that of another link
            continue
        cable = found["cable_pull", link.name]
        way = _ways(stage, k)[d.rows.pose]
        first, second = np.array([["xyz".index(c) for c in key[2:]] for key in STIFFNESS]).T
        both = cable[:, first] * way[:, second] + cable[:, second] * way[:, first]
        both[:, first == second] /= 2.0
        yield ("tether", link.name), np.hstack([cable, -both])
        touched = cable.copy()
        if contact is not None:
            pair = ("external_contact", link.name)
            touched[hangs] = np.column_stack([contact.world(pair, i) for i in range(3)])
        yield ("external_contact", link.name), touched


def _ways(stage: Stage, k: int) -> np.ndarray:
    """Return where a link is against the first pose, in axes of the floor, shape (N, 3) [m]."""
    places = list[np.ndarray]()
    for pose in stage.poses:
        T = base_in_world(stage.robot, pose)
        at = place_links(stage.robot.tree, pose.q)
        p = at.p[0, k]
        places.append(T[:3, :3] @ p + T[:3, 3] if pose.support != NONE else np.full(3, np.nan))
    ways = np.array(places) - places[0]
    return np.nan_to_num(ways)


def source_hash(*roots: Path) -> str:
    """Return one SHA-256 of all Python files below some folders, or of single files."""
    whole = hashlib.sha256()
    for root in roots:
        for file in sorted(root.rglob("*.py")) if root.is_dir() else [root]:
            whole.update(file.name.encode() + hashlib.sha256(file.read_bytes()).digest())
    return whole.hexdigest()


def code_hash() -> str:
    """Return the hash of the sources that are under test."""
    return source_hash(_folder(comcal))


def generator_hash() -> str:
    """Return the hash of what makes the data and the records: simulators, scenario, this study.

    What counts the records and prints the rates may change while a study is going on.
    """
    mine = [f for f in Path(__file__).parent.glob("hidden_*.py") if f.stem not in COUNTING]
    return source_hash(_folder(comcal_sims), FILE, *sorted(mine))


def _folder(package: object) -> Path:
    return Path(str(getattr(package, "__file__"))).parent  # noqa: B009


@cache
def cached_columns(name: str, engine: str = BUILTIN) -> tuple[Parity, dict[Pair, np.ndarray]]:
    """Return nominal rows and columns of a pose set, from the temporary folder once made.

    Parameters
    ----------
    name : str
        Of the pose set.
    engine : str
        In which the robot stands; pybullet shares loads as the built-in world does.
    """
    stage = scenario().stage(name)
    rows = rows_of(stage, nominal(stage))
    found = _kept(f"{name}-{BUILTIN}", lambda: columns(stage))
    if engine == MUJOCO:
        own = _kept(f"{name}-{engine}", lambda: columns_by_load(stage, engine))
        # A robot that falls over its own small change tells nothing: plain statics do.
        own = {pair: np.where(np.isnan(c), found[pair], c) for pair, c in own.items()}
        found = found | own
    return rows, found


def _kept(name: str, make: Callable[[], dict[Pair, np.ndarray]]) -> dict[Pair, np.ndarray]:
    file = Path(tempfile.gettempdir()) / f"comcal-hidden-{_columns_hash()}-{name}.npz"
    if file.exists():
        with np.load(file) as kept:
            return {tuple(entry.split("@")): kept[entry] for entry in kept.files}
    found = make()
    beside = file.with_name(f".{file.name}.{os.getpid()}")
    with beside.open("wb") as stream:
        named: dict[str, Any] = {"@".join(pair): column for pair, column in found.items()}
        np.savez(stream, **named)
    beside.replace(file)
    return found


@cache
def _columns_hash() -> str:
    """Return the hash of all that columns depend on."""
    package, here = _folder(comcal), Path(__file__).parent
    parts = [package / part for part in ("robot", "measure", "statics", "predict")]
    files = [here / f"hidden_{part}.py" for part in ("columns", "scenario", "world")]
    faults = repr(
        {effect: dict(scenario().fault(effect)) for effect in scenario().single_effects()}
    )
    known = source_hash(_folder(comcal_sims), FILE, *files, *parts) + faults + version("numpy")
    return hashlib.sha256(known.encode()).hexdigest()[:16]
