# SPDX-License-Identifier: Apache-2.0
"""Trees of any shape, and the same trees and published humanoids as Pinocchio's models.

Pinocchio's floating base carries gravity's direction: a random attitude of the root is a slope.
Joints that mimic are independent in these models; what they do is folded into their leader here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from comcal.robot.frames import rotation_from_rpy, transform_from
from comcal.robot.tree import Array, Joint, JointType, Link, Mimic, Tree

KINDS = (JointType.REVOLUTE, JointType.CONTINUOUS, JointType.PRISMATIC, JointType.FIXED)
_TURNS_FOREVER = (pin.JointModelRUBX, pin.JointModelRUBY, pin.JointModelRUBZ)


def random_tree(rng: np.random.Generator) -> Tree:
    """A tree of 1 to 16 links in any order that has parents first; some links have no mass."""
    n = int(rng.integers(1, 17))
    bushy = rng.random() < 0.5  # else mostly long limbs
    links = tuple(
        Link(
            f"l{k}",
            0.0 if k and rng.random() < 0.15 else float(rng.uniform(0.1, 5.0)),
            rng.normal(0, 0.2, 3),
            np.eye(3) * 1e-2,
        )
        for k in range(n)
    )
    joints: list[Joint] = []
    for k in range(1, n):
        parent = int(rng.integers(0, k)) if bushy or rng.random() < 0.2 else k - 1
        kind = KINDS[int(rng.integers(0, len(KINDS)))]
        aligned = rng.random() < 0.5
        axis = np.eye(3)[rng.integers(0, 3)] if aligned else rng.normal(size=3)
        rpy = np.zeros(3) if rng.random() < 0.3 else rng.uniform(-3, 3, 3)
        leaders = [j for j in joints if j.is_movable and j.mimic is None]
        mimic = None
        if leaders and kind is not JointType.FIXED and rng.random() < 0.25:
            leader = leaders[int(rng.integers(0, len(leaders)))]
            mimic = Mimic(leader.name, float(rng.normal()), float(rng.normal()))
        joints.append(
            Joint(
                f"j{k}",
                kind,
                f"l{parent}",
                f"l{k}",
                transform_from(rotation_from_rpy(rpy), rng.normal(0, 0.3, 3)),
                np.zeros(3) if kind is JointType.FIXED else axis / np.linalg.norm(axis),
                mimic=mimic,
            )
        )
    return Tree("random", links, tuple(joints))


def model_of(tree: Tree) -> pin.Model:
    """The tree joint by joint, on a free-flyer."""
    model = pin.Model()
    root = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root_joint")
    at = {tree.links[0].name: (root, pin.SE3.Identity())}
    for joint in tree.joints:
        parent, placement = at[joint.parent]
        placement = placement * pin.SE3(joint.T_parent_joint)
        at[joint.child] = (parent, placement)
        if joint.is_movable:
            made = model.addJoint(parent, _joint_model(joint), placement, joint.name)
            at[joint.child] = (made, pin.SE3.Identity())
    for link in tree.links:
        index, placement = at[link.name]
        body = pin.Inertia(link.mass, link.com, link.inertia * link.mass)
        model.appendBodyToJoint(index, body, placement)
        model.addBodyFrame(link.name, index, placement, 0)
    return model


def _joint_model(joint: Joint) -> pin.JointModel:
    if joint.kind is JointType.PRISMATIC:
        return pin.JointModelPrismaticUnaligned(joint.axis)
    if joint.kind is JointType.CONTINUOUS and joint.axis.max() == 1.0:
        return _TURNS_FOREVER[int(joint.axis.argmax())]()
    return pin.JointModelRevoluteUnaligned(joint.axis)


@dataclass(frozen=True)
class Expected:
    """What Pinocchio says of one pose, in comcal's order, mimics folded into their leaders.

    All in the root frame; ``up`` is the direction up. Six columns of the base's velocity (linear,
    angular, in its own axes) come first in ``jacobian``. Rows: wrench on the root, then torques;
    ``standing``: the same loads when only the link *on* is held, its wrench in its own frame.
    """

    up: Array
    com: Array
    jacobian: Array
    loads: Array
    regressor: Array
    standing: Array


def expected(
    tree: Tree, model: pin.Model, q: Array, rng: np.random.Generator, on: str | None = None
) -> Expected:
    """Ask Pinocchio about the pose *q* with the root at a random place and attitude."""
    data = model.createData()
    quaternion = pin.Quaternion(pin.Quaternion(*(rng.normal(size=4))).normalized().matrix())
    root = pin.SE3(quaternion, rng.normal(size=3))
    value = dict(zip(tree.joint_names, q, strict=True))
    fold = np.zeros((6 + len(q), model.nv))
    fold[:6, :6] = np.eye(6)
    configuration = pin.neutral(model)
    configuration[:7] = pin.SE3ToXYZQUAT(root)
    for joint in tree.joints:
        if not joint.is_movable:
            continue
        leader, multiplier, offset = joint.name, 1.0, 0.0
        if joint.mimic is not None:
            leader = joint.mimic.joint
            multiplier, offset = joint.mimic.multiplier, joint.mimic.offset
        position = multiplier * value[leader] + offset
        made = model.joints[model.getJointId(joint.name)]
        at = made.idx_q
        if made.nq == 2:
            configuration[at : at + 2] = np.cos(position), np.sin(position)
        else:
            configuration[at] = position
        fold[6 + tree.joint_names.index(leader), made.idx_v] = multiplier
    zero = np.zeros(model.nv)
    com = root.actInv(pin.centerOfMass(model, data, configuration).copy())
    jacobian = root.rotation.T @ pin.jacobianCenterOfMass(model, data, configuration) @ fold.T
    loads = fold @ pin.computeGeneralizedGravity(model, data, configuration)
    regressor = pin.computeJointTorqueRegressor(model, data, configuration, zero, zero)
    names = ["root_joint", *(j.name for j in tree.joints if j.is_movable)]
    columns = [10 * (model.getJointId(name) - 1) + c for name in names for c in range(4)]
    frame = model.getFrameId(on or tree.links[0].name, pin.FrameType.BODY)
    J = pin.computeFrameJacobian(model, data, configuration, frame, pin.ReferenceFrame.LOCAL)
    wrench = np.linalg.solve(J[:, :6].T, loads[:6])
    standing = np.concatenate([wrench, loads[6:] - (fold @ J.T @ wrench)[6:]])
    up = root.rotation[2].copy()
    return Expected(up, com, jacobian, loads, fold @ regressor[:, columns], standing)
