# SPDX-License-Identifier: Apache-2.0
"""What is read off the URDF about feet: the lowest face, its outline, the ankle."""

from __future__ import annotations

import numpy as np
import pytest

from comcal.robot.soles import default_ankle, default_sole_frame, place_at_zero, sole_rectangle
from comcal.robot.urdf import read_urdf


def robot(collision: str, rpy: str = "0 0 0", axis: str = "0 1 0", ankle_rpy: str = "0 0 0") -> str:
    """A pelvis, a shin and a foot whose link frame is turned by *rpy* against the pelvis."""
    return f"""<robot name="r"><link name="pelvis"/><link name="shin"/><link name="toe"/>
    <link name="foot">{collision}</link>
    <joint name="hip" type="revolute"><parent link="pelvis"/><child link="shin"/>
      <origin rpy="{ankle_rpy}"/><axis xyz="0 1 0"/></joint>
    <joint name="ankle" type="revolute"><parent link="shin"/><child link="foot"/>
      <origin xyz="0.1 0.2 -0.5" rpy="{rpy}"/><axis xyz="{axis}"/></joint>
    <joint name="toes" type="revolute"><parent link="foot"/><child link="toe"/>
      <axis xyz="0 1 0"/></joint></robot>"""


def shape(inside: str, xyz: str, rpy: str = "0 0 0") -> str:
    return f'<collision><origin xyz="{xyz}" rpy="{rpy}"/><geometry>{inside}</geometry></collision>'


BOX = '<box size="0.2 0.1 0.02"/>'
BALL = '<sphere radius="0.01"/>'


def corners(sole) -> set[tuple[float, float]]:
    return {tuple(float(v) for v in corner) for corner in np.round(sole, 9) + 0.0}


def test_the_sole_is_the_lowest_face_below_the_origin_of_the_foot_link(write):
    tree = read_urdf(write("r.urdf", robot(shape(BOX, "0.03 0.01 -0.05") + shape(BOX, "0 0 0.2"))))
    T = default_sole_frame(tree, "foot")
    np.testing.assert_allclose(T[:3, :3], np.eye(3), atol=1e-15)
    np.testing.assert_allclose(T[:3, 3], [0, 0, -0.06], atol=1e-15)
    assert corners(sole_rectangle(tree, "foot", T)) == {
        (0.13, 0.06),
        (0.13, -0.04),
        (-0.07, 0.06),
        (-0.07, -0.04),
    }


@pytest.mark.parametrize("rpy", ["1.5707963267948966 0 0", "0 3.141592653589793 0.4", "0 0 1.2"])
def test_the_sole_does_not_depend_on_how_the_foot_link_is_turned(write, rpy):
    upright = read_urdf(write("a.urdf", robot(shape(BOX, "0.03 0.01 -0.05"))))
    turned = read_urdf(write("b.urdf", robot("", rpy)))
    R = place_at_zero(turned).link("foot")[0][0]
    # The same box, seen from the turned link.
    centre = " ".join(repr(float(v)) for v in R.T @ [0.03, 0.01, -0.05])
    yaw, pitch, roll = _zyx(R.T)
    turned = read_urdf(write("b.urdf", robot(shape(BOX, centre, f"{roll} {pitch} {yaw}"), rpy)))
    T_up, T = default_sole_frame(upright, "foot"), default_sole_frame(turned, "foot")
    np.testing.assert_allclose(R @ T[:3, :3], T_up[:3, :3], atol=1e-12)
    np.testing.assert_allclose(R @ T[:3, 3], T_up[:3, 3], atol=1e-12)
    assert corners(sole_rectangle(turned, "foot", T)) == corners(
        sole_rectangle(upright, "foot", T_up)
    )


def _zyx(R) -> tuple[float, float, float]:
    yaw = float(np.arctan2(R[1, 0], R[0, 0]))
    pitch = float(np.arctan2(-R[2, 0], np.hypot(R[2, 1], R[2, 2])))
    return yaw, pitch, float(np.arctan2(R[2, 1], R[2, 2]))


def test_a_foot_that_is_pitched_at_zero_keeps_its_own_sole(write):
    tree = read_urdf(write("r.urdf", robot(shape(BOX, "0 0 -0.05"), rpy="0 0.2 0")))
    T = default_sole_frame(tree, "foot")
    np.testing.assert_allclose(T[:3, 2], [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(T[:3, 0], [1, 0, 0], atol=1e-12)
    assert len(sole_rectangle(tree, "foot", T)) == 4


def test_balls_under_a_sole_span_the_rectangle_of_their_lowest_points(write):
    balls = "".join(shape(BALL, f"{x} {y} -0.05") for x in (-0.05, 0.1) for y in (-0.03, 0.04))
    tree = read_urdf(write("r.urdf", robot(balls + shape(BOX, "0 0 -0.03"))))
    T = default_sole_frame(tree, "foot")
    assert T[2, 3] == pytest.approx(-0.06)
    assert corners(sole_rectangle(tree, "foot", T)) == {
        (0.1, 0.04),
        (0.1, -0.03),
        (-0.05, 0.04),
        (-0.05, -0.03),
    }


def test_an_upright_cylinder_touches_with_its_disc_and_a_lying_one_with_a_line(write):
    cylinder = '<cylinder radius="0.05" length="0.2"/>'
    upright = read_urdf(write("a.urdf", robot(shape(cylinder, "0 0 0"))))
    T = default_sole_frame(upright, "foot")
    assert T[2, 3] == pytest.approx(-0.1)
    assert corners(sole_rectangle(upright, "foot", T)) == {
        (0.05, 0.05),
        (0.05, -0.05),
        (-0.05, 0.05),
        (-0.05, -0.05),
    }
    lying = read_urdf(write("b.urdf", robot(shape(cylinder, "0 0 0", "0 1.5707963267948966 0"))))
    T = default_sole_frame(lying, "foot")
    assert T[2, 3] == pytest.approx(-0.05)
    assert sole_rectangle(lying, "foot", T) is None


def test_without_collision_geometry_the_foot_link_is_the_sole(write):
    mesh = shape('<mesh filename="foot.stl"/>', "0 0 -1")
    tree = read_urdf(write("r.urdf", robot(mesh, rpy="0.1 0.2 0.3")))
    T = default_sole_frame(tree, "foot")
    np.testing.assert_array_equal(T, np.eye(4))
    assert sole_rectangle(tree, "foot", T) is None


def test_the_outline_is_counter_clockwise(write):
    tree = read_urdf(write("r.urdf", robot(shape(BOX, "0 0 0"))))
    x, y = sole_rectangle(tree, "foot", default_sole_frame(tree, "foot")).T
    assert 0.5 * (x @ np.roll(y, -1) - y @ np.roll(x, -1)) == pytest.approx(0.02)


@pytest.mark.parametrize(
    ("axis", "ankle"),
    [("0 1 0", "ankle"), ("0 -1 0", "ankle"), ("1 0 0", "hip"), ("0 0.9999 0.01", "hip")],
)
def test_the_ankle_is_the_nearest_pitch_joint_above_the_foot(write, axis, ankle):
    tree = read_urdf(write("r.urdf", robot("", axis=axis)))
    assert default_ankle(tree, "foot") == ankle


def test_a_right_angle_written_with_five_digits_is_still_a_pitch_axis(write):
    tree = read_urdf(write("r.urdf", robot("", rpy="1.5708 0 0", axis="0 0 -1")))
    assert default_ankle(tree, "foot") == "ankle"


def test_a_leg_without_pitch_joint_has_no_ankle(write):
    text = robot("", axis="1 0 0", ankle_rpy="0 0 1")
    assert default_ankle(read_urdf(write("r.urdf", text)), "foot") is None


def test_the_ankle_of_a_foot_that_is_the_root_is_that_of_the_body_not_of_the_toes(write):
    text = """<robot name="r"><link name="foot"/><link name="toe"/><link name="leg"/>
    <link name="body"/>
    <joint name="toes" type="revolute"><parent link="foot"/><child link="toe"/>
      <axis xyz="0 1 0"/></joint>
    <joint name="ankle" type="revolute"><parent link="foot"/><child link="leg"/>
      <axis xyz="0 1 0"/></joint>
    <joint name="hip" type="revolute"><parent link="leg"/><child link="body"/>
      <axis xyz="0 1 0"/></joint></robot>"""
    assert default_ankle(read_urdf(write("r.urdf", text)), "foot") == "ankle"
