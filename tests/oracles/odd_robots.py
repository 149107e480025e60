# SPDX-License-Identifier: Apache-2.0
"""Awkward robots, and what their sensors read in any pose, balanced or not.

Every link frame is turned at random, hips lean, shanks slide, an arm mimics a knee. The wrenches
come from the weights alone: nothing of comcal's statics is used.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from comcal.measure.plan import PlannedPose
from comcal.measure.table import PoseTable
from comcal.robot.frames import rotation_from_rpy, transform_from
from comcal.robot.kinematics import place_links
from comcal.robot.model import Foot, Robot, Sensor
from comcal.robot.tree import Array, Joint, JointType, Link, Mimic, Tree

SOLE = np.array([[0.12, 0.06], [-0.08, 0.06], [-0.08, -0.06], [0.12, -0.06]])
FORCE, MOMENT, ENCODER = 0.1, 0.01, 3e-4
"""Errors of a pose mean [N, N m, rad or m]."""


def odd_biped(
    rng: np.random.Generator, *, slides: bool = True, arm: bool = True, yaw: float = 0.15
) -> Robot:
    """A biped of 30 kg; at q = 0 the root stands upright, its feet 0.2 m apart and yawed."""
    made: list[tuple[str, str, str, JointType, Array, Array, float, Mimic | None]] = []

    def add(
        name: str,
        parent: str,
        child: str,
        at: Sequence[float],
        mass: float,
        axis: Sequence[float] = (),
        kind: JointType = JointType.REVOLUTE,
        mimic: Mimic | None = None,
    ) -> None:
        kind = kind if len(axis) else JointType.FIXED
        direction = np.array(axis or (0, 0, 0), dtype=float)
        size = np.linalg.norm(direction)
        made.append(
            (name, parent, child, kind, np.array(at, float), direction / (size or 1), mass, mimic)
        )

    for s, side in (("l", 1.0), ("r", -1.0)):
        hip = (float(rng.normal(0, 0.3)), 1.0, float(rng.normal(0, 0.3)))
        add(f"{s}_hip", "torso", f"{s}_thigh", (0, 0.1 * side, -0.1), 3.0, hip)
        add(f"{s}_knee", f"{s}_thigh", f"{s}_shank", (0, 0, -0.4), 2.0, (0, 1, 0))
        ankle_parent = f"{s}_shank"
        if slides:
            lean = (float(rng.normal(0, 0.3)), float(rng.normal(0, 0.3)), 1.0)
            add(
                f"{s}_slide", ankle_parent, f"{s}_rod", (0, 0, -0.2), 0.7, lean, JointType.PRISMATIC
            )
            ankle_parent = f"{s}_rod"
        add(f"{s}_ankle", ankle_parent, f"{s}_foot", (0, 0, -0.2), 1.0, (0, 1, 0))
        add(f"{s}_ft", f"{s}_foot", f"{s}_sole", (0.01, 0.02, -0.05), 0.3)
    if arm:
        lean = (1.0, float(rng.normal()), float(rng.normal()))
        mimic = Mimic("l_knee", -0.7, 0.2)
        add("arm", "torso", "forearm", (0.1, 0.2, 0.3), 1.5, lean, JointType.REVOLUTE, mimic)
        push = Mimic("r_hip", 0.3, -0.05)
        add("grip", "forearm", "hand", (0.3, 0, 0), 0.5, (0, 1, 1), JointType.PRISMATIC, push)

    # Of every link frame, its axes in those of the upright root.
    axes = {"torso": np.eye(3)}
    links = [_link("torso", 14.0, rng, np.eye(3))]
    joints: list[Joint] = []
    for name, parent, child, kind, at, axis, mass, mimic in made:
        R = rotation_from_rpy(rng.uniform(-3, 3, 3))
        axes[child] = R
        T = transform_from(axes[parent].T @ R, axes[parent].T @ at)
        joints.append(Joint(name, kind, parent, child, T, R.T @ axis, mimic=mimic))
        links.append(_link(child, mass, rng, R))
    feet: dict[str, Foot] = {}
    for s, name in (("r", "right"), ("l", "left")):
        turn = rotation_from_rpy([0, 0, float(rng.normal(0, yaw))])
        T = transform_from(axes[f"{s}_sole"].T @ turn, axes[f"{s}_sole"].T @ [0.0, 0.0, -0.03])
        feet[name] = Foot(name, f"{s}_sole", f"{s}_ft", SOLE, T, f"{s}_ankle")
    sensors = {f"{s}_ft": Sensor(f"{s}_ft", f"{s}_ft") for s in "rl"}
    return Robot("odd", Tree("odd", tuple(links), tuple(joints)), sensors=sensors, feet=feet)


def _link(name: str, mass: float, rng: np.random.Generator, R: Array) -> Link:
    com = R.T @ (rng.normal(0, 0.03, 3) - np.array([0, 0, 0.05]))
    return Link(name, mass, com, np.eye(3) * 1e-2)


def rooted_at(robot: Robot, new_root: str) -> Robot:
    """The same robot with the same joint positions, its tree rooted at another link.

    A link on the way gets the frame of the joint that used to carry its child.
    """
    tree = robot.tree
    moved = {new_root: np.eye(4)}  # pose of the new link frame in the old one
    flipped: set[str] = set()
    k = tree.link_index[new_root]
    while k > 0:
        joint = tree.joints[k - 1]
        moved[joint.parent] = joint.T_parent_joint
        flipped.add(joint.name)
        k = int(tree.parents[k])
    frames = {link.name: moved.get(link.name, np.eye(4)) for link in tree.links}
    inverse = {name: np.linalg.inv(T) for name, T in frames.items()}
    queue, seen = deque([new_root]), {new_root}
    joints: list[Joint] = []
    order = [new_root]
    while queue:
        at = queue.popleft()
        for joint in tree.joints:
            if joint.parent == at and joint.child not in seen:
                new = replace(joint, T_parent_joint=inverse[at] @ joint.T_parent_joint)
            elif joint.child == at and joint.parent not in seen and joint.name in flipped:
                new = replace(
                    joint,
                    parent=at,
                    child=joint.parent,
                    T_parent_joint=inverse[at],
                    axis=-joint.axis,
                )
            else:
                continue
            joints.append(new)
            order.append(new.child)
            seen.add(new.child)
            queue.append(new.child)
    links = tuple(_in_frame(tree.links[tree.link_index[n]], inverse[n]) for n in order)
    feet = {
        name: replace(foot, T_link_sole=inverse[foot.link] @ foot.T_link_sole)
        for name, foot in robot.feet.items()
    }
    return replace(robot, tree=Tree(tree.name, links, tuple(joints)), feet=feet)


def turned_sensor(robot: Robot, sensor: str, R: Array) -> Robot:
    """The same robot with the frame of a sensor's joint, and of the link beyond it, turned by R."""
    tree, T = robot.tree, transform_from(R, np.zeros(3))
    turned = tree.joints[tree.joint_index[robot.sensors[sensor].joint]]
    joints = tuple(
        replace(j, T_parent_joint=j.T_parent_joint @ T, axis=R.T @ j.axis)
        if j is turned
        else replace(j, T_parent_joint=T.T @ j.T_parent_joint)
        if j.parent == turned.child
        else j
        for j in tree.joints
    )
    links = tuple(_in_frame(k, T.T) if k.name == turned.child else k for k in tree.links)
    feet = {
        name: replace(foot, T_link_sole=T.T @ foot.T_link_sole)
        if foot.link == turned.child
        else foot
        for name, foot in robot.feet.items()
    }
    return replace(robot, tree=Tree(tree.name, links, joints), feet=feet)


def _in_frame(link: Link, T: Array) -> Link:
    R = T[:3, :3]
    return replace(link, com=R @ link.com + T[:3, 3], inertia=R @ link.inertia @ R.T)


def standing_names(robot: Robot, support: str) -> list[str]:
    return list(robot.feet) if support == "double" else [support]


def ideal_table(
    robot: Robot,
    plan: Sequence[PlannedPose],
    *,
    true_robot: Robot | None = None,
    rng: np.random.Generator | None = None,
) -> PoseTable:
    """What the foot sensors read while *plan* is held; they carry any moment.

    The floor leans by ``floor_roll`` and ``floor_pitch`` against the sole of the first foot of
    robot.yaml that stands. With *rng* the feet share the load at random, else equally.
    """
    true = true_robot or robot
    q = np.array([pose.q for pose in plan])
    at = place_links(true.tree, q)
    wrench = {name: np.full((len(plan), 6), 0.0) for name in true.sensors}
    for i, pose in enumerate(plan):
        feet = [true.feet[f] for f in standing_names(true, pose.support)]
        floor = rotation_from_rpy([0, pose.floor_pitch, 0]) @ rotation_from_rpy(
            [pose.floor_roll, 0, 0]
        )
        sole = at.link(feet[0].link)[0][i] @ feet[0].T_link_sole[:3, :3]
        up = sole @ floor.T @ [0.0, 0.0, 1.0]
        below = np.any([true.below_cut[f.sensor] for f in feet], axis=0)
        m = true.tree.masses * ~below
        force = m.sum() * true.gravity * up
        moment = np.cross(m @ at.coms[i], true.gravity * up)
        shares = np.ones(len(feet)) / len(feet)
        extra = np.zeros((len(feet), 6))
        if rng is not None and len(feet) > 1:
            shares = rng.dirichlet(np.ones(len(feet)))
            extra[:-1] = rng.normal(0, 8.0, (len(feet) - 1, 6))
            extra[-1] = -extra[:-1].sum(axis=0)
        for foot, share, e in zip(feet, shares, extra, strict=True):
            R, p = (x[i] for x in at.joint(true.sensors[foot.sensor].joint))
            F, M = share * force + e[:3], share * moment + e[3:]
            wrench[foot.sensor][i] = np.concatenate([R.T @ F, R.T @ (M - np.cross(p, F))])
    return table_of(robot, plan, wrench)


def table_of(robot: Robot, plan: Sequence[PlannedPose], wrench: dict[str, Array]) -> PoseTable:
    """A table of poses with the errors above, and no other columns."""
    n, m = len(plan), len(robot.tree.joint_names)
    cov = np.diag([FORCE**2] * 3 + [MOMENT**2] * 3)
    nan = np.full((n, m), np.nan)
    return PoseTable(
        pose=tuple(pose.pose for pose in plan),
        support=tuple(pose.support for pose in plan),
        q=np.array([pose.q for pose in plan]),
        q_cov=np.full((n, m), ENCODER**2),
        wrench=wrench,
        wrench_cov={name: np.tile(cov, (n, 1, 1)) for name in wrench},
        torque=nan,
        torque_var=nan,
        current=nan,
        current_var=nan,
        com=np.full((n, 3), np.nan),
        com_var=np.full((n, 3), np.nan),
        imu=np.full((n, 3), np.nan),
        configuration=tuple(pose.configuration for pose in plan),
        tilt=np.full(n, np.nan),
    )


def noisy(table: PoseTable, rng: np.random.Generator) -> PoseTable:
    """The same poses with the errors that the table states, tares included."""
    wrench: dict[str, Array] = {}
    for name, w in table.wrench.items():
        root = np.linalg.cholesky(table.wrench_cov[name])
        wrench[name] = w + np.einsum("nij,nj->ni", root, rng.standard_normal(w.shape))
        if name in table.tare_cov:
            wrench[name] += rng.multivariate_normal(np.zeros(6), table.tare_cov[name])
    q = table.q + np.sqrt(table.q_cov) * rng.standard_normal(table.q.shape)
    return replace(table, q=q, wrench=wrench)
