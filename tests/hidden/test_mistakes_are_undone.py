# SPDX-License-Identifier: Apache-2.0
"""Mistakes of wiring that the simulator makes, the effects of the same names take back exactly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from comcal.effects.registry import corrected, effects
from comcal.measure.plan_csv import read_plan
from comcal.measure.source import Block
from comcal.measure.table import PoseTable
from comcal.predict.assumed import Assumed
from comcal.robot.changes import check_changes
from comcal.robot.changes_text import parse_change
from comcal.robot.description import load_robot
from comcal.robot.model import Robot, Sense
from comcal_sims.adapter import EXACT, SensorAdapter
from comcal_sims.builtin_world import BuiltinWorld
from comcal_sims.robots import biped14

HIDDEN = (
    "channel_swap@l_foot:channels=fx+ty",
    "channel_swap@imu:channels=ax+az",
    "channel_swap@l_knee:channels=i,other=l_hip_pitch",
    "channel_swap@l_knee:channels=q,other=r_knee",
    "channel_swap@l_foot:channels=fz+tx,other=r_foot",
    "sign_flip@r_foot:channels=fz",
    "sign_flip@r_foot:channels=fx+fy+fz+tx+ty+tz",
    "sign_flip@imu:channels=ax",
    "sign_flip@l_knee:channels=i",
    "sign_flip@l_knee:channels=q",
    "sign_flip@waist_roll:channels=tau",
    "unit_error@l_foot:channels=tx+ty+tz,factor=1000",
    "unit_error@l_foot:factor=0.101972",
    "unit_error@imu:factor=0.101972",
    "unit_error@waist_pitch:channels=q,factor=57.29577951308232",
    "unit_error@waist_pitch:channels=i,factor=1000",
    "frame_handedness@l_foot:axis=y",
    "frame_handedness@imu:axis=z",
    "left_right_swap@l_foot:other=r_foot",
    "left_right_swap@l_knee:other=r_knee",
    "left_right_swap@l_knee:channels=i,other=r_knee",
)


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    """The biped, its right sensor wired the other way round, one torque measured as such."""
    robot = load_robot(biped14.generate(tmp_path_factory.mktemp("biped14")))
    reversed_one = replace(robot.sensors["r_foot"], sense=Sense.ON_GROUND)
    motors = {name: motor for name, motor in robot.motors.items() if name != "waist_roll"}
    return replace(robot, sensors={**robot.sensors, "r_foot": reversed_one}, motors=motors)


@pytest.fixture(scope="module")
def true(robot: Robot) -> PoseTable:
    return recorded(robot, "")


def recorded(robot: Robot, hidden: str) -> PoseTable:
    """A few poses as the sensors tell them, without noise."""
    assert robot.yaml_path is not None
    plan = read_plan(robot.yaml_path.parent / "plan.csv", robot.tree.joint_names)[::6]
    changes = (parse_change(hidden),) if hidden else ()
    check_changes(changes, robot)
    world, adapter = BuiltinWorld(robot), SensorAdapter(robot, EXACT, 0, changes)
    blocks: list[Block] = []
    for pose in plan:
        adapter.begin(pose.pose)
        world.place(pose)
        blocks.append(adapter.block(np.zeros(1), [world.state()]))
    n, joints = len(plan), len(robot.tree.joint_names)
    sign = {s: 1.0 if robot.sensors[s].sense is Sense.ON_ROBOT else -1.0 for s in robot.sensors}
    q = np.array([block.q[0] for block in blocks])
    variances = np.tile(np.arange(1.0, joints + 1.0), (n, 1))
    wrench = {s: sign[s] * np.array([b.wrenches[s][0] for b in blocks]) for s in robot.sensors}
    return PoseTable(
        pose=tuple(p.pose for p in plan),
        support=tuple(p.support for p in plan),
        q=q,
        q_cov=variances,
        wrench=wrench,
        wrench_cov={s: np.tile(np.eye(6), (n, 1, 1)) for s in wrench},
        torque=np.array([b.torques[0] for b in blocks if b.torques is not None]),
        torque_var=variances,
        current=np.array([b.currents[0] for b in blocks if b.currents is not None]),
        current_var=variances,
        com=np.full((n, 3), np.nan),
        com_var=np.full((n, 3), np.nan),
        imu=np.array([b.imu[0] for b in blocks if b.imu is not None]),
        imu_var=np.ones((n, 3)),
        configuration=("",) * n,
        tilt=np.full(n, np.nan),
    )


def readings(table: PoseTable) -> np.ndarray:
    return np.hstack([table.q, table.current, table.torque, table.imu, *table.wrench.values()])


@pytest.mark.parametrize("hidden", HIDDEN)
def test_what_was_mistaken_is_read_again_as_it_was(
    robot: Robot, true: PoseTable, hidden: str
) -> None:
    mistaken = recorded(robot, hidden)
    _, undone = corrected(Assumed(robot), mistaken, [parse_change(hidden)])
    assert np.nanmax(np.abs(readings(mistaken) - readings(true))) > 1e-3
    np.testing.assert_allclose(readings(undone), readings(true), rtol=1e-12, atol=1e-12)


def test_errors_go_with_the_readings_they_belong_to(robot: Robot, true: PoseTable) -> None:
    cov = np.tile(np.diag([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]), (len(true), 1, 1))
    cov[:, 0, 3] = cov[:, 3, 0] = 0.5
    table = replace(true, wrench_cov={**true.wrench_cov, "l_foot": cov})

    def undone(hidden: str) -> PoseTable:
        return corrected(Assumed(robot), table, [parse_change(hidden)])[1]

    swapped = undone("channel_swap@l_foot:channels=fx+fy").wrench_cov["l_foot"][0]
    np.testing.assert_array_equal(np.diag(swapped), [2.0, 1.0, 3.0, 4.0, 5.0, 6.0])
    assert swapped[1, 3] == 0.5
    flipped = undone("sign_flip@l_foot:channels=tx").wrench_cov["l_foot"][0]
    assert flipped[0, 3] == -0.5
    exchanged = undone("left_right_swap@l_foot:other=r_foot").wrench_cov
    np.testing.assert_array_equal(exchanged["r_foot"], cov)
    sides = undone("left_right_swap@l_knee:other=r_knee")
    l_knee, r_knee = (robot.tree.joint_names.index(name) for name in ("l_knee", "r_knee"))
    assert sides.q_cov[0, l_knee] == table.q_cov[0, r_knee]


@pytest.mark.parametrize(("stated", "found"), [(0.01, 0.01), (10.0, 0.01)])
def test_errors_in_the_wrong_unit_are_told_from_errors_in_si(
    robot: Robot, stated: float, found: float
) -> None:
    table = recorded(robot, "unit_error@l_foot:channels=tx+ty+tz,factor=1000")
    cov = np.tile(np.diag([0.1] * 3 + [stated] * 3) ** 2, (len(table), 1, 1))
    table = replace(table, wrench_cov={**table.wrench_cov, "l_foot": cov})
    change = parse_change("unit_error@l_foot:channels=tx+ty+tz,factor=1000")
    _, undone = corrected(Assumed(robot), table, [change])
    assert np.sqrt(undone.wrench_cov["l_foot"][0, 3, 3]) == pytest.approx(found)


def test_every_mistake_that_is_looked_for_is_hidden_here() -> None:
    discrete = {name for name, effect in effects().items() if not effect.fault}
    assert {parse_change(text).effect for text in HIDDEN} == discrete
