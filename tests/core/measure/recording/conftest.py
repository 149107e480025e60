# SPDX-License-Identifier: Apache-2.0
"""The Table 1 robot standing on two level feet, measured by a source whose motion tests choose."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from comcal.measure.operator import Wish
from comcal.measure.plan import PlannedPose
from comcal.measure.plan_csv import read_plan
from comcal.measure.source import Block, SourceStatus
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


class HandMoved:
    """A source that only measures a robot which somebody moves: every joint towards ``goal``.

    Parameters
    ----------
    robot : Robot
    q : array, shape (n_joints,)
        Where it stands at first.
    """

    name = "hand-moved 1.0"
    rate = 125.0

    def __init__(self, robot: Robot, q: np.ndarray) -> None:
        self.robot = robot
        self.q = np.array(q, dtype=np.float64)
        self.goal = self.q.copy()
        self.speed = 0.5
        self.t = 0.0
        self.reads = 0
        self.lost = 0
        self.poses: list[int] = []
        self.on_read: Callable[[], None] = lambda: None
        self.rng = np.random.default_rng(1)

    def begin_pose(self, pose: int) -> None:
        self.poses.append(pose)

    def read(self, duration: float) -> Block:
        self.on_read()
        self.reads += 1
        n = round(duration * self.rate)
        q = np.empty((n, self.q.size))
        for i in range(n):
            way = self.goal - self.q
            longest = np.abs(way).max()
            self.q = self.q + way * (min(1.0, self.speed / self.rate / longest) if longest else 0.0)
            q[i] = self.q
        t = self.t + np.arange(1, n + 1) / self.rate
        self.t = float(t[-1])
        wrenches = {}
        for name in self.robot.sensors:
            w = np.zeros((n, 6))
            w[:, 2] = WEIGHT / 2
            w[:, 4] = -0.3 * (q[:, 0] - self.goal[0]) * WEIGHT / 2  # what moves shifts the CoP
            w[:, 3] = -0.3 * np.abs(q - self.goal).max(axis=1) * WEIGHT / 2
            noise = self.rng.standard_normal((n, 6)) * np.repeat([0.3, 0.03], 3)
            wrenches[name] = w + noise
        temperatures = {name: np.full(n, 30.0) + 0.01 * t for name in wrenches}
        return Block(t, q, wrenches, temperatures=temperatures)

    def status(self) -> SourceStatus:
        return SourceStatus({"l_foot": 125.0}, {"l_foot": self.lost}, ())

    def close(self) -> None:
        self.t = np.nan


class Scripted:
    """An operator who wishes what the test puts into ``wishes``."""

    def __init__(self) -> None:
        self.wishes: list[Wish] = []
        self.stop: Callable[[], None] | None = None

    def attend(self, stop: Callable[[], None] | None) -> AbstractContextManager[object]:
        self.stop = stop
        return nullcontext()

    def wish(self) -> Wish | None:
        return self.wishes.pop(0) if self.wishes else None


@pytest.fixture
def hand(robot: Robot, plan: tuple[PlannedPose, ...]) -> HandMoved:
    """A robot that stands 0.2 rad from the first pose of the plan."""
    return HandMoved(robot, plan[0].q - 0.2)


@pytest.fixture
def operator() -> Scripted:
    return Scripted()


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
