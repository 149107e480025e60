# SPDX-License-Identifier: Apache-2.0
"""Published humanoids stand in MuJoCo, in postures found for them, on the soles stated for them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from comcal.measure.plan import PlannedPose
from comcal.plan.candidates import random_pool
from comcal.plan.rules import rules_of
from comcal.robot.description import load_robot

pytest.importorskip("mujoco")

from comcal_sims.mujoco_world import MujocoWorld

pytestmark = pytest.mark.engine


@pytest.mark.parametrize("name", ["talos", "g1"])
def test_published_humanoid_stands_where_it_was_told_to(
    name: str, root: Path, tmp_path: Path
) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(root / "tests" / "oracles"))
        import humanoids
    try:
        robot = load_robot(humanoids.write_humanoid(name, tmp_path))
    except LookupError as absent:
        pytest.skip(str(absent))
    rules = rules_of(robot, ("double", "left"), margin=0.015, share=0.9)
    pool = random_pool(rules, 1, np.random.default_rng(1))
    below = robot.tree.masses[robot.below_cut["left_foot"]].sum()
    with MujocoWorld(robot) as world:
        for i, (support, q) in enumerate(zip(pool.support, pool.q, strict=True)):
            world.place(PlannedPose(i, q, support))
            state = world.state()
            np.testing.assert_allclose(state.q, q, atol=np.deg2rad(0.05))
            if support == "left":
                force = np.linalg.norm(state.wrenches["left_foot"][:3])
                carried = (robot.tree.total_mass - below) * robot.gravity
                assert force == pytest.approx(carried, rel=1e-4)
