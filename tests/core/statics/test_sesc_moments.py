# SPDX-License-Identifier: Apache-2.0
"""R to first moments and back, on random trees with sliding joints."""

from __future__ import annotations

from dataclasses import replace
from types import ModuleType

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from comcal.errors import ConfigError, DataError
from comcal.robot.frames import apply, transform_from
from comcal.robot.tree import Array, Joint, JointType, Link, Tree
from comcal.statics.regressor import static_regressor
from comcal.statics.sesc import r_from_links, sesc_chain, sesc_matrix
from comcal.statics.sesc_moments import (
    moment_matrix,
    moments_from_r,
    r_from_moments,
    undetermined_moments,
)

seeds = st.integers(0, 10**6)


@pytest.fixture(scope="module")
def make(pinocchio_oracle: ModuleType):
    return pinocchio_oracle.random_tree


def random_moments(tree: Tree, rng: np.random.Generator) -> Array:
    moments = rng.normal(size=(len(tree.bodies), 4))
    moments[:, 0] = rng.uniform(0.1, 3.0, len(moments))
    return moments


@given(seeds)
def test_r_of_the_bodies_is_r_of_the_links(make, seed: int) -> None:
    tree = make(np.random.default_rng(seed))
    chain = sesc_chain(tree)
    expected = r_from_links(chain)
    np.testing.assert_allclose(r_from_moments(chain, tree.bodies.moments), expected, atol=1e-12)


@given(seeds)
def test_r_and_moments_give_the_same_com(make, seed: int) -> None:
    rng = np.random.default_rng(seed)
    tree = make(rng)
    moments = random_moments(tree, rng)
    q = rng.uniform(-2, 2, (3, len(tree.joint_names)))
    chain = sesc_chain(tree)
    com = sesc_matrix(chain, q) @ r_from_moments(chain, moments)
    rows = static_regressor(tree, q, np.eye(3)[2], 1.0) @ moments.ravel()
    # With gravity along z the moment about the origin is S x z = (S_y, -S_x, 0).
    np.testing.assert_allclose(com[:, 1] * moments[:, 0].sum(), rows[:, 3], atol=1e-10)
    np.testing.assert_allclose(-com[:, 0] * moments[:, 0].sum(), rows[:, 4], atol=1e-10)


@given(seeds)
def test_going_to_moments_and_back_returns_r_whatever_the_prior(make, seed: int) -> None:
    rng = np.random.default_rng(seed)
    tree = make(rng)
    chain = sesc_chain(tree)
    moments, prior = random_moments(tree, rng), random_moments(tree, rng)
    prior[:, 0] = moments[:, 0]
    r = r_from_moments(chain, moments)

    found = moments_from_r(chain, r, prior)

    np.testing.assert_allclose(r_from_moments(chain, found), r, atol=1e-10)
    hidden = undetermined_moments(chain)
    assert len(hidden) == 3 * len(chain.slides)
    np.testing.assert_array_equal(found[:, 0], moments[:, 0])
    # What is wrong lies in the hidden directions, and there nothing was moved.
    error = (found - moments).ravel()
    np.testing.assert_allclose(error, hidden.T @ (hidden @ error), atol=1e-10)
    np.testing.assert_allclose(hidden @ (found - prior).ravel(), 0.0, atol=1e-10)


@given(seeds)
def test_every_first_moment_is_found_where_nothing_slides(make, seed: int) -> None:
    rng = np.random.default_rng(seed)
    tree = make(rng)
    joints = tuple(
        replace(j, kind=JointType.REVOLUTE) if j.kind is JointType.PRISMATIC else j
        for j in tree.joints
    )
    tree = replace(tree, joints=joints)
    chain = sesc_chain(tree)
    moments = random_moments(tree, rng)
    prior = moments * [1.0, 0.0, 0.0, 0.0]
    found = moments_from_r(chain, r_from_moments(chain, moments), prior)
    np.testing.assert_allclose(found, moments, atol=1e-10)
    assert len(undetermined_moments(chain)) == 0


@given(seeds)
def test_hidden_directions_do_not_move_the_com(make, seed: int) -> None:
    rng = np.random.default_rng(seed)
    tree = make(rng)
    chain = sesc_chain(tree)
    q = rng.uniform(-2, 2, (3, len(tree.joint_names)))
    wrench = static_regressor(tree, q, np.eye(3)[1])[:, :6]
    np.testing.assert_allclose(wrench @ undetermined_moments(chain).T, 0.0, atol=1e-10)


def planar_tree(rng: np.random.Generator, kinds: tuple[JointType, ...]) -> Tree:
    links = tuple(Link(f"l{k}", 1.0 + k, rng.normal(size=3), np.eye(3)) for k in range(4))
    along = {JointType.REVOLUTE: np.eye(3)[1], JointType.PRISMATIC: np.eye(3)[2]}
    joints = tuple(
        Joint(
            f"j{k}",
            kind,
            f"l{k}",
            f"l{k + 1}",
            transform_from(np.eye(3), rng.normal(size=3)),
            along[kind],
        )
        for k, kind in enumerate(kinds)
    )
    return Tree("plane", links, joints)


@given(seeds)
def test_a_planar_chain_hides_what_lies_along_its_normal(seed: int) -> None:
    rng = np.random.default_rng(seed)
    turn, slide = JointType.REVOLUTE, JointType.PRISMATIC
    tree = planar_tree(rng, (turn, slide, turn))
    chain = sesc_chain(tree, planar=True)
    moments = tree.bodies.moments
    prior = moments + np.arange(4.0)
    found = moments_from_r(chain, r_from_links(chain), prior)
    np.testing.assert_allclose(found[:, 2], prior[:, 2], atol=1e-12)  # along the normal y
    turning = [0, 3]
    np.testing.assert_allclose(found[turning][:, [1, 3]], moments[turning][:, [1, 3]], atol=1e-12)
    both = found[1] + found[2]
    np.testing.assert_allclose(both[[1, 3]], (moments[1] + moments[2])[[1, 3]], atol=1e-12)
    assert len(undetermined_moments(chain)) == 3 * 1 + 3


def test_links_joined_by_fixed_joints_count_as_one_body() -> None:
    rng = np.random.default_rng(0)
    R = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    links = tuple(Link(f"l{k}", 1.0 + k, rng.normal(size=3), np.eye(3)) for k in range(2))
    glue = Joint("glue", JointType.FIXED, "l0", "l1", transform_from(R, [1.0, 2, 3]), np.zeros(3))
    bodies = Tree("glued", links, (glue,)).bodies
    assert bodies.members(0) == (0, 1)
    expected = links[0].mass * links[0].com + links[1].mass * (
        apply(R, links[1].com) + np.array([1.0, 2, 3])
    )
    np.testing.assert_allclose(bodies.moments, [[3.0, *expected]], atol=1e-14)
    assert bodies.labels == ("l0.m", "l0.hx", "l0.hy", "l0.hz")


def test_massless_bodies_and_unknown_lengths_are_refused() -> None:
    tree = planar_tree(np.random.default_rng(0), (JointType.REVOLUTE,) * 3)
    chain = sesc_chain(tree)
    with pytest.raises(DataError, match="positive"):
        r_from_moments(chain, np.zeros((4, 4)))
    with pytest.raises(ConfigError, match="lengths"):
        moment_matrix(sesc_chain(replace(tree, geometry_known=False)))
