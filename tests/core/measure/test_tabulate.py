# SPDX-License-Identifier: Apache-2.0
"""A table made in memory is the table that the same samples give through ``poses.csv``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from comcal.measure.csv_file import write_csv
from comcal.measure.pose_row import approaches, pose_row
from comcal.measure.poses_csv import read_poses
from comcal.measure.source import SourceRequest
from comcal.measure.tabulate import tabulate
from comcal.robot.model import Sense
from comcal_sims.sources import open_builtin

SIX_DIGITS = 1e-5
"""Standard errors are written with six digits."""


@pytest.mark.parametrize("sense", list(Sense))
def test_table_in_memory_is_that_of_the_file(biped14, sense: Sense, tmp_path: Path) -> None:
    sensors = {n: replace(s, sense=sense) for n, s in biped14.robot.sensors.items()}
    robot = replace(biped14.robot, sensors=sensors)
    plan = biped14.plan[10:22]
    windows = []
    with open_builtin(SourceRequest(robot=robot, seed=4)) as source:
        for pose in plan:
            source.move_to(pose)
            windows.append(source.read(0.25))
    table = tabulate(robot, plan, windows, "test")

    unknown = approaches(plan[0], None, robot.tree.joint_names)
    rows = [
        pose_row(pose, window, robot, unknown, with_floor=False)
        for pose, window in zip(plan, windows, strict=True)
    ]
    write_csv(tmp_path / "poses.csv", list(rows[0]), [list(row.values()) for row in rows])
    read = read_poses(tmp_path / "poses.csv", robot)
    assert (table.pose, table.support) == (read.pose, read.support)
    assert table.configuration == read.configuration
    np.testing.assert_allclose(table.q, read.q, rtol=0, atol=1e-12)
    np.testing.assert_allclose(table.q_cov, read.q_cov, rtol=SIX_DIGITS, atol=1e-20)
    for name in robot.sensors:
        np.testing.assert_allclose(table.wrench[name], read.wrench[name], rtol=0, atol=1e-9)
        np.testing.assert_allclose(
            table.wrench_cov[name], read.wrench_cov[name], rtol=SIX_DIGITS, atol=1e-20
        )
