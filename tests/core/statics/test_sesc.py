# SPDX-License-Identifier: Apache-2.0
"""The statically equivalent serial chain against the plain sum over links."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from comcal.errors import ConfigError
from comcal.robot.frames import rotation_about, rotation_from_rpy, transform_from
from comcal.robot.kinematics import place_links
from comcal.robot.tree import Array, Joint, JointType, Link, Mimic, Tree
from comcal.statics.sesc import (
    common_axis,
    line_rows,
    r_from_links,
    sesc_chain,
    sesc_jacobian,
    sesc_matrix,
)

KINDS = (JointType.REVOLUTE, JointType.CONTINUOUS, JointType.PRISMATIC, JointType.FIXED)


def random_tree(seed: int, kinds: tuple[JointType, ...] = KINDS, axis: Array | None = None) -> Tree:
    """Return a branched tree of 2 to 9 links; with *axis*, all joints turn about that root axis."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 10))
    links = tuple(
        Link(f"l{k}", float(rng.uniform(0.1, 5.0)), rng.normal(0, 0.2, 3), np.eye(3))
        for k in range(n)
    )
    joints: list[Joint] = []
    root_from = [np.eye(3)]
    for k in range(1, n):
        parent = int(rng.integers(0, k))
        kind = kinds[int(rng.integers(0, len(kinds)))]
        R = rotation_from_rpy(rng.uniform(-3, 3, 3))
        root_from.append(root_from[parent] @ R)
        direction = rng.normal(size=3) if axis is None else root_from[k].T @ axis
        turning = [j for j in joints if j.kind is kind and j.mimic is None]
        mimic = None
        if turning and kind is not JointType.FIXED and rng.random() < 0.25:
            mimic = Mimic(turning[0].name, float(rng.normal()), float(rng.normal()))
        joints.append(
            Joint(
                f"j{k}",
                kind,
                f"l{parent}",
                f"l{k}",
                transform_from(R, rng.normal(0, 0.3, 3)),
                np.zeros(3) if kind is JointType.FIXED else direction / np.linalg.norm(direction),
                mimic=mimic,
            )
        )
    return Tree("random", links, tuple(joints))


def random_q(tree: Tree, seed: int, n: int = 5) -> Array:
    return np.random.default_rng(seed + 1).uniform(-2, 2, (n, len(tree.joint_names)))


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 10**6))
def test_chain_of_a_known_tree_ends_in_its_com(seed: int) -> None:
    tree = random_tree(seed)
    q = random_q(tree, seed)
    chain = sesc_chain(tree)

    com = sesc_matrix(chain, q) @ r_from_links(chain)

    np.testing.assert_allclose(com, place_links(tree, q).total_com(), atol=1e-12)
    assert len(chain.labels) == chain.size


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 10**6))
def test_jacobian_is_the_slope_of_the_com(seed: int) -> None:
    tree = random_tree(seed)
    q = random_q(tree, seed, n=2)
    chain = sesc_chain(tree)
    step = 1e-6

    J = sesc_jacobian(chain, q, r_from_links(chain))

    for i in range(q.shape[1]):
        ahead, behind = q.copy(), q.copy()
        ahead[:, i] += step
        behind[:, i] -= step
        slope = place_links(tree, ahead).total_com() - place_links(tree, behind).total_com()
        np.testing.assert_allclose(J[:, :, i], slope / (2 * step), atol=1e-8)


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 10**6))
def test_two_columns_per_body_suffice_in_the_plane(seed: int) -> None:
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    kinds = (JointType.REVOLUTE, JointType.PRISMATIC, JointType.FIXED)
    tree = random_tree(seed, kinds, axis)
    if common_axis(tree) is None:
        return
    chain = sesc_chain(tree, planar=True)
    q = random_q(tree, seed)
    across = np.cross(axis, rng.normal(size=3))

    com = sesc_matrix(chain, q) @ r_from_links(chain)

    np.testing.assert_allclose(com @ across, place_links(tree, q).total_com() @ across, atol=1e-12)
    assert chain.size == 2 * len(chain.bodies) + len(chain.slides)
    slope = sesc_jacobian(chain, q, r_from_links(chain))
    spatial = sesc_chain(tree)
    expected = sesc_jacobian(spatial, q, r_from_links(spatial))
    np.testing.assert_allclose(
        np.einsum("i,nij->nj", across, slope), np.einsum("i,nij->nj", across, expected), atol=1e-12
    )


def test_planar_columns_are_cosine_and_sine_of_the_absolute_angle() -> None:
    links = tuple(Link(f"l{k}", np.nan, np.zeros(3), np.eye(3)) for k in range(3))
    joints = tuple(
        Joint(f"j{k}", JointType.CONTINUOUS, f"l{k}", f"l{k + 1}", np.eye(4), np.array([0, 1.0, 0]))
        for k in range(2)
    )
    chain = sesc_chain(Tree("chain", links, joints, geometry_known=False), planar=True)

    row = sesc_matrix(chain, [[0.3, 0.5]])[0, 0]

    np.testing.assert_allclose(np.abs(row), np.abs([1, 0, *_cs(0.3), *_cs(0.8)]), atol=1e-15)
    np.testing.assert_allclose(row[[0, 2, 4]], [1.0, np.cos(0.3), np.cos(0.8)])


def _cs(angle: float) -> tuple[float, float]:
    return (float(np.cos(angle)), float(np.sin(angle)))


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 10**6))
def test_r_satisfies_the_rows_of_every_leaning_line_through_the_com(seed: int) -> None:
    tree = random_tree(seed)
    q = random_q(tree, seed)
    chain = sesc_chain(tree)
    com = place_links(tree, q).total_com()
    beta, delta = np.random.default_rng(seed).uniform(-0.5, 0.5, (2, len(q)))
    alpha = com[:, 0] - beta * com[:, 2]
    gamma = com[:, 1] - delta * com[:, 2]

    rows = line_rows(sesc_matrix(chain, q), beta, delta)

    np.testing.assert_allclose(
        rows @ r_from_links(chain), np.stack([alpha, gamma], axis=1), atol=1e-12
    )


def test_r_stays_constant_when_a_joint_slides() -> None:
    """The papers let r vary then; here the share of mass beyond the slide is one more entry."""
    links = tuple(Link(f"l{k}", 1.0 + k, np.array([0.1, 0.0, 0.2]), np.eye(3)) for k in range(3))
    joints = (
        Joint("turn", JointType.REVOLUTE, "l0", "l1", np.eye(4), np.array([0, 1.0, 0])),
        Joint("slide", JointType.PRISMATIC, "l1", "l2", np.eye(4), np.array([0, 0, 1.0])),
    )
    tree = Tree("lift", links, joints)
    chain = sesc_chain(tree)
    r = r_from_links(chain)

    assert r[-1] == pytest.approx(3.0 / 6.0)
    up = sesc_matrix(chain, [[0.4, 0.3]])[0] @ r - sesc_matrix(chain, [[0.4, 0.0]])[0] @ r
    np.testing.assert_allclose(
        up, 0.3 * 0.5 * rotation_about([0, 1, 0], 0.4) @ [0, 0, 1.0], atol=1e-15
    )


def test_planar_chain_is_refused_when_axes_are_not_parallel() -> None:
    links = tuple(Link(f"l{k}", 1.0, np.zeros(3), np.eye(3)) for k in range(3))
    joints = (
        Joint("a", JointType.REVOLUTE, "l0", "l1", np.eye(4), np.array([0, 1.0, 0])),
        Joint("b", JointType.REVOLUTE, "l1", "l2", np.eye(4), np.array([1.0, 0, 0])),
    )
    with pytest.raises(ConfigError, match="one axis"):
        sesc_chain(Tree("bent", links, joints), planar=True)


def test_r_of_a_chain_without_masses_is_refused() -> None:
    links = tuple(Link(f"l{k}", np.nan, np.zeros(3), np.eye(3)) for k in range(2))
    joints = (Joint("a", JointType.REVOLUTE, "l0", "l1", np.eye(4), np.array([0, 1.0, 0])),)
    with pytest.raises(ConfigError, match="not known"):
        r_from_links(sesc_chain(Tree("bare", links, joints, geometry_known=False)))
