# SPDX-License-Identifier: Apache-2.0
"""Generated robots, and pose tables of them measured in the built-in world."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from comcal.measure.plan import PlannedPose
from comcal.measure.plan_csv import read_plan
from comcal.measure.table import PoseTable
from comcal.robot.description import load_robot
from comcal.robot.model import Robot
from comcal_sims.builtin_world import BuiltinWorld
from comcal_sims.robots import biped14 as biped14_robot
from comcal_sims.robots import table1 as table1_robot
from comcal_sims.world import World

FORCE, MOMENT, ENCODER = 0.1, 0.01, np.deg2rad(0.02)
"""Realistic errors of a pose mean [N, N m, rad]."""
TORQUE, IMU = 0.3, 0.005
"""The same of torques [N m] and the IMU [m/s^2]."""


@dataclass(frozen=True)
class Bench:
    """A robot with its plan, and the means to measure it."""

    robot: Robot
    plan: tuple[PlannedPose, ...]

    def pose(self, **angles: float) -> np.ndarray:
        """A joint vector by names."""
        return np.array([angles.get(name, 0.0) for name in self.robot.tree.joint_names])

    def measure(
        self,
        plan: Sequence[PlannedPose] | None = None,
        true_robot: Robot | None = None,
        world: World | None = None,
    ) -> PoseTable:
        """Measure *plan* (default: the shipped one) without errors, in the built-in world."""
        world = world or BuiltinWorld(true_robot or self.robot)
        return measured(self.robot, self.plan if plan is None else plan, world)

    def noisy(self, table: PoseTable, rng: np.random.Generator) -> PoseTable:
        """The same poses as they would have been measured with realistic errors."""
        sigma = np.array([FORCE] * 3 + [MOMENT] * 3)
        return replace(
            table,
            q=table.q + ENCODER * rng.standard_normal(table.q.shape),
            wrench={s: w + sigma * rng.standard_normal(w.shape) for s, w in table.wrench.items()},
            torque=table.torque + TORQUE * rng.standard_normal(table.torque.shape),
            imu=table.imu + IMU * rng.standard_normal(table.imu.shape),
        )


def measured(robot: Robot, plan: Sequence[PlannedPose], world: World) -> PoseTable:
    states = []
    for pose in plan:
        world.place(pose)
        states.append(world.state())
    q = np.array([state.q for state in states])
    wrench = {s: np.array([state.wrenches[s] for state in states]) for s in robot.sensors}
    n, m = q.shape
    sigma = np.array([FORCE] * 3 + [MOMENT] * 3)
    nan, nan3 = np.full((n, m), np.nan), np.full((n, 3), np.nan)
    return PoseTable(
        pose=tuple(p.pose for p in plan),
        support=tuple(p.support for p in plan),
        q=q,
        q_cov=np.full((n, m), ENCODER**2),
        wrench=wrench,
        wrench_cov={s: np.tile(np.diag(sigma**2), (n, 1, 1)) for s in wrench},
        torque=np.array([state.torques for state in states]),
        torque_var=np.full((n, m), TORQUE**2),
        current=nan,
        current_var=nan,
        com=nan3,
        com_var=nan3,
        imu=np.array([np.full(3, np.nan) if s.imu is None else s.imu for s in states]),
        imu_var=np.full((n, 3), IMU**2),
        configuration=tuple(p.configuration for p in plan),
        tilt=np.array([np.nan if p.tilt is None else p.tilt for p in plan]),
    )


def _bench(generate: Callable[..., Path], directory: Path, **parameters: object) -> Bench:
    path = generate(directory, **parameters)
    robot = load_robot(path)
    return Bench(robot, read_plan(path.parent / "plan.csv", robot.tree.joint_names))


@pytest.fixture(scope="session")
def table1(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    """The robot of Muscolo 2017, Table 1."""
    return _bench(table1_robot.generate, tmp_path_factory.mktemp("table1"))


@pytest.fixture(scope="session")
def skewed(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    """Table 1 with CoMs off the link axes (r != 0), where sign errors show."""
    return _bench(table1_robot.generate, tmp_path_factory.mktemp("skewed"), r_b=0.01, r_c=-0.02)


@pytest.fixture(scope="session")
def table1_roll(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    """Table 1 with roll joints."""
    return _bench(table1_robot.generate, tmp_path_factory.mktemp("roll"), roll_joints=True)


@pytest.fixture(scope="session")
def biped14(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    """The 64 kg biped with 14 joints."""
    return _bench(biped14_robot.generate, tmp_path_factory.mktemp("biped14"))


@pytest.fixture(scope="session")
def odd() -> Iterator[ModuleType]:
    """Awkward robots and what their sensors read: ``tests/oracles/odd_robots.py``."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(Path(__file__).resolve().parent.parent / "oracles"))
        yield importlib.import_module("odd_robots")
