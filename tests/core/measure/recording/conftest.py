# SPDX-License-Identifier: Apache-2.0
"""The Table 1 robot standing on two level feet, measured by a source whose motion tests choose."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from comcal.measure.plan import PlannedPose
from comcal.measure.plan_csv import read_plan
from comcal.measure.source import Block
from comcal.robot.description import load_robot
from comcal.robot.model import Robot
from comcal_sims.robots.table1 import generate

WEIGHT = 18.6 * 9.81
Sway = Callable[[np.ndarray], np.ndarray]


class FakeRobot:
    """Source and commander at once: half the weight on each foot, the CoP moved by ``sway``.

    Parameters
    ----------
    robot : Robot
    noise : float
        Force noise of a sample [N]; a tenth of it is the moment noise [N m].
    seed : int
    rate : float
        Samples per second.
    """

    name = "fake 1.0"

    def __init__(
        self, robot: Robot, noise: float = 0.5, seed: int = 0, rate: float = 125.0
    ) -> None:
        self.robot = robot
        self.rate = rate
        self.noise = noise
        self.seed = seed
        self.sway: Sway = np.zeros_like
        self.unstill: set[int] = set()
        self.absent: set[int] = set()
        self.moves: list[int] = []
        self.on_read: Callable[[], None] = lambda: None
        self.t = 0.0

    def move_to(self, pose: PlannedPose) -> None:
        self.pose = pose
        self.moves.append(pose.pose)
        self.t = 60.0 * pose.pose
        self.rng = np.random.default_rng([self.seed, pose.pose])

    def read(self, duration: float) -> Block:
        self.on_read()
        n = round(duration * self.rate)
        t = self.t + np.arange(1, n + 1) / self.rate
        self.t = float(t[-1])
        shift = self.sway(t)
        if self.pose.pose in self.unstill:
            shift = shift + 0.01 * np.sin(2 * np.pi * 3.0 * t)
        q = np.tile(self.pose.q, (n, 1)) + (0.5 if self.pose.pose in self.absent else 0.0)
        wrenches = {}
        for name in self.robot.sensors:
            w = np.zeros((n, 6))
            w[:, 2] = WEIGHT / 2
            w[:, 4] = -shift * WEIGHT / 2
            noise = self.rng.standard_normal((n, 6)) * np.repeat([1.0, 0.1], 3)
            wrenches[name] = w + self.noise * noise
        return Block(t, q, wrenches, currents=q * 0.1)

    def close(self) -> None:
        self.t = np.nan


@pytest.fixture(scope="session")
def robot_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("table1")
    generate(folder)
    return folder


@pytest.fixture(scope="session")
def robot(robot_folder: Path) -> Robot:
    return load_robot(robot_folder / "robot.yaml")


@pytest.fixture
def plan(robot: Robot, robot_folder: Path) -> tuple[PlannedPose, ...]:
    return tuple(
        replace(pose, pose=i)
        for i, pose in enumerate(read_plan(robot_folder / "plan.csv", robot.tree.joint_names)[:5])
    )


@pytest.fixture
def fake(robot: Robot) -> FakeRobot:
    return FakeRobot(robot)


@pytest.fixture
def make_fake(robot: Robot) -> Callable[..., FakeRobot]:
    return lambda **kwargs: FakeRobot(robot, **kwargs)
