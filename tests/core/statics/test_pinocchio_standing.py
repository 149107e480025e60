# SPDX-License-Identifier: Apache-2.0
"""A robot standing on one link: its loads against Pinocchio, and what they can tell of its masses.

The ranks are those of humanoids whose foot lies flat on a level floor while all joints move.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pinocchio as pin
import pytest

from comcal.robot.frames import apply
from comcal.robot.kinematics import place_links
from comcal.robot.tree import Array, Tree
from comcal.robot.urdf import read_urdf
from comcal.statics.regressor import TORQUES, WRENCH, static_regressor
from comcal.statics.standing_rows import standing_rows

FEET = {"talos": "leg_left_6_link", "g1": "left_ankle_roll_link", "icub": "l_foot"}
LEVEL = (0.0, 0.0, 1.0)


def random_poses(tree: Tree, n: int, seed: int) -> Array:
    return np.random.default_rng(seed).uniform(-2, 2, (n, len(tree.joint_names)))


@pytest.mark.parametrize("name", FEET)
def test_loads_of_a_standing_humanoid_agree_with_pinocchio(
    name: str, example_urdf: Callable[[str], Path], pinocchio_oracle: ModuleType
) -> None:
    path = example_urdf(name)
    model = pin.buildModelFromUrdf(str(path), pin.JointModelFreeFlyer())
    agree_on_standing(pinocchio_oracle, read_urdf(path), model, FEET[name], 0)


@pytest.mark.parametrize("seed", range(40))
def test_loads_of_standing_random_trees_agree_with_pinocchio(
    seed: int, pinocchio_oracle: ModuleType
) -> None:
    rng = np.random.default_rng(seed)
    tree = pinocchio_oracle.random_tree(rng)
    on = tree.links[int(rng.integers(0, len(tree.links)))].name
    agree_on_standing(pinocchio_oracle, tree, pinocchio_oracle.model_of(tree), on, seed)


def agree_on_standing(oracle: ModuleType, tree: Tree, model: pin.Model, on: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    q = random_poses(tree, 4, seed)
    theirs = [oracle.expected(tree, model, pose, rng, on) for pose in q]
    rows = static_regressor(tree, q, np.array([e.up for e in theirs]))
    loads = standing_rows(tree, q, rows, on) @ tree.bodies.moments.ravel()
    for ours, e in zip(loads, theirs, strict=True):
        assert np.abs(ours - e.standing).max() <= 1e-10 * np.abs(e.standing).max()


def rank(rows: Array) -> int:
    """Rank of stacked rows; refuses a gap that is not clear."""
    values = np.linalg.svd(rows.reshape(-1, rows.shape[-1]), compute_uv=False)
    found = int((values > 1e-9 * values[0]).sum())
    assert values[found - 1] > 1e-4 * values[0], "the smallest visible direction is doubtful"
    return found


def rows_on_foot(tree: Tree, foot: str, up_in_foot: Array, seed: int) -> Array:
    """Rows of 40 poses standing on *foot*, in which the direction up is the same in all."""
    q = random_poses(tree, 40, seed)
    up = apply(place_links(tree, q).link(foot)[0], up_in_foot)
    return standing_rows(tree, q, static_regressor(tree, q, up), foot)


@pytest.mark.parametrize(
    ("name", "wrench", "torques", "both", "coms"),
    [("talos", 67, 64, 67, 66), ("icub", 67, 64, 67, 66), ("g1", 61, 58, 61, 60)],
)
def test_ranks_on_a_level_floor(
    name: str,
    wrench: int,
    torques: int,
    both: int,
    coms: int,
    example_urdf: Callable[[str], Path],
) -> None:
    tree = read_urdf(example_urdf(name))
    rows = rows_on_foot(tree, FEET[name], np.array(LEVEL), 5)
    moments_only = np.arange(rows.shape[2]) % 4 > 0
    assert rows.shape[2] == 4 * len(tree.bodies) == 4 * (len(tree.joint_names) + 1)
    assert rank(rows[:, WRENCH]) == wrench
    assert rank(rows[:, TORQUES]) == torques
    assert rank(rows) == both
    assert rank(rows[:, WRENCH, moments_only]) == coms
    assert rank(rows[..., moments_only]) == coms


def test_a_second_slope_shows_the_height_of_the_standing_foot(
    example_urdf: Callable[[str], Path],
) -> None:
    tree = read_urdf(example_urdf("talos"))
    level = rows_on_foot(tree, FEET["talos"], np.array(LEVEL), 5)
    leaning = np.array([np.sin(0.1), 0.0, np.cos(0.1)])
    slope = rows_on_foot(tree, FEET["talos"], leaning, 6)
    assert rank(level[:, WRENCH]) == 67
    assert rank(np.concatenate([level, slope])[:, WRENCH]) == 68
    assert rank(np.concatenate([level, slope])) == 68
    foot_hz = tree.bodies.labels.index(f"{FEET['talos']}.hz")
    assert np.abs(level[..., foot_hz]).max() < 1e-9 * np.abs(level).max()
    assert np.abs(slope[..., foot_hz]).max() > 1e-3
