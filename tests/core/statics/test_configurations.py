# SPDX-License-Identifier: Apache-2.0
"""Shapes measured at several tilts or slopes: the total CoM comes back, whatever carries it."""

from dataclasses import replace

import numpy as np
import pytest

from comcal.errors import NotARigidTiltError, RankError
from comcal.identify.calibration import Verdict, calibrate
from comcal.identify.paper_route import paper_route
from comcal.measure.plan import PlannedPose
from comcal.robot.model import Sensor
from comcal.statics.configurations import placed_in_stance
from comcal.statics.support import carrier_of


def plan_of(robot, shapes, support, tilts=(0.0,), slopes=((0.0, 0.0),)):
    """Every shape (angles by name) at every tilt of the standing ankles and on every slope."""
    names = robot.tree.joint_names
    ankles = [robot.feet[f].ankle for f in robot.feet if support in ("double", f)]
    plan = []
    for label, angles in shapes.items():
        for tilt in tilts:
            for roll, pitch in slopes:
                q = np.array([angles.get(name, 0.0) for name in names])
                for ankle in ankles:
                    q[names.index(ankle)] -= tilt
                i = len(plan) + 1
                plan.append(
                    PlannedPose(i, q, support, label, tilt, {}, floor_roll=roll, floor_pitch=pitch)
                )
    return plan


def check_totals(robot, table, found):
    """Every total CoM is that of the reference posture; carried and whole."""
    for total in found.totals:
        row = total.configuration.rows[0]
        carrier = carrier_of(robot, table.support[row])
        at = placed_in_stance(robot, carrier, table.q[row][None])
        masses = robot.tree.masses * carrier.carried
        np.testing.assert_allclose(total.carried_xyz, masses @ at.coms[0] / masses.sum(), atol=1e-9)
        np.testing.assert_allclose(total.xyz, at.total_com()[0], atol=1e-9)


SHAPES = {"a": {}, "b": {"l_knee": 0.6, "l_hip": -0.4, "r_hip": 0.2, "l_slide": 0.05}}


@pytest.mark.parametrize("support", ["left", "right"])
@pytest.mark.parametrize("tilts", [(0.0, 0.5), (-0.3, 0.4), (0.1, -0.3, 0.35), (0, -0.2, 0.2, 0.4)])
def test_any_number_of_tilts_on_one_foot_gives_the_total_com(support, tilts, odd):
    rng = np.random.default_rng(1)
    robot = odd.odd_biped(rng, yaw=0.0)
    table = odd.ideal_table(robot, plan_of(robot, SHAPES, support, tilts))
    found = paper_route(robot, table)
    assert [t.by for t in found.totals] == ["twin", "twin"]
    assert not found.refused
    for total in found.totals:
        np.testing.assert_allclose(
            total.configuration.tilts, np.subtract(tilts, tilts[0]), atol=1e-12
        )
        assert total.tilt == pytest.approx(np.ptp(tilts), abs=1e-9)
    check_totals(robot, table, found)


@pytest.mark.parametrize(
    "slopes",
    [
        ((0.0, 0.0), (0.0, 0.2)),
        ((0.1, 0.0), (-0.1, 0.0)),
        ((0.15, 0.0), (0.0, -0.1), (0.0, 0.1)),
    ],
)
@pytest.mark.parametrize("support", ["left", "double"])
def test_two_slopes_of_either_kind_give_the_total_com(slopes, support, odd):
    rng = np.random.default_rng(2)
    robot = odd.odd_biped(rng)
    table = odd.ideal_table(robot, plan_of(robot, SHAPES, support, slopes=slopes), rng=rng)
    found = paper_route(robot, table)
    assert [t.by for t in found.totals] == ["slope", "slope"]
    check_totals(robot, table, found)
    # Without a tilt the feet need not be known: CAD adds nothing.
    assert max(np.abs(t.cov_cad).max() for t in found.totals) < 1e-15


def test_a_twin_on_two_feet_gives_the_total_com(odd):
    robot = odd.odd_biped(np.random.default_rng(3), slides=False, yaw=0.1)
    table = odd.ideal_table(robot, plan_of(robot, {"a": {}}, "double", (0.0, 0.4)))
    found = paper_route(robot, table)
    assert [t.by for t in found.totals] == ["twin"]
    check_totals(robot, table, found)


@pytest.mark.parametrize("support", ["left", "double"])
def test_sensors_above_the_ankles_tilt_with_the_robot_and_give_the_total_com(support, odd):
    """P's origin is at the sensors, so the tilt axis moves in P from pose to pose."""
    robot = odd.odd_biped(np.random.default_rng(4), slides=False, yaw=0.0)
    sensors = {name: Sensor(name, f"{name[0]}_knee") for name in robot.sensors}
    robot = replace(robot, sensors=sensors)
    table = odd.ideal_table(robot, plan_of(robot, {"a": {}}, support, (0.0, -0.2, 0.4)))
    found = paper_route(robot, table)
    assert [t.by for t in found.totals] == ["twin"]
    check_totals(robot, table, found)


def test_one_label_in_two_supports_is_two_configurations(odd):
    robot = odd.odd_biped(np.random.default_rng(5), slides=False, yaw=0.0)
    shapes = {"a": {}, "b": {"l_knee": 0.6}}
    plan = [
        *plan_of(robot, shapes, "left", (0.0, 0.4)),
        *plan_of(robot, shapes, "right", (0.0, 0.4)),
    ]
    plan = [replace(p, pose=i) for i, p in enumerate(plan)]
    table = odd.ideal_table(robot, plan)
    found = paper_route(robot, table)
    assert [(t.configuration.name, t.configuration.carrier.support) for t in found.totals] == [
        ("a", "left"),
        ("b", "left"),
        ("a", "right"),
        ("b", "right"),
    ]
    check_totals(robot, table, found)
    assert found.chain is None
    assert "do not all load the same sensors" in found.reason


def test_a_turn_about_another_axis_is_no_tilt(odd):
    robot = odd.odd_biped(np.random.default_rng(6), yaw=0.0)
    plan = plan_of(robot, {"a": {}}, "left", (0.0, 0.4))
    # The sole is turned against the ankle, so the tilt axis is not the y axis of P.
    T = robot.feet["left"].T_link_sole.copy()
    s, c = np.sin(0.3), np.cos(0.3)
    T[:3, :3] = T[:3, :3] @ [[c, -s, 0], [s, c, 0], [0, 0, 1]]
    yawed = replace(robot, feet={**robot.feet, "left": replace(robot.feet["left"], T_link_sole=T)})
    found = paper_route(yawed, odd.ideal_table(yawed, plan))
    assert isinstance(found.refused[0], NotARigidTiltError)
    assert "not parallel to the y axis" in found.reason
    assert not paper_route(robot, odd.ideal_table(robot, plan)).refused


@pytest.mark.parametrize(("shift", "refused"), [(0.004, False), (0.006, True)])
def test_a_slide_between_twins_is_judged_by_how_far_it_moves(shift, refused, odd):
    robot = odd.odd_biped(np.random.default_rng(7), arm=False, yaw=0.0)
    plan = plan_of(robot, {"a": {}}, "left", (0.0, 0.4))
    plan[1].q[robot.tree.joint_names.index("r_slide")] += shift
    found = paper_route(robot, odd.ideal_table(robot, plan))
    assert bool(found.refused) is refused
    if refused:
        assert "6.0 mm" in found.refused[0].measured


def test_shapes_out_of_the_plane_keep_their_totals_and_are_solved_by_all_data(table1_roll):
    roll = {"l_hip_roll": 0.1, "r_hip_roll": 0.1, "l_ankle_roll": -0.1, "r_ankle_roll": -0.1}
    assert set(roll) <= set(table1_roll.robot.tree.joint_names)
    plan = [p for p in table1_roll.plan if p.configuration]
    sway = table1_roll.pose(**roll)
    out = [
        replace(p, pose=50 + i, configuration="out", q=p.q + sway, floor_pitch=0.1 * i, tilt=0.0)
        for i, p in enumerate([plan[0], plan[0]])
    ]
    found = calibrate(table1_roll.robot, table1_roll.measure([*plan, *out]))
    assert found.paper is not None
    assert found.paper.chain is None
    assert "out of the sagittal plane" in found.paper.reason
    assert "'out'" in found.paper.reason
    assert len(found.paper.totals) == 1 + len({p.configuration for p in plan})
    assert found.verdict is not Verdict.NOT_IDENTIFIABLE
    assert found.difference is None


def test_a_single_pose_of_a_shape_is_refused_with_the_slope_it_has(table1):
    found = paper_route(table1.robot, table1.measure(table1.plan[:1]))
    assert isinstance(found.refused[0], RankError)
    assert "has no tilted twin" in found.reason
