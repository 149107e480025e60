# SPDX-License-Identifier: Apache-2.0
"""Generated robots with their plans, written and read back once per session."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from comcal.measure.plan import DOUBLE, PlannedPose
from comcal.measure.plan_csv import read_plan
from comcal.robot.description import load_robot
from comcal.robot.kinematics import place_links
from comcal.robot.model import Robot
from comcal.robot.tree import Array
from comcal_sims.robots import biped14 as biped14_robot
from comcal_sims.robots import table1 as table1_robot


@dataclass(frozen=True)
class Generated:
    """A generated robot as everybody else reads it."""

    robot: Robot
    plan: tuple[PlannedPose, ...]

    def soles(self, pose: PlannedPose) -> dict[str, tuple[Array, Array]]:
        """Rotation and origin of every sole frame, in the frame of the root link."""
        placements = place_links(self.robot.tree, pose.q)
        soles = {}
        for name, foot in self.robot.feet.items():
            R, p = (a[0] for a in placements.link(foot.link))
            soles[name] = R @ foot.T_link_sole[:3, :3], R @ foot.T_link_sole[:3, 3] + p
        return soles

    def corners(self, pose: PlannedPose) -> dict[str, Array]:
        """Corners of every sole in the frame of the (first) standing sole, shape (n, 3)."""
        soles = self.soles(pose)
        R0, p0 = soles[pose.support if pose.support in soles else "left"]
        corners = {}
        for name, (R, p) in soles.items():
            flat = np.column_stack([self.robot.feet[name].sole, np.zeros(4)])
            corners[name] = (flat @ R.T + p - p0) @ R0
        return corners

    def com(self, pose: PlannedPose) -> Array:
        """CoM of the whole robot in the frame of the (first) standing sole."""
        soles = self.soles(pose)
        R0, p0 = soles[pose.support if pose.support in soles else "left"]
        return (place_links(self.robot.tree, pose.q).total_com()[0] - p0) @ R0

    def standing(self, pose: PlannedPose) -> list[str]:
        """Names of the feet that carry the robot."""
        return [name for name in self.robot.feet if pose.support in (DOUBLE, name)]


def _generated(generate: Callable[..., Path], directory: Path, **parameters: object) -> Generated:
    robot = load_robot(generate(directory, **parameters))
    return Generated(robot, read_plan(directory / "plan.csv", robot.tree.joint_names))


@pytest.fixture(scope="session")
def table1(tmp_path_factory: pytest.TempPathFactory) -> Generated:
    return _generated(table1_robot.generate, tmp_path_factory.mktemp("table1"))


@pytest.fixture(scope="session")
def table1_roll(tmp_path_factory: pytest.TempPathFactory) -> Generated:
    directory = tmp_path_factory.mktemp("table1_roll")
    return _generated(table1_robot.generate, directory, roll_joints=True, r_b=0.01, r_c=-0.02)


@pytest.fixture(scope="session")
def biped14(tmp_path_factory: pytest.TempPathFactory) -> Generated:
    return _generated(biped14_robot.generate, tmp_path_factory.mktemp("biped14"))


@pytest.fixture(params=["table1", "table1_roll", "biped14"])
def generated(request: pytest.FixtureRequest) -> Generated:
    """Each of the generated robots in turn."""
    return request.getfixturevalue(request.param)
