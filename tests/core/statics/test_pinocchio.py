# SPDX-License-Identifier: Apache-2.0
"""CoM, Jacobian, wrench and torque rows against Pinocchio, on humanoids and on random trees."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pinocchio as pin
import pytest

from comcal.robot.frames import skew
from comcal.robot.tree import Array, JointType, Tree
from comcal.robot.urdf import read_urdf
from comcal.statics.com import com_jacobian, total_com
from comcal.statics.regressor import static_regressor

TOLERANCE = 1e-10
"""Relative to the largest entry of each quantity."""
TREES = 200


def assert_close(ours: Array, theirs: Array) -> None:
    scale = np.abs(theirs).max(initial=1e-300)
    assert np.abs(ours - theirs).max(initial=0.0) <= TOLERANCE * scale


def compare(oracle: ModuleType, tree: Tree, model: pin.Model, q: Array, seed: int) -> None:
    """All quantities of all poses *q*, the root at a random attitude in each."""
    rng = np.random.default_rng(seed)
    theirs = [oracle.expected(tree, model, pose, rng) for pose in q]
    com, jacobian = total_com(tree, q), com_jacobian(tree, q)
    rows = static_regressor(tree, q, np.array([e.up for e in theirs]), 9.81)
    loads = rows @ tree.bodies.moments.ravel()
    for i, e in enumerate(theirs):
        assert_close(com[i], e.com)
        base = np.concatenate([np.eye(3), -skew(com[i])], axis=1)
        assert_close(np.concatenate([base, jacobian[i]], axis=1), e.jacobian)
        assert_close(jacobian[i], e.jacobian[:, 6:])
        assert_close(rows[i], e.regressor)
        assert_close(loads[i, :6], e.loads[:6])
        assert_close(loads[i], e.loads)


@pytest.mark.parametrize("name", ["talos", "g1", "icub", "romeo"])
def test_humanoids_agree_with_pinocchio(
    name: str, example_urdf: Callable[[str], Path], pinocchio_oracle: ModuleType
) -> None:
    path = example_urdf(name)
    tree = read_urdf(path)
    model = pin.buildModelFromUrdf(str(path), pin.JointModelFreeFlyer())
    assert model.njoints - 1 == len(tree.bodies)
    q = np.random.default_rng(1).uniform(-3, 3, (20, len(tree.joint_names)))
    compare(pinocchio_oracle, tree, model, q, 2)


@pytest.mark.parametrize("decade", range(10))
def test_random_trees_agree_with_pinocchio(decade: int, pinocchio_oracle: ModuleType) -> None:
    for seed in range(decade * TREES // 10, (decade + 1) * TREES // 10):
        rng = np.random.default_rng(seed)
        tree = pinocchio_oracle.random_tree(rng)
        q = rng.uniform(-4, 4, (3, len(tree.joint_names)))
        compare(pinocchio_oracle, tree, pinocchio_oracle.model_of(tree), q, seed)


def test_the_random_trees_hold_every_case(pinocchio_oracle: ModuleType) -> None:
    trees = [pinocchio_oracle.random_tree(np.random.default_rng(s)) for s in range(TREES)]
    joints = [j for tree in trees for j in tree.joints]
    assert {j.kind for j in joints} == set(JointType)
    assert {j.kind for j in joints if j.mimic} == set(JointType) - {JointType.FIXED}
    by_name = [(tree, j) for tree in trees for j in tree.joints if j.mimic]
    crossed = {
        (j.kind is JointType.PRISMATIC)
        != (tree.joints[tree.joint_index[j.mimic.joint]].kind is JointType.PRISMATIC)
        for tree, j in by_name
    }
    assert crossed == {True, False}
    assert any(not tree.joint_names for tree in trees)
    runs = [np.flatnonzero(row) for tree in trees for row in tree.bodies.descendants]
    assert any(np.ptp(run) >= run.size for run in runs), "a subtree that is not one run of bodies"
