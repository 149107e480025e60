# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from comcal.errors import DataError
from comcal.measure.inertia import inertial_loads, neglected_wrenches
from comcal.measure.quasi_static import QuasiStatic, differentiate, motion_score, slowest_windows
from comcal.robot.frames import transform_from
from comcal.robot.kinematics import place_links
from comcal.robot.model import Plate, Robot
from comcal.robot.tree import Joint, JointType, Link, Tree


@pytest.fixture
def pendulum() -> Robot:
    """One link of 3 kg on the root, turning about y; its CoM is 0.4 m up, its inertia known."""
    links = (
        Link("foot", 1.0, np.zeros(3), np.zeros((3, 3))),
        Link("leg", 3.0, np.array([0.0, 0.0, 0.4]), np.diag([0.1, 0.2, 0.3])),
    )
    joint = Joint(
        "ankle",
        JointType.REVOLUTE,
        "foot",
        "leg",
        transform_from(np.eye(3), [0.0, 0.0, 0.1]),
        np.array([0.0, 1.0, 0.0]),
    )
    return Robot(
        "pendulum",
        Tree("pendulum", links, (joint,)),
        plates={"floor": Plate("floor", "foot", ("stand",))},
    )


def test_a_turning_link_needs_the_force_and_moment_of_newton_and_euler(pendulum: Robot) -> None:
    q, qd, qdd = 0.3, 2.0, -5.0
    loads = inertial_loads(pendulum, np.array([[q]]), np.array([[qd]]), np.array([[qdd]]), "foot")
    tangential, centripetal = 0.4 * qdd, 0.4 * qd**2
    force = 3.0 * np.array(
        [
            tangential * np.cos(q) - centripetal * np.sin(q),
            0.0,
            -tangential * np.sin(q) - centripetal * np.cos(q),
        ]
    )
    wrench = loads.wrench(np.array([False, True]), np.eye(3)[None], np.array([[0.0, 0.0, 0.1]]))
    np.testing.assert_allclose(wrench[0, :3], force, atol=1e-5)
    moment_about_ankle = (0.2 + 3.0 * 0.4**2) * qdd
    np.testing.assert_allclose(wrench[0, 3:], [0.0, moment_about_ankle, 0.0], atol=1e-5)


def random_motion(robot: Robot, n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    generator = np.random.default_rng(5)
    shape = (n, len(robot.tree.joint_names))
    return (
        generator.normal(0.0, 0.3, shape),
        generator.normal(0.0, 1.0, shape),
        generator.normal(0.0, 3.0, shape),
    )


def test_inertial_force_is_the_second_derivative_of_the_centre_of_mass(biped: Robot) -> None:
    q, qd, qdd = random_motion(biped, 6)
    loads = inertial_loads(biped, q, qd, qdd, "torso")
    step = 1e-4
    com = [
        place_links(biped.tree, q + qd * s + 0.5 * qdd * s**2).total_com() for s in (-step, 0, step)
    ]
    acceleration = (com[0] - 2 * com[1] + com[2]) / step**2
    np.testing.assert_allclose(
        loads.force.sum(axis=1), biped.tree.total_mass * acceleration, atol=1e-3
    )


def test_neglected_loads_do_not_depend_on_which_link_is_the_root(biped: Robot) -> None:
    """Seen from the resting foot, everything else moves the same, wherever the tree begins."""
    q, qd, qdd = random_motion(biped, 4)
    one = inertial_loads(biped, q, qd, qdd, "l_sole")
    rest = [link.name for link in biped.tree.links].index("l_sole")
    np.testing.assert_allclose(one.force[:, rest], 0.0, atol=1e-6)
    np.testing.assert_allclose(one.moment[:, rest], 0.0, atol=1e-6)
    assert np.linalg.norm(one.force[:, 0], axis=1).min() > 1.0


def test_inertia_matches_an_independent_library() -> None:
    pin = pytest.importorskip("pinocchio")
    urdf = """<robot name="arm"><link name="root"/>
      <link name="a"><inertial><mass value="2"/><origin xyz="0.1 0.05 0.3" rpy="0.2 0.1 0.3"/>
        <inertia ixx="0.3" iyy="0.2" izz="0.15" ixy="0.01" ixz="0.02" iyz="-0.01"/></inertial>
        </link>
      <link name="b"><inertial><mass value="1.5"/><origin xyz="-0.05 0.1 0.2"/>
        <inertia ixx="0.1" iyy="0.12" izz="0.05" ixy="0" ixz="0.01" iyz="0"/></inertial></link>
      <joint name="j1" type="revolute"><parent link="root"/><child link="a"/>
        <origin xyz="0 0 0.1" rpy="0 0.3 0"/><axis xyz="0 1 0"/>
        <limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
      <joint name="j2" type="revolute"><parent link="a"/><child link="b"/>
        <origin xyz="0.1 0 0.5" rpy="0.1 0 0.5"/><axis xyz="1 0 0"/>
        <limit lower="-3" upper="3" effort="1" velocity="1"/></joint></robot>"""
    model = pin.buildModelFromXML(urdf)
    data = model.createData()
    q, qd, qdd = np.array([0.4, -0.7]), np.array([1.5, -2.0]), np.array([-3.0, 4.0])
    pin.computeCentroidalMomentumTimeVariation(model, data, q, qd, qdd)
    from comcal.robot.frames import rotation_from_rpy

    R_a = rotation_from_rpy([0.2, 0.1, 0.3])
    I_a = np.array([[0.3, 0.01, 0.02], [0.01, 0.2, -0.01], [0.02, -0.01, 0.15]])
    I_b = np.array([[0.1, 0.0, 0.01], [0.0, 0.12, 0.0], [0.01, 0.0, 0.05]])
    links = (
        Link("root", 0.0, np.zeros(3), np.zeros((3, 3))),
        Link("a", 2.0, np.array([0.1, 0.05, 0.3]), R_a @ I_a @ R_a.T),
        Link("b", 1.5, np.array([-0.05, 0.1, 0.2]), I_b),
    )
    joints = (
        Joint(
            "j1",
            JointType.REVOLUTE,
            "root",
            "a",
            transform_from(rotation_from_rpy([0, 0.3, 0]), [0, 0, 0.1]),
            np.array([0.0, 1.0, 0.0]),
        ),
        Joint(
            "j2",
            JointType.REVOLUTE,
            "a",
            "b",
            transform_from(rotation_from_rpy([0.1, 0, 0.5]), [0.1, 0, 0.5]),
            np.array([1.0, 0.0, 0.0]),
        ),
    )
    robot = Robot("arm", Tree("arm", links, joints))
    loads = inertial_loads(robot, q[None], qd[None], qdd[None], "root")
    com = place_links(robot.tree, q).total_com()
    wrench = loads.wrench(np.ones(3, dtype=np.bool_), np.eye(3)[None], com)
    np.testing.assert_allclose(wrench[0, :3], data.dhg.linear, atol=1e-5)
    np.testing.assert_allclose(wrench[0, 3:], data.dhg.angular, atol=1e-5)


def test_two_feet_share_what_one_would_feel(biped: Robot) -> None:
    q, qd, qdd = random_motion(biped, 3)
    wrenches, cop = neglected_wrenches(biped, q, qd, qdd, "double")
    assert set(wrenches) == {"l", "r"}
    assert cop.shape == (3, 2)
    single, _ = neglected_wrenches(biped, q, 0 * qd, 0 * qdd, "left")
    np.testing.assert_allclose(single["l"], 0.0, atol=1e-6)


def test_the_pressure_error_is_height_times_acceleration_over_g(pendulum: Robot) -> None:
    from comcal.robot.model import Foot

    foot = Foot("stand", "foot", None, None, np.eye(4), "ankle")
    robot = replace(pendulum, feet={"stand": foot})
    q, qd, qdd = np.zeros((1, 1)), np.zeros((1, 1)), np.array([[1.0]])
    wrenches, cop = neglected_wrenches(robot, q, qd, qdd, "stand")
    moment = (0.2 + 3.0 * 0.4 * 0.5) * 1.0
    np.testing.assert_allclose(wrenches["floor"][0, 4], moment, rtol=1e-5)
    np.testing.assert_allclose(cop[0], [-moment / (4.0 * 9.81), 0.0], atol=1e-7)


def test_derivatives_of_a_smooth_motion_are_found() -> None:
    t = np.arange(0.0, 4.0, 0.01)
    q = np.column_stack([np.sin(t), 0.5 * t**2])
    qd, qdd = differentiate(t, q, 0.3)
    inner = slice(30, -30)
    np.testing.assert_allclose(qd[inner, 0], np.cos(t)[inner], atol=1e-3)
    np.testing.assert_allclose(qdd[inner, 0], -np.sin(t)[inner], atol=1e-2)
    np.testing.assert_allclose(qdd[inner, 1], 1.0, atol=1e-6)


def test_a_cubic_is_differentiated_exactly_up_to_both_ends() -> None:
    t = np.arange(0.0, 1.0, 0.01)
    qd, qdd = differentiate(t, (1.0 - 2.0 * t + 3.0 * t**2 - 4.0 * t**3)[:, None], 0.2)
    np.testing.assert_allclose(qd[:, 0], -2.0 + 6.0 * t - 12.0 * t**2, atol=1e-8)
    np.testing.assert_allclose(qdd[:, 0], 6.0 - 24.0 * t, atol=1e-6)


def test_irregular_or_short_logs_are_not_differentiated() -> None:
    t = np.arange(0.0, 1.0, 0.01)
    q = np.zeros((t.size, 1))
    with pytest.raises(DataError, match="not sampled regularly"):
        differentiate(np.where(t > 0.5, t + 0.2, t), q, 0.3)
    with pytest.raises(DataError, match="too short"):
        differentiate(t[:6], q[:6], 0.3)


def test_scattered_times_are_interpolated() -> None:
    rng = np.random.default_rng(5)
    t = np.arange(0.0, 4.0, 0.01) + rng.uniform(0.0, 0.004, 400)
    t = np.delete(t, [100, 101])
    qd, qdd = differentiate(t, np.sin(t)[:, None], 0.3)
    inner = slice(30, -30)
    np.testing.assert_allclose(qd[inner, 0], np.cos(t)[inner], atol=3e-3)
    np.testing.assert_allclose(qdd[inner, 0], -np.sin(t)[inner], atol=3e-2)


def test_the_slowest_windows_are_chosen_and_spread_over_postures() -> None:
    t = np.arange(0.0, 20.0, 0.01)
    q = (np.cos(0.6 * t) * 0.5)[:, None]
    qd, qdd = (-0.3 * np.sin(0.6 * t))[:, None], (-0.18 * np.cos(0.6 * t))[:, None]
    options = QuasiStatic(window=0.3, spread=0.2, per_posture=2)
    windows = slowest_windows(t, q, qd, qdd, ("",) * t.size, options)
    assert all(a.stop <= b.start for a, b in pairwise(windows))
    postures = np.array([q[w].mean() for w in windows])
    assert np.ptp(postures) > 0.8
    for posture in postures:
        assert (np.abs(postures - posture) < 0.1).sum() <= 2 * options.per_posture
    score = motion_score(qd, qdd)
    best = min(windows, key=lambda w: float(np.mean(score[w] ** 2)))
    every = [float(np.mean(score[i : i + 30] ** 2)) for i in range(t.size - 30)]
    assert np.mean(score[best] ** 2) == pytest.approx(min(every), rel=1e-6)


def test_a_window_never_spans_two_supports() -> None:
    t = np.arange(0.0, 2.0, 0.01)
    still = np.zeros((t.size, 1))
    labels = ("left",) * 95 + ("right",) * 105
    options = QuasiStatic(window=0.2, per_posture=50)
    for w in slowest_windows(t, still, still, still, labels, options):
        assert len(set(labels[w])) == 1
    with pytest.raises(DataError, match="shorter than one window"):
        slowest_windows(t[:5], still[:5], still[:5], still[:5], labels[:5], options)
