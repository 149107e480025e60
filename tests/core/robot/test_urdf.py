# SPDX-License-Identifier: Apache-2.0
"""What a URDF says is what the tree has; what is no tree is refused with file and line."""

from __future__ import annotations

import numpy as np
import pytest

from comcal.errors import UrdfError
from comcal.robot.kinematics import place_links
from comcal.robot.tree import JointType, Shape
from comcal.robot.urdf import read_urdf

MASS = '<inertial><mass value="1"/></inertial>'


def robot(*lines: str) -> str:
    """A URDF whose k-th line after the first is *lines[k]*, so line numbers are easy to count."""
    return "\n".join(['<robot name="r">', *lines, "</robot>"])


def link(name: str, inside: str = "") -> str:
    return f'<link name="{name}">{inside}</link>'


def joint(name: str, parent: str, child: str, kind: str = "fixed", inside: str = "") -> str:
    ends = f'<parent link="{parent}"/><child link="{child}"/>'
    return f'<joint name="{name}" type="{kind}">{ends}{inside}</joint>'


def test_every_joint_type_is_read_with_its_limits_and_axis(write):
    tree = read_urdf(
        write(
            "r.urdf",
            robot(
                *(link(n) for n in "abcde"),
                joint("f", "a", "b"),
                joint(
                    "rev",
                    "b",
                    "c",
                    "revolute",
                    '<axis xyz="0 2 0"/><limit lower="-1" upper="0.5" effort="7"/>',
                ),
                joint("con", "c", "d", "continuous", '<limit lower="0" upper="0" effort="inf"/>'),
                joint("pri", "d", "e", "prismatic", '<axis xyz="0 0 -1"/>'),
            ),
        )
    )
    assert [j.kind for j in tree.joints] == [
        JointType.FIXED,
        JointType.REVOLUTE,
        JointType.CONTINUOUS,
        JointType.PRISMATIC,
    ]
    assert tree.joint_names == ("rev", "con", "pri")
    axes = [j.axis.tolist() for j in tree.joints]
    assert axes == [[0, 0, 0], [0, 1, 0], [1, 0, 0], [0, 0, -1]]
    assert [(j.lower, j.upper) for j in tree.joints[1:3]] == [(-1, 0.5), (-np.inf, np.inf)]
    assert (tree.joints[1].effort, tree.joints[2].effort) == (7.0, np.inf)


def test_a_link_without_inertial_weighs_nothing_and_says_so(write):
    tree = read_urdf(write("r.urdf", robot(link("a"), link("b", MASS), joint("j", "a", "b"))))
    assert [(ln.mass, ln.has_inertial) for ln in tree.links] == [(0.0, False), (1.0, True)]


def test_a_negative_mass_is_kept_for_the_health_check(write):
    text = robot(link("a", '<inertial><mass value="-2"/></inertial>'))
    assert read_urdf(write("r.urdf", text)).links[0].mass == -2.0


def test_inertia_is_turned_into_the_axes_of_the_link(write):
    inertial = (
        '<inertial><origin xyz="1 2 3" rpy="0 0 1.5707963267948966"/><mass value="1"/>'
        '<inertia ixx="1" iyy="2" izz="3" ixy="0" ixz="0" iyz="0"/></inertial>'
    )
    body = read_urdf(write("r.urdf", robot(link("a", inertial)))).links[0]
    np.testing.assert_allclose(body.inertia, np.diag([2.0, 1.0, 3.0]), atol=1e-12)
    np.testing.assert_array_equal(body.com, [1.0, 2.0, 3.0])


def test_collision_shapes_become_their_bounding_boxes_and_meshes_nothing(write):
    shapes = [
        '<box size="1 2 3"/>',
        '<sphere radius="0.5"/>',
        '<cylinder radius="0.5" length="4"/>',
        '<mesh filename="x.stl"/>',
    ]
    inside = "".join(
        f'<collision><origin xyz="0 0 1"/><geometry>{shape}</geometry></collision>'
        for shape in shapes
    )
    boxes = read_urdf(write("r.urdf", robot(link("a", inside)))).links[0].boxes
    assert [b.size.tolist() for b in boxes] == [[1, 2, 3], [1, 1, 1], [1, 1, 4]]
    assert [b.shape for b in boxes] == [Shape.BOX, Shape.SPHERE, Shape.CYLINDER]
    assert all(b.T_link_box[2, 3] == 1.0 for b in boxes)


def test_order_is_depth_first_in_the_order_of_the_file(write):
    text = robot(
        joint("r2", "r1", "r2", "continuous"),
        joint("left", "a", "l1", "continuous"),
        joint("right", "a", "r1", "continuous"),
        joint("l2", "l1", "l2", "continuous"),
        *(link(n) for n in ["r2", "l2", "r1", "l1", "a"]),
    )
    tree = read_urdf(write("r.urdf", text))
    assert tree.joint_names == ("left", "l2", "right", "r2")
    assert tuple(tree.link_index) == ("a", "l1", "l2", "r1", "r2")


def test_chains_of_mimics_end_at_the_independent_joint(write):
    text = robot(
        *(link(n) for n in "abcd"),
        joint("j1", "a", "b", "revolute", '<mimic joint="j2" multiplier="2" offset="0.1"/>'),
        joint("j2", "b", "c", "revolute", '<mimic joint="j3" multiplier="-3" offset="0.5"/>'),
        joint("j3", "c", "d", "revolute"),
    )
    tree = read_urdf(write("r.urdf", text))
    first, second = tree.joints[0].mimic, tree.joints[1].mimic
    assert tree.joint_names == ("j3",)
    assert (first.joint, first.multiplier, first.offset) == ("j3", -6.0, pytest.approx(1.1))
    assert (second.joint, second.multiplier, second.offset) == ("j3", -3.0, 0.5)


def test_a_floating_joint_below_a_massless_root_is_dropped_with_the_root(write):
    text = robot(
        link("world"),
        link("base", MASS),
        link("arm", MASS),
        joint("free", "world", "base", "floating", '<origin xyz="0 0 5"/>'),
        joint("j", "base", "arm", "continuous", '<origin xyz="0 0 1"/>'),
    )
    tree = read_urdf(write("r.urdf", text))
    assert [ln.name for ln in tree.links] == ["base", "arm"]
    np.testing.assert_allclose(place_links(tree, [[0.0]]).p[0], [[0, 0, 0], [0, 0, 1]])


def test_a_fixed_joint_from_an_empty_world_is_kept(write):
    text = robot(link("world"), link("base", MASS), joint("fix", "world", "base"))
    assert [ln.name for ln in read_urdf(write("r.urdf", text)).links] == ["world", "base"]


def test_a_second_origin_is_ignored_with_a_note(write):
    twice = '<origin xyz="1 0 0"/><origin xyz="2 0 0"/>'
    tree = read_urdf(
        write("r.urdf", robot(link("a"), link("b"), joint("j", "a", "b", inside=twice)))
    )
    assert tree.joints[0].T_parent_joint[0, 3] == 1.0
    assert tree.notes == ("r.urdf:4: a second <origin> in this <joint> is ignored",)


def test_the_xml_version_of_old_files_is_forgiven(write):
    assert read_urdf(write("r.urdf", '<?xml version="0.0" ?>\n' + robot(link("a")))).links


AB = (link("a"), link("b"))
AXIS = '<axis xyz="{}"/>'


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        ("", 1, "not valid XML"),
        ("<robot>\n<link name='a'>\n</robot>", 3, "not valid XML"),
        ("<sdf/>", 1, "not <robot>"),
        (robot(), 1, "no links"),
        (robot(link("a"), link("b")), 3, "2 root links: a, b"),
        (robot(*AB, joint("j", "a", "b"), joint("k", "b", "a")), 1, "cycle"),
        (
            robot(link("r"), *AB, joint("j", "a", "b"), joint("k", "b", "a")),
            5,
            "'j' is part of a cycle",
        ),
        (robot(*AB, joint("j", "a", "b"), joint("k", "b", "b")), 5, "joint 'k' and of joint 'j'"),
        (robot(*AB, joint("j", "x", "b")), 4, "parent link 'x' is not defined"),
        (robot(link("hand"), link("b"), joint("j", "b", "hnad")), 4, "did you mean 'hand'"),
        (robot(link("a"), link("a")), 3, "twice, first in line 2"),
        (robot(*AB, joint("j", "a", "b"), joint("j", "a", "b")), 5, "twice, first in line 4"),
        (robot("<link/>"), 2, "no name="),
        (
            robot(*AB, joint("j", "a", "b", "revolute", AXIS.format("0 0 0"))),
            4,
            "axis of joint 'j' is zero",
        ),
        (
            robot(*AB, joint("j", "a", "b", "revolute", AXIS.format("0 0 nan"))),
            4,
            "not a finite number",
        ),
        (robot(*AB, joint("j", "a", "b", "revolute", AXIS.format("0 1"))), 4, "3 numbers .2 found"),
        (robot(*AB, joint("j", "a", "b", "planar")), 4, "of type 'planar'"),
        (robot(*AB, joint("j", "a", "b", "revolut")), 4, "possible are fixed, revolute"),
        (robot(*AB, "<joint name='j' type='fixed'><child link='b'/></joint>"), 4, "no <parent>"),
        (robot(*AB, joint("j", "a", "b", inside='<origin xzy="1 0 0"/>')), 4, "did you mean 'xyz'"),
        (robot(*AB, joint("j", "a", "b", inside='<origin xyz="${d} 0 0"/>')), 4, "xacro"),
        (robot(*AB, joint("j", "a", "b", inside='<origin xyz="1e12 0 0"/>')), 4, "too large"),
        (robot(*AB, joint("j", "a", "b", "revolute", '<mimic joint="x"/>')), 4, "mimics 'x'"),
        (robot(*AB, joint("j", "a", "b", "revolute", '<mimic joint="j"/>')), 4, "mimics itself"),
        (robot(link("a", '<inertial><mass value="heavy"/></inertial>')), 2, "'heavy'"),
        (robot(link("a", "<inertial/>")), 2, "no <mass>"),
        (
            robot(link("a", '<collision><geometry><sphere radius="-1"/></geometry></collision>')),
            2,
            "negative",
        ),
        ('<!DOCTYPE r [<!ENTITY e "1">]>\n<robot>&e;</robot>', 1, "DOCTYPE"),
        (
            '<robot xmlns:xacro="http://www.ros.org/wiki/xacro">\n<xacro:macro/></robot>',
            2,
            "expand it",
        ),
    ],
)
def test_what_is_not_a_tree_is_refused_with_file_and_line(write, text, line, message):
    with pytest.raises(UrdfError, match=message) as caught:
        read_urdf(write("r.urdf", text))
    assert caught.value.where == f"r.urdf:{line}"
    assert caught.value.exit_code == 2


@pytest.mark.parametrize(
    ("lines", "why"),
    [
        ((link("w", MASS), link("b"), joint("j", "w", "b", "floating")), "has mass"),
        (
            (link("w"), *AB, joint("j", "w", "a", "floating"), joint("k", "w", "b")),
            "other children",
        ),
        ((link("w"), *AB, joint("j", "w", "a"), joint("k", "a", "b", "floating")), "not the root"),
    ],
)
def test_a_floating_joint_elsewhere_is_refused_saying_why(write, lines, why):
    with pytest.raises(UrdfError, match=why):
        read_urdf(write("r.urdf", robot(*lines)))


def test_mimic_cycles_are_refused(write):
    text = robot(
        *(link(n) for n in "abc"),
        joint("j", "a", "b", "revolute", '<mimic joint="k"/>'),
        joint("k", "b", "c", "revolute", '<mimic joint="j"/>'),
    )
    with pytest.raises(UrdfError, match="j -> k"):
        read_urdf(write("r.urdf", text))


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(UrdfError, match=r"absent\.urdf: there is no such URDF file"):
        read_urdf(tmp_path / "absent.urdf")


def test_external_entities_are_never_read(write):
    write("secret.txt", "0.5")
    text = '<!DOCTYPE r [<!ENTITY s SYSTEM "secret.txt">]><robot><link name="a">&s;</link></robot>'
    with pytest.raises(UrdfError, match="DOCTYPE"):
        read_urdf(write("r.urdf", text))


def test_a_very_long_limb_needs_no_recursion(write):
    n = 3000
    links = [link(f"l{i}") for i in range(n + 1)]
    joints = [joint(f"j{i}", f"l{i}", f"l{i + 1}") for i in range(n)]
    assert len(read_urdf(write("r.urdf", robot(*links, *joints))).joints) == n
