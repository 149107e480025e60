# SPDX-License-Identifier: Apache-2.0
"""``comcal plan``: robot.yaml in, a set of informative balanced poses and its forecast out."""

from __future__ import annotations

import secrets
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from comcal.errors import ConfigError, NotBalancedError
from comcal.identify.unknowns import unknowns_of
from comcal.measure.plan import DOUBLE, PlannedPose
from comcal.measure.plan_csv import write_plan
from comcal.measure.table import PoseTable
from comcal.plan.avoid import Avoided
from comcal.plan.candidates import Progress, random_pool, silent
from comcal.plan.collision import is_available
from comcal.plan.design import Goal
from comcal.plan.expected import expected_table
from comcal.plan.forecast import Forecast, forecast
from comcal.plan.order import longest_move
from comcal.plan.rules import Rules, rules_of
from comcal.plan.search import Found, search
from comcal.robot.description import load_robot
from comcal.robot.model import Robot
from comcal.workflow.avoid_file import read_avoided
from comcal.workflow.calibrate import load_session

SEED_BITS = 32


@dataclass(frozen=True)
class PlanOrder:
    """What to plan.

    Parameters
    ----------
    robot_yaml, output : Path
        The description, and the plan.csv to write; it must not exist.
    n : int
    supports : tuple of str
        Empty: both feet, then each foot.
    goal : Goal
    margin : float
        Of the CoM inside the support polygon [m].
    joint_range : float
        Middle share of every joint's range that may be used.
    seed : int or None
        None: a fresh one.
    improve : Path or None
        Session whose poses are there already.
    avoid : Path or None
    free_masses : bool
        Plan for the mass of every link, too.
    """

    robot_yaml: Path
    output: Path
    n: int
    supports: tuple[str, ...] = ()
    goal: Goal = Goal.DOPT
    margin: float = 0.015
    joint_range: float = 0.95
    seed: int | None = None
    improve: Path | None = None
    avoid: Path | None = None
    free_masses: bool = False


@dataclass(frozen=True)
class Planned:
    """A plan, what it promises, and what was and was not checked.

    Parameters
    ----------
    before : Forecast or None
        What the poses of ``improve`` promise by themselves.
    longest_move : float
        Of any joint between consecutive poses [rad] or [m].
    collision_pairs : int
        Pairs of solids that were kept apart.
    unchecked : tuple of str
        In words, what nobody looked at.
    notes : tuple of str
        Supports that were left out, and why.
    """

    order: PlanOrder
    robot: Robot
    seed: int
    supports: tuple[str, ...]
    poses: tuple[PlannedPose, ...]
    found: Found
    forecast: Forecast
    before: Forecast | None
    longest_move: float
    collision_pairs: int
    unchecked: tuple[str, ...]
    notes: tuple[str, ...]


def plan_poses(order: PlanOrder, progress: Progress = silent) -> Planned:
    """Plan poses and write them to ``order.output``.

    Raises
    ------
    UsageError
        If robot, supports, margin, session or file to avoid are not usable.
    DataError
        If the recorded poses are not, or no pose stands in some support.
    """
    robot = load_robot(order.robot_yaml)
    if order.output.exists():
        raise ConfigError(
            "this file exists and is not overwritten",
            where=str(order.output),
            next_step="give another name with -o",
        )
    supports = order.supports or _supports(robot)
    avoided = read_avoided(order.avoid, robot.tree) if order.avoid else Avoided()
    recorded, first = None, 1
    if order.improve is not None:
        recorded = _recorded(order.improve, robot)
        first = max(recorded.pose) + 1
    rules = rules_of(robot, supports, margin=order.margin, share=order.joint_range, avoided=avoided)
    unknowns = unknowns_of(robot, free_masses=order.free_masses)
    seed = secrets.randbits(SEED_BITS) if order.seed is None else order.seed
    notes: tuple[str, ...] = ()
    if not order.supports:
        rules, notes = _possible(rules, seed)
    found = search(
        rules,
        unknowns,
        order.n,
        np.random.default_rng(seed),
        goal=order.goal,
        recorded=recorded,
        progress=progress,
    )
    tables = [expected_table(robot, found.poses)]
    before = None
    if recorded is not None:
        before = forecast(unknowns, found.held_out, recorded)
        tables.append(recorded)
    poses = tuple(
        PlannedPose(first + i, q, support)
        for i, (support, q) in enumerate(zip(found.poses.support, found.poses.q, strict=True))
    )
    write_plan(order.output, poses, robot.tree.joint_names)
    return Planned(
        order=order,
        robot=robot,
        seed=seed,
        supports=tuple(rules.stands),
        poses=poses,
        found=found,
        forecast=forecast(unknowns, found.held_out, *tables),
        before=before,
        longest_move=longest_move(found.poses),
        collision_pairs=len(rules.collisions.pairs),
        unchecked=_unchecked(rules),
        notes=notes,
    )


def _supports(robot: Robot) -> tuple[str, ...]:
    if not robot.feet:
        raise ConfigError(
            "a robot without feet cannot stand",
            where=str(robot.yaml_path or robot.name),
            next_step="describe its `feet:` in robot.yaml",
        )
    return (DOUBLE, *robot.feet) if len(robot.feet) > 1 else tuple(robot.feet)


def _possible(rules: Rules, seed: int) -> tuple[Rules, tuple[str, ...]]:
    """Return the rules for those supports in which some pose stands; say which are left out."""
    stands, refused = dict(rules.stands), list[NotBalancedError]()
    for support, stand in rules.stands.items():
        try:
            alone = replace(rules, stands={support: stand})
            random_pool(alone, 1, np.random.default_rng(seed))
        except NotBalancedError as error:
            refused.append(error)
            del stands[support]
    if not stands:
        raise refused[0]
    return replace(rules, stands=stands), tuple(
        f"{error.what}: it is left out ({error.measured})" for error in refused
    )


def _recorded(directory: Path, robot: Robot) -> PoseTable:
    """Read the poses of a session of the same robot."""
    session, other, table = load_session(directory)
    if other.tree.joint_names != robot.tree.joint_names:
        raise ConfigError(
            "this session was made with another robot: its joints are not the same",
            where=str(session.robot_yaml),
            next_step="give the robot.yaml of that session",
        )
    return table


def _unchecked(rules: Rules) -> tuple[str, ...]:
    """Say what nobody looked at."""
    notes: list[str] = []
    if not is_available():
        notes.append("self-collision: nothing was checked; pip install 'comcal[plan]'")
    elif rules.solids.unread or rules.solids.shapeless:
        names = [*rules.solids.unread, *rules.solids.shapeless]
        shown = ", ".join(names[:6]) + (f" and {len(names) - 6} more" if len(names) > 6 else "")
        notes.append(f"self-collision of {len(names)} links without readable geometry: {shown}")
    notes.append("the way from pose to pose, and everything around the robot")
    return tuple(notes)
