# SPDX-License-Identifier: Apache-2.0
"""Wiring and configuration: mistakes are named exactly, and faults are never taken for them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from comcal.diagnose.mistakes import Mistake, screen_mistakes
from comcal.diagnose.mistakes_candidates import mistakes
from comcal.measure.plan import PlannedPose
from comcal.measure.source import Block
from comcal.measure.table import PoseTable
from comcal.predict.assumed import Assumed
from comcal.robot.changes import Change, check_changes
from comcal.robot.changes_text import change_text, parse_change
from comcal.robot.healthy import draw_healthy
from comcal.robot.model import Robot
from comcal_sims.adapter import SensorAdapter, SensorErrors
from comcal_sims.builtin_world import BuiltinWorld
from comcal_sims.faults.faulty_world import FaultyWorld
from comcal_sims.faults.mistakes import Mistakes

ERRORS = SensorErrors(ft_force=0.1, ft_moment=0.01, current=0.02, imu=0.001)
"""Of a pose mean."""


def measured(
    robot: Robot, plan: Sequence[PlannedPose], seed: int, faults: Sequence[str] = ()
) -> PoseTable:
    """Measure poses of one healthy robot, with noise, and with faults on top."""
    changes = (*draw_healthy(robot, np.random.default_rng(seed)), *map(parse_change, faults))
    world = FaultyWorld(BuiltinWorld(robot), robot, changes, plan)
    adapter = SensorAdapter(robot, ERRORS, seed, changes)
    blocks: list[Block] = []
    for pose in plan:
        adapter.begin(pose.pose)
        world.place(pose)
        blocks.append(adapter.block(np.zeros(1), [world.state()]))
    n, joints = len(plan), len(robot.tree.joint_names)
    wrench = {s: np.array([b.wrenches[s][0] for b in blocks]) for s in robot.sensors}
    return PoseTable(
        pose=tuple(p.pose for p in plan),
        support=tuple(p.support for p in plan),
        q=np.array([b.q[0] for b in blocks]),
        q_cov=np.full((n, joints), ERRORS.encoder**2),
        wrench=wrench,
        wrench_cov={s: np.tile(np.diag([0.1] * 3 + [0.01] * 3) ** 2, (n, 1, 1)) for s in wrench},
        torque=np.full((n, joints), np.nan),
        torque_var=np.full((n, joints), np.nan),
        current=np.array([b.currents[0] for b in blocks if b.currents is not None]),
        current_var=np.full((n, joints), ERRORS.current**2),
        com=np.full((n, 3), np.nan),
        com_var=np.full((n, 3), np.nan),
        imu=np.array([b.imu[0] for b in blocks if b.imu is not None]),
        imu_var=np.full((n, 3), ERRORS.imu**2),
        configuration=("",) * n,
        tilt=np.full(n, np.nan),
        t=60.0 * np.arange(n),
    )


def mistaken(robot: Robot, table: PoseTable, *texts: str) -> PoseTable:
    """Let the simulator make mistakes of wiring with the means of poses: all are linear."""
    changes = [parse_change(text) for text in texts]
    check_changes(changes, robot)
    block = Block(table.t, table.q, table.wrench, currents=table.current, imu=table.imu)
    wrong = Mistakes(robot, changes).spoil(block)
    assert wrong.currents is not None
    assert wrong.imu is not None
    return replace(table, q=wrong.q, wrench=wrong.wrenches, current=wrong.currents, imu=wrong.imu)


def names(found: Sequence[Mistake]) -> list[str]:
    return [change_text(mistake.change) for mistake in found]


@pytest.fixture(scope="module")
def robot(biped14) -> Robot:
    return biped14.robot


@pytest.fixture(scope="module")
def plan(biped14) -> tuple[PlannedPose, ...]:
    """Sixteen poses: on two feet, on either one, hanging."""
    by_support = {
        s: [p for p in biped14.plan if p.support == s] for s in ("double", "left", "right", "none")
    }
    counts = {"double": 6, "left": 4, "right": 4, "none": 2}
    return tuple(p for s, number in counts.items() for p in by_support[s][:number])


@pytest.fixture(scope="module")
def healthy(robot: Robot, plan: tuple[PlannedPose, ...]) -> PoseTable:
    return measured(robot, plan, 7)


@pytest.mark.parametrize("seed", [1, 2])
def test_nothing_is_claimed_of_a_healthy_robot(
    robot: Robot, plan: tuple[PlannedPose, ...], seed: int
) -> None:
    assert screen_mistakes(Assumed(robot), measured(robot, plan, seed)) == ()


@pytest.mark.parametrize(
    "fault",
    [
        "payload@torso:mass=5,com_x=0.1,com_z=0.2",
        "ft_gain@l_foot:gain_fz=0.1,gain_tx=-0.1",
        "joint_offset@l_knee:offset=0.035",
        "ft_mounting@r_foot:rx=0.05",
        "external_contact@r_arm:force_x=-0.4,force_y=23.4,force_z=4.9,point_z=-0.6,poses={double}",
        "external_contact@l_arm:force_x=-8,force_y=10,force_z=-1.3,point_z=-0.6,poses={left}",
        "external_contact@l_arm:force_x=27,force_z=-7.4,point_z=-0.6,poses={double}",
    ],
)
def test_an_ordinary_fault_is_not_taken_for_a_mistake(
    robot: Robot, plan: tuple[PlannedPose, ...], fault: str
) -> None:
    poses = {pose.support: pose.pose for pose in reversed(plan)}
    table = measured(robot, plan, 5, [fault.format(**poses)])
    assert screen_mistakes(Assumed(robot), table) == ()


@pytest.mark.parametrize(
    "hidden",
    [
        "left_right_swap@l_foot:other=r_foot",
        "channel_swap@l_foot:channels=fy+tz",
        "frame_handedness@r_foot:axis=y",
        "unit_error@r_foot:channels=fx+fy+fz,factor=0.10197162129779283",
        "unit_error@l_foot:channels=fx+fy+fz+tx+ty+tz,factor=0.2248089430997105",
        "unit_error@l_foot:channels=fx+fy+fz+tx+ty+tz,factor=1000.0",
        "unit_error@r_foot:channels=tx+ty+tz,factor=8.850745791327185",
        "unit_error@l_shoulder:channels=q,factor=57.29577951308232",
        "sign_flip@r_hip_pitch:channels=i",
        "left_right_swap@l_shoulder:channels=q,other=r_shoulder",
        "channel_swap@waist_pitch:channels=i,other=l_hip_roll",
        "channel_swap@l_knee:channels=q,other=r_hip_pitch",
        "channel_swap@imu:channels=ax+az",
        "unit_error@imu:channels=ax+ay+az,factor=0.10197162129779283",
    ],
)
def test_a_mistake_is_named_exactly_and_undone(
    robot: Robot, healthy: PoseTable, hidden: str
) -> None:
    found = screen_mistakes(Assumed(robot), mistaken(robot, healthy, hidden))
    assert names(found) == [hidden]
    np.testing.assert_allclose(found[0].table.q, healthy.q, atol=1e-12)
    np.testing.assert_allclose(found[0].table.current, healthy.current, atol=1e-12)
    np.testing.assert_allclose(found[0].table.imu, healthy.imu, atol=1e-12)
    for sensor, wrench in healthy.wrench.items():
        np.testing.assert_allclose(found[0].table.wrench[sensor], wrench, atol=1e-9)


@pytest.mark.parametrize(
    "hidden",
    [
        ("unit_error@l_knee:channels=q,factor=57.29577951308232", "sign_flip@r_foot:channels=fz"),
        (  # a sensor in lbf and lbf in
            "unit_error@l_foot:channels=fx+fy+fz,factor=0.2248089430997105",
            "unit_error@l_foot:channels=tx+ty+tz,factor=8.850745791327185",
        ),
    ],
)
def test_two_mistakes_at_once_are_both_undone(
    robot: Robot, healthy: PoseTable, hidden: tuple[str, str]
) -> None:
    found = screen_mistakes(Assumed(robot), mistaken(robot, healthy, *hidden))
    assert sorted(names(found)) == sorted(hidden)


def test_a_mistake_is_found_beside_an_ordinary_fault(
    robot: Robot, plan: tuple[PlannedPose, ...]
) -> None:
    table = measured(robot, plan, 5, ["payload@torso:mass=5,com_x=0.1,com_z=0.2"])
    hidden = "channel_swap@l_foot:channels=tx+ty"
    assert names(screen_mistakes(Assumed(robot), mistaken(robot, table, hidden))) == [hidden]


def test_mistakes_that_come_to_the_same_are_reported_as_equal(
    robot: Robot, healthy: PoseTable
) -> None:
    spoilt = mistaken(robot, healthy, "sign_flip@imu:channels=az")
    (found,) = screen_mistakes(Assumed(robot), spoilt)
    same = {change_text(found.change), *(change_text(c) for c, odds in found.rivals if odds == 0.0)}
    assert same == {"sign_flip@imu:channels=az", "frame_handedness@imu:axis=z"}


def test_nothing_is_claimed_where_readings_do_not_show_it(
    robot: Robot, plan: tuple[PlannedPose, ...], healthy: PoseTable
) -> None:
    """A sideways channel of the IMU has no sign while the pelvis is upright."""
    upright = np.abs(healthy.imu[:, 1]) < 0.05
    upright &= np.array(healthy.support) != "none"
    assert upright.sum() >= 4
    spoilt = mistaken(robot, healthy.select(upright), "sign_flip@imu:channels=ay")
    assert screen_mistakes(Assumed(robot), spoilt) == ()


def test_only_what_the_table_has_readings_of_is_tried(robot: Robot, healthy: PoseTable) -> None:
    silent = replace(
        healthy,
        current=np.full(healthy.current.shape, np.nan),
        imu=np.full(healthy.imu.shape, np.nan),
        wrench={"l_foot": healthy.wrench["l_foot"]},
    )
    tried = mistakes(robot, silent)
    check_changes(tried, robot)
    channels = {
        c
        for change in tried
        if change.target in robot.tree.joint_names
        for c in change.words("channels")
    }
    assert channels == {"q"}
    assert not {"imu", "r_foot"} & {change.target for change in tried}


def test_every_mistake_tried_is_one_that_the_simulator_can_make(
    robot: Robot, healthy: PoseTable
) -> None:
    tried: tuple[Change, ...] = mistakes(robot, healthy)
    check_changes(tried, robot)
    assert len(tried) >= 95
    assert len({change_text(change) for change in tried}) == len(tried)
