# SPDX-License-Identifier: Apache-2.0
"""Humanoids that are not what their URDF says, standing in MuJoCo: the truth of the study."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from comcal.errors import DataError, NotBalancedError
from comcal.identify.linearise import model_at
from comcal.identify.scope import Scope, scoped
from comcal.identify.unknowns import Unknowns, rigid_parts
from comcal.measure.plan import PlannedPose
from comcal.measure.table import PoseTable
from comcal.plan.candidates import Pool
from comcal.plan.expected import expected_table
from comcal.robot.kinematics import place_links
from comcal.robot.model import Robot
from comcal.robot.tree import Array
from comcal.statics.balance import balance_at
from comcal.statics.stance import stance_frame
from comcal.statics.static_rows import row_residual
from comcal.statics.support import carrier_of
from comcal_sims.builtin_world import static_state
from comcal_sims.mujoco_world import MujocoWorld
from comcal_sims.world import WorldState

MASS_CHANGE = 0.10
"""Masses of links are off by up to this share, evenly ..."""
COM_CHANGE = 0.020
"""... and every component of their CoMs by up to this [m]."""
SETTLING = 2.0
"""First time given to a pose [s]."""
WAIT = 0.2
"""Time between two looks at whether it is at rest [s] ..."""
STILL = 2e-4
"""... which it is when two changes of the ground wrench differ by less than this [N], [N m] ..."""
PATIENCE = 40
"""... by the time it was looked at so often."""


@dataclass(frozen=True)
class Stood:
    """What the engine says of the poses in which a robot stood.

    Parameters
    ----------
    support : tuple of str, length N
    q : array, shape (N, n_joints)
    wrench : array, shape (N, n_sensors, 6)
        In the order of ``robot.sensors``.
    torque : array, shape (N, n_joints)
    root : array, shape (N, 4, 4)
        Pose of the root link in the world.
    fallen : int
        Poses in which it did not.
    """

    support: tuple[str, ...]
    q: Array
    wrench: Array
    torque: Array
    root: Array
    fallen: int


def perturbed(unknowns: Unknowns, rng: np.random.Generator) -> Robot:
    """Return a robot whose masses and CoMs above the feet's cuts are off.

    A body's inertia tensor about its CoM grows with its mass, so it stays that of a solid.
    """
    robot = unknowns.robot
    is_free = _free_links(unknowns)
    links = list(robot.tree.links)
    for k, link in enumerate(links):
        growth = 1.0 + MASS_CHANGE * rng.uniform(-1.0, 1.0)
        shift = COM_CHANGE * rng.uniform(-1.0, 1.0, 3)
        if is_free[k] and link.mass > 0.0:
            links[k] = replace(
                link, mass=link.mass * growth, com=link.com + shift, inertia=link.inertia * growth
            )
    return replace(robot, tree=replace(robot.tree, links=tuple(links)))


def true_theta(unknowns: Unknowns, true: Robot) -> Array:
    """Return the unknowns of the true robot: links that stand for a body take all its changes."""
    tree = unknowns.robot.tree
    at = place_links(tree, np.zeros(len(tree.joint_names)))
    R, p = at.R[0], at.p[0]
    by_mass = true.tree.masses - tree.masses
    by_moment = true.tree.masses[:, None] * true.tree.coms - tree.masses[:, None] * tree.coms
    bodies, is_free = rigid_parts(unknowns.robot), _free_links(unknowns)
    theta = unknowns.cad.copy()
    for k in unknowns.links:
        mass, moment = 0.0, np.zeros(3)
        for j in np.flatnonzero((bodies == bodies[k]) & is_free):
            mass += by_mass[j]
            moment += R[k].T @ (R[j] @ by_moment[j] + by_mass[j] * (p[j] - p[k]))
        column = unknowns.column(k)
        theta[column : column + 3] += moment
        if unknowns.free_masses:
            theta[unknowns.mass_column(k)] += mass
    if not unknowns.free_masses:
        theta[0] = true.tree.total_mass
    return theta


def stand(true: Robot, poses: Pool) -> Stood:
    """Let a robot stand in every pose until it is at rest.

    Raises
    ------
    DataError
        If it does not come to rest.
    """
    states, support = list[WorldState](), list[str]()
    with MujocoWorld(true, settle=SETTLING) as world:
        for i, (name, q) in enumerate(zip(poses.support, poses.q, strict=True)):
            try:
                world.place(PlannedPose(i + 1, q, name))
            except NotBalancedError:
                continue
            states.append(_at_rest(world, true, name, i + 1))
            support.append(name)
    return Stood(
        tuple(support),
        np.array([state.q for state in states]),
        np.array([[state.wrenches[s] for s in true.sensors] for state in states]),
        np.array([state.torques for state in states]),
        np.array([state.T_world_base for state in states]),
        len(poses) - len(states),
    )


def engine_coms(true: Robot, poses: Pool) -> Array:
    """Return the engine's CoM of the whole robot in the root frame, shape (N, 3) [m]."""
    found = list[Array]()
    with MujocoWorld(true, settle=0.0) as world:
        for i, (name, q) in enumerate(zip(poses.support, poses.q, strict=True)):
            world.place(PlannedPose(i + 1, q, name))
            state = world.state()
            T = state.T_world_base
            found.append(T[:3, :3].T @ (state.com - T[:3, 3]))
    return np.array(found)


def table_of(robot: Robot, stood: Stood, sigma: tuple[float, float, float, float]) -> PoseTable:
    """Return the pose table of exact readings and stated errors.

    Parameters
    ----------
    sigma : tuple of float
        Of forces [N], moments [N m], angles [rad] and joint torques [N m].
    """
    n = len(stood.q)
    cov = np.tile(np.diag(np.repeat(np.square(sigma[:2]), 3)), (n, 1, 1))
    return replace(
        expected_table(robot, Pool(stood.support, stood.q)),
        q_cov=np.full(stood.q.shape, sigma[2] ** 2),
        wrench={s: stood.wrench[:, k] for k, s in enumerate(robot.sensors)},
        wrench_cov=dict.fromkeys(robot.sensors, cov),
        torque=stood.torque,
        torque_var=np.full(stood.torque.shape, sigma[3] ** 2),
    )


def off_statics(true: Robot, stood: Stood) -> tuple[float, float]:
    """Return how far the engine is from comcal's statics of the true robot, at most [N], [N m].

    All rows: the balance of what stands, the foot in the air, and every joint torque.
    """
    table = table_of(true, stood, (1.0, 1.0, 1.0, 1.0))
    unknowns, groups = scoped(true, table, Scope(torques=True, free_masses=True))
    force, moment = 0.0, 0.0
    for group in groups:
        wrenches, torques = group.others(group.inputs)
        left = np.abs(
            row_residual(
                group.layout,
                group.balance_at(true, group.inputs),
                wrenches,
                torques,
                model_at(unknowns, group, unknowns.cad),
            )
        )
        forces = [left[:, 0]]
        forces += [left[:, group.layout.cut_rows(i)][:, :3] for i in range(len(group.layout.cuts))]
        moments = [left[:, 1:4], left[:, group.layout.torque_rows]]
        moments += [left[:, group.layout.cut_rows(i)][:, 3:] for i in range(len(group.layout.cuts))]
        force = max([force, *(float(x.max()) for x in forces)])
        moment = max([moment, *(float(x.max()) for x in moments)])
    return force, moment


def off_builtin(true: Robot, stood: Stood) -> tuple[float, float]:
    """Return how far the engine's ground wrench is from that of the built-in world, at most.

    The built-in world stands on a floor that leans as the engine's soles do. Of two feet, the sum
    is compared [N], [N m].
    """
    off = np.zeros(2)
    sensors = list(true.sensors)
    for i, support in enumerate(stood.support):
        carrier = carrier_of(true, support)
        pose = _leaning(true, support, stood.q[i], stood.root[i])
        builtin = static_state(true, pose)
        loaded = [sensors.index(s) for s in carrier.sensors]
        both = np.stack([stood.wrench[i][loaded], [builtin.wrenches[s] for s in carrier.sensors]])
        q = np.tile(stood.q[i], (2, 1))
        one, other = balance_at(true, carrier, q, both).wrench_each.sum(axis=1)
        off = np.maximum(off, np.abs(one - other).reshape(2, 3).max(axis=1))
    return float(off[0]), float(off[1])


def ups(stood: Stood) -> Array:
    """Return the direction against gravity in the root frame, shape (N, 3)."""
    return stood.root[:, 2, :3]


def _leaning(robot: Robot, support: str, q: Array, T_world_root: Array) -> PlannedPose:
    """Return a pose on a floor that leans as the soles do."""
    R_root_P, _ = stance_frame(robot, support, place_links(robot.tree, q))
    down = (T_world_root[:3, :3] @ R_root_P[0])[2]
    return PlannedPose(
        1,
        q,
        support,
        floor_roll=float(np.arctan2(down[1], down[2])),
        floor_pitch=float(-np.arcsin(down[0])),
    )


def _at_rest(world: MujocoWorld, robot: Robot, support: str, pose: int) -> WorldState:
    """Wait until only a steady creep is left: two feet may go on sharing the load for minutes."""
    state = world.state()
    seen = [_ground_wrench(robot, support, state)]
    unsteady = np.inf
    for _ in range(PATIENCE):
        world.advance(WAIT)
        state = world.state()
        seen.append(_ground_wrench(robot, support, state))
        if len(seen) > 2:
            unsteady = float(np.abs(seen[-1] - 2.0 * seen[-2] + seen[-3]).max())
            if unsteady < STILL:
                return state
    raise DataError(
        "the robot does not come to rest",
        where=f"pose {pose}",
        measured=f"from {WAIT:g} s to the next the ground wrench changes by {unsteady:.1g} more",
        limit=f"{STILL:g} N, N m",
        next_step="look at this pose in the engine",
    )


def _ground_wrench(robot: Robot, support: str, state: WorldState) -> Array:
    carrier = carrier_of(robot, support)
    loaded = np.array([[state.wrenches[s] for s in carrier.sensors]])
    return balance_at(robot, carrier, state.q[None], loaded).wrench_each[0].sum(axis=0)


def _free_links(unknowns: Unknowns) -> np.ndarray:
    """Return the links of the bodies that are free, shape (n_links,)."""
    robot = unknowns.robot
    bodies = rigid_parts(robot)
    return np.isin(bodies, bodies[list(unknowns.links)])


def pool_of(support: Sequence[str], q: Array) -> Pool:
    """Return poses as they were stored."""
    return Pool(tuple(str(s) for s in support), q)
