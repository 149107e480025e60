# SPDX-License-Identifier: Apache-2.0
"""CoM and static rows: what holds without another library, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from types import ModuleType

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from comcal.errors import ConfigError, DataError
from comcal.robot.kinematics import place_links
from comcal.robot.tree import Array, Tree
from comcal.statics.com import com_jacobian, total_com
from comcal.statics.regressor import TORQUES, static_regressor
from comcal.statics.standing_rows import standing_rows

seeds = st.integers(0, 10**6)
UP = np.array([0.0, 0.6, 0.8])


@pytest.fixture(scope="module")
def make(pinocchio_oracle: ModuleType):
    return pinocchio_oracle.random_tree


def tree_and_poses(make, seed: int, n: int = 3) -> tuple[Tree, Array]:
    rng = np.random.default_rng(seed)
    tree = make(rng)
    return tree, rng.uniform(-3, 3, (n, len(tree.joint_names)))


@given(seeds)
def test_torques_are_the_slope_of_the_potential_energy(make, seed: int) -> None:
    """Virtual work: what the motors hold is how the height of the CoM grows with each joint."""
    tree, q = tree_and_poses(make, seed)
    loads = static_regressor(tree, q, UP, 10.0) @ tree.bodies.moments.ravel()
    energy_slope = 10.0 * tree.total_mass * np.einsum("i,nij->nj", UP, com_jacobian(tree, q))
    np.testing.assert_allclose(loads[:, TORQUES], energy_slope, atol=1e-9)


@given(seeds)
def test_jacobian_is_the_slope_of_the_com(make, seed: int) -> None:
    tree, q = tree_and_poses(make, seed, 2)
    J = com_jacobian(tree, q)
    for i, step in enumerate(np.eye(q.shape[1]) * 1e-6):
        slope = (total_com(tree, q + step) - total_com(tree, q - step)) / 2e-6
        np.testing.assert_allclose(J[:, :, i], slope, atol=1e-8)


@given(seeds)
def test_com_is_that_of_the_placed_links(make, seed: int) -> None:
    tree, q = tree_and_poses(make, seed)
    np.testing.assert_allclose(total_com(tree, q), place_links(tree, q).total_com(), atol=1e-12)


@given(seeds)
def test_torques_do_not_depend_on_where_the_standing_wrench_is_written(make, seed: int) -> None:
    """Standing on the root changes nothing but the name of the wrench."""
    tree, q = tree_and_poses(make, seed)
    rows = static_regressor(tree, q, UP)
    np.testing.assert_allclose(standing_rows(tree, q, rows, tree.links[0].name), rows, atol=1e-9)


def test_many_poses_give_what_each_of_them_gives_alone(make) -> None:
    """Poses are worked on in blocks, and their rows in smaller ones; neither may show."""
    tree, q = tree_and_poses(make, 5, 2500)
    rng = np.random.default_rng(0)
    up = rng.normal(size=(len(q), 3))
    up /= np.linalg.norm(up, axis=1)[:, None]
    some = [0, 255, 256, 511, 512, 1023, 1024, 2047, 2048, 2499]
    com, J, rows = total_com(tree, q), com_jacobian(tree, q), static_regressor(tree, q, up)
    placed = place_links(tree, q)
    for i in some:
        one = q[i : i + 1]
        np.testing.assert_allclose(total_com(tree, one)[0], com[i], atol=1e-13)
        np.testing.assert_allclose(com_jacobian(tree, one)[0], J[i], atol=1e-13)
        np.testing.assert_allclose(static_regressor(tree, one, up[i])[0], rows[i], atol=1e-12)
        np.testing.assert_allclose(place_links(tree, one).p[0], placed.p[i], atol=1e-13)
        np.testing.assert_allclose(place_links(tree, one).R[0], placed.R[i], atol=1e-13)


@given(seeds)
def test_a_used_buffer_leaves_no_trace(make, seed: int) -> None:
    tree, q = tree_and_poses(make, seed)
    fresh = static_regressor(tree, q, UP)
    buffer = np.full(fresh.shape, np.nan)
    assert static_regressor(tree, q, UP, out=buffer) is buffer
    np.testing.assert_array_equal(buffer, fresh)


@pytest.mark.parametrize("n", [0, 1])
def test_no_pose_and_one_pose_are_poses_too(make, n: int) -> None:
    tree, q = tree_and_poses(make, 5, n)
    joints = len(tree.joint_names)
    assert total_com(tree, q).shape == (n, 3)
    assert com_jacobian(tree, q).shape == (n, 3, joints)
    rows = static_regressor(tree, q, UP)
    assert rows.shape == (n, 6 + joints, 4 * len(tree.bodies))


def test_every_angle_is_as_exact_as_sine_and_cosine(make) -> None:
    tree = next(t for s in range(99) if (t := make(np.random.default_rng(s))).joint_names)
    turning = np.flatnonzero(~tree.bodies.slides & ~tree.bodies.follows)
    angles = np.array([0.0, 1e-9, np.pi / 2, np.pi, -np.pi, 3.0, 2 * np.pi, 1e3, -3 * np.pi])
    q = np.zeros((len(angles), len(tree.joint_names)))
    q[:, tree.bodies.columns[turning]] = angles[:, None]
    sine, versine = tree.bodies.positions(q)[turning].swapaxes(0, 1)
    np.testing.assert_allclose(sine - np.sin(angles), 0.0, atol=1e-15)
    np.testing.assert_allclose(versine - (1.0 - np.cos(angles)), 0.0, atol=1e-15)


def test_what_cannot_be_computed_is_refused(make) -> None:
    tree, q = tree_and_poses(make, 5)
    bare = replace(tree, geometry_known=False)
    for function in (total_com, com_jacobian):
        with pytest.raises(ConfigError, match="not known"):
            function(bare, q)
    with pytest.raises(ConfigError, match="not known"):
        static_regressor(bare, q, UP)
    massless = replace(tree, links=tuple(replace(link, mass=0.0) for link in tree.links))
    with pytest.raises(ConfigError, match="no mass"):
        total_com(massless, q)
    unknown = replace(tree, links=(replace(tree.links[0], mass=np.nan), *tree.links[1:]))
    with pytest.raises(ConfigError, match="not known"):
        com_jacobian(unknown, q)


@pytest.mark.parametrize(
    ("up", "words"),
    [
        ([0.0, 0.0, 9.81], "unit vector"),
        ([0.0, 0.0, np.nan], "unit vector"),
        (np.ones((2, 3)), "shape"),
        (0.0, "shape"),
    ],
)
def test_a_direction_that_is_none_is_refused(make, up: object, words: str) -> None:
    tree, q = tree_and_poses(make, 5)
    with pytest.raises(DataError, match=words):
        static_regressor(tree, q, up)


def test_a_buffer_that_does_not_fit_is_refused(make) -> None:
    tree, q = tree_and_poses(make, 5)
    shape = static_regressor(tree, q, UP).shape
    for buffer in (
        np.empty((1, *shape[1:])),
        np.empty(shape, dtype=np.float32),
        np.empty(shape, order="F"),
    ):
        with pytest.raises(DataError, match="does not fit"):
            static_regressor(tree, q, UP, out=buffer)
