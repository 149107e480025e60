# SPDX-License-Identifier: Apache-2.0
"""Spatial chains in symbols: kinematics against Pinocchio-checked code, null space against SVD."""

from __future__ import annotations

import numpy as np
import pytest

from comcal.errors import UsageError
from comcal.robot.description import load_robot
from comcal.robot.kinematics import place_links
from comcal.robot.model import Robot
from comcal.robot.tree import Joint, JointType, Link, Tree
from comcal.statics.stance import in_stance, stance_frame
from comcal.symbolic.angle_text import angle_of
from comcal.symbolic.nullspace import harmonics, spatial_program, visible
from comcal.symbolic.one_joint import one_joint_program
from comcal.symbolic.program import substituted
from comcal.symbolic.robot_chain import default_ends, path_between, planar_values, spatial_chain
from comcal.symbolic.spatial import chain_from_axes
from comcal.symbolic.to_python import python_function
from comcal_sims.robots import table1

TURN, SLIDE = False, True
CHAINS = {
    "parallel": ([[0, 1, 0]] * 3, [TURN] * 3),
    "biped hip": ([[0, 0, 1], [1, 0, 0], [0, 1, 0], [0, 1, 0]], [TURN] * 4),
    "oblique": ([[1, 2, 2], [3, 0, -4]], [TURN] * 2),
    "sliding": ([[0, 0, 1], [0, 1, 0], [1, 0, 0]], [TURN, SLIDE, TURN]),
}


def robot_of(axes: list, slides: list, rng: np.random.Generator) -> Robot:
    """A serial robot with these axes and random lengths, masses and CoMs."""
    links, joints = [Link("base", 1.3, rng.normal(size=3) * 0.1, np.eye(3))], []
    for k, (axis, slide) in enumerate(zip(axes, slides, strict=True), start=1):
        T = np.eye(4)
        T[:3, 3] = rng.normal(size=3) * 0.3
        kind = JointType.PRISMATIC if slide else JointType.REVOLUTE
        unit = np.array(axis) / np.linalg.norm(axis)
        joints.append(Joint(f"j{k}", kind, links[-1].name, f"link{k}", T, unit))
        links.append(Link(f"link{k}", rng.uniform(1, 3), rng.normal(size=3) * 0.2, np.eye(3)))
    return Robot("serial", Tree("serial", tuple(links), tuple(joints)))


@pytest.mark.parametrize("name", CHAINS)
def test_null_space_is_exactly_what_no_pose_sees(name: str) -> None:
    chain = chain_from_axes(
        CHAINS[name][0], [[0.1, 0.2, 0.3]] * len(CHAINS[name][0]), CHAINS[name][1]
    )
    found, all_poses = visible(chain), harmonics(chain)
    null = np.array(found.null.tolist(), float)
    assert np.linalg.matrix_rank(all_poses, tol=1e-9) == len(found.combinations)
    assert null.shape[1] == all_poses.shape[1] - len(found.combinations)
    assert np.linalg.matrix_rank(null) == null.shape[1]
    assert all_poses @ null == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("name", CHAINS)
def test_the_rows_of_enough_poses_give_the_combinations(name: str) -> None:
    rng = np.random.default_rng(3)
    robot = robot_of(*CHAINS[name], rng)
    path = path_between(robot, "base", robot.tree.links[-1].name)
    chain = spatial_chain(path)
    function = python_function(spatial_program(chain))
    q = rng.uniform(-1.5, 1.5, (12, len(chain.q)))
    rows, rhs = function(q=q, com=place_links(robot.tree, q).total_com())
    found = visible(chain)
    width = len(found.combinations)
    solved = np.linalg.lstsq(rows.reshape(-1, width), rhs.ravel(), rcond=None)[0]
    h = {
        symbol: value
        for symbols, value3 in zip(
            found.h, robot.tree.coms * robot.tree.masses[:, None], strict=True
        )
        for symbol, value in zip(symbols, value3, strict=True)
    }
    truth = [float(c.meaning.subs(h)) for c in found.combinations]
    assert np.linalg.matrix_rank(rows.reshape(-1, width)) == width
    assert solved == pytest.approx(truth, abs=1e-9)


@pytest.fixture(scope="module")
def biped(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    folder = tmp_path_factory.mktemp("table1")
    return load_robot(table1.generate(folder, r_b=0.01, r_c=-0.02))


def test_the_own_robot_gives_its_own_numbers(biped: Robot) -> None:
    """The biped on its left foot: true CoMs in, link CoMs of the segments out."""
    path = path_between(biped, *default_ends(biped))
    chain, values = planar_values(path)
    assert path.is_planar
    assert path.names == ("l_ankle_pitch", "l_knee", "l_hip_pitch")
    theta = np.array([0.1, 0.5, -0.6])
    q = np.zeros((3, len(biped.tree.joint_names)))
    # Joints seen from the foot turn the other way round.
    for i, joint in enumerate(path.names):
        q[i, biped.tree.joint_names.index(joint)] = -theta[i]
    at = place_links(biped.tree, q)
    at = in_stance(*stance_frame(biped, "left", at), at)
    carried = ~biped.below_cut["l_foot"]
    m = biped.tree.masses * carried
    com = np.einsum("k,nki->ni", m, at.coms) / m.sum()
    function = python_function(substituted(one_joint_program(chain), values))
    r, along, _ = function(X=com[:, 0], Z=com[:, 2], theta=theta)
    shin, thigh = (biped.tree.links[biped.tree.link_index[k]] for k in ("l_shin", "l_thigh"))
    ankle, knee, hip = path.points
    zero = place_links(biped.tree, np.zeros_like(q[:1]))
    zero = in_stance(*stance_frame(biped, "left", zero), zero)
    for v, (link, joint) in enumerate(((shin, ankle), (thigh, knee))):
        true = zero.coms[0, biped.tree.link_index[link.name]] - joint
        assert (r[v], along[v]) == pytest.approx((true[0], true[2]), abs=1e-12)
    waist = [k for k, x in enumerate(biped.tree.links) if x.name[0] != "l"]
    mass = biped.tree.masses[waist]
    true = mass @ zero.coms[0, waist] / mass.sum() - hip
    assert (r[2], along[2]) == pytest.approx((true[0], true[2]), abs=1e-12)


def test_a_link_that_does_not_exist_is_answered_with_those_that_do(biped: Robot) -> None:
    with pytest.raises(UsageError, match=r"no link 'knee'.*waist, l_thigh"):
        path_between(biped, "knee", "waist")
    with pytest.raises(UsageError, match="no joint moves"):
        path_between(biped, "l_foot", "l_sole")


@pytest.mark.parametrize(
    ("text", "value"),
    [(0, 0.0), ("30 deg", np.pi / 6), ("pi / 4", np.pi / 4), ("-(0.5 - 2) * 3", 4.5)],
)
def test_angles_are_read_as_people_write_them(text: object, value: float) -> None:
    assert float(angle_of(text)) == pytest.approx(value, rel=1e-15)


@pytest.mark.parametrize(
    "text", ["", "a b", "f(x)", "x.y", "2 ** 3", "1 / 0", "1/x", True, None, [1], "nan()", "1e999"]
)
def test_what_is_no_angle_is_refused(text: object) -> None:
    with pytest.raises(UsageError, match="is not an angle"):
        angle_of(text, "file:3")
