# SPDX-License-Identifier: Apache-2.0
"""Forward kinematics against an independent library, on random trees."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from comcal.robot.kinematics import place_links
from comcal.robot.tree import JointType
from comcal.robot.urdf import read_urdf

pin = pytest.importorskip("pinocchio")


def joint_positions(tree, q):
    """The position of every movable joint by name, mimics followed by hand."""
    value = dict(zip(tree.joint_names, q, strict=True))
    for joint in tree.joints:
        if joint.mimic is not None:
            mimic = joint.mimic
            value[joint.name] = mimic.multiplier * value[mimic.joint] + mimic.offset
    return value


def pin_configuration(model, value):
    """Pinocchio's q: a free root at the identity, continuous joints as cosine and sine."""
    q = pin.neutral(model)
    for name, position in value.items():
        joint = model.joints[model.getJointId(name)]
        if joint.nq == 2:
            q[joint.idx_q : joint.idx_q + 2] = np.cos(position), np.sin(position)
        else:
            q[joint.idx_q] = position
    return q


@pytest.fixture(params=range(6))
def tree_and_model(request, random_urdf, write):
    text = random_urdf(np.random.default_rng(request.param), 14)
    path = write("random.urdf", text)
    return read_urdf(path), pin.buildModelFromUrdf(str(path), pin.JointModelFreeFlyer())


def test_link_poses_and_total_com_agree_with_pinocchio(tree_and_model):
    tree, model = tree_and_model
    data = model.createData()
    poses = np.random.default_rng(9).uniform(-2, 2, (4, len(tree.joint_names)))
    placed = place_links(tree, poses)
    for i, q in enumerate(poses):
        q_pin = pin_configuration(model, joint_positions(tree, q))
        pin.framesForwardKinematics(model, data, q_pin)
        for link in tree.links:
            frame = data.oMf[model.getFrameId(link.name, pin.FrameType.BODY)]
            R, p = placed.link(link.name)
            np.testing.assert_allclose(R[i], frame.rotation, atol=1e-10)
            np.testing.assert_allclose(p[i], frame.translation, atol=1e-10)
        com = pin.centerOfMass(model, data, q_pin)
        np.testing.assert_allclose(placed.total_com()[i], com, atol=1e-10)
    assert tree.total_mass == pytest.approx(pin.computeTotalMass(model), abs=1e-10)


def test_the_random_trees_contain_every_joint_type_and_chains_of_mimics(random_urdf, write):
    texts = [random_urdf(np.random.default_rng(seed), 14) for seed in range(6)]
    trees = [read_urdf(write("random.urdf", text)) for text in texts]
    assert {joint.kind for tree in trees for joint in tree.joints} == set(JointType)
    chains = 0
    for tree, text in zip(trees, texts, strict=True):
        followers = {joint.name for joint in tree.joints if joint.mimic}
        chains += sum(text.count(f'<mimic joint="{name}"') for name in followers)
        assert all(j.mimic.joint in tree.joint_names for j in tree.joints if j.mimic)
    assert chains > 0


def test_inertias_about_the_com_agree_with_pinocchio(tree_and_model):
    tree, model = tree_and_model
    # A leaf that hangs on a movable joint is the only body of that joint in Pinocchio.
    leaves = [
        (link, joint)
        for link, joint in zip(tree.links[1:], tree.joints, strict=True)
        if joint.is_movable and not any(j.parent == link.name for j in tree.joints)
    ]
    assert leaves
    for link, joint in leaves:
        body = model.inertias[model.getJointId(joint.name)]
        np.testing.assert_allclose(link.inertia, body.inertia, atol=1e-10)
        np.testing.assert_allclose(link.com, body.lever, atol=1e-12)


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 10_000), st.integers(1, 12))
def test_every_parent_comes_before_its_children_and_masks_agree(
    tmp_path_factory, random_urdf, seed, n
):
    path = tmp_path_factory.mktemp("tree") / "r.urdf"
    path.write_text(random_urdf(np.random.default_rng(seed), n))
    tree = read_urdf(path)
    assert len(tree.links) == n + 1
    assert (tree.parents[1:] < np.arange(1, n + 1)).all()
    for k, joint in enumerate(tree.joints, start=1):
        assert tree.links[k].name == joint.child
        mask = tree.subtree(joint.name)
        assert mask[k]
        assert not mask[0]
        # depth first: a subtree is one uninterrupted run of links
        assert mask[k : k + mask.sum()].all()


def test_axes_in_the_root_frame_are_the_directions_joints_turn_about(tree_and_model):
    tree, _ = tree_and_model
    q = np.random.default_rng(3).uniform(-1, 1, (1, len(tree.joint_names)))
    axes = place_links(tree, q).axes()[0]
    step = 1e-6
    for j, name in enumerate(tree.joint_names):
        k = tree.joint_index[name] + 1
        if tree.joints[k - 1].kind is JointType.PRISMATIC:
            continue
        dq = np.zeros_like(q)
        dq[0, j] = step
        R0, R1 = place_links(tree, q - dq).R[0, k], place_links(tree, q + dq).R[0, k]
        W = (R1 - R0) @ place_links(tree, q).R[0, k].T / (2 * step)
        own = np.array([W[2, 1], W[0, 2], W[1, 0]])
        above = [
            joint.mimic.multiplier * axes[i]
            for i, joint in enumerate(tree.joints)
            if joint.mimic
            and joint.mimic.joint == name
            and joint.kind is not JointType.PRISMATIC
            and tree.subtree(joint.name)[k]
        ]
        np.testing.assert_allclose(own, axes[k - 1] + sum(above, np.zeros(3)), atol=1e-7)
