# SPDX-License-Identifier: Apache-2.0
"""The generated Table 1 robot is the paper's robot, and its angles mean what is said of them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from comcal.errors import ConfigError, UsageError
from comcal.robot.frames import rotation_about
from comcal.robot.kinematics import place_links
from comcal_sims.robots import table1
from comcal_sims.robots.table1 import Table1Parameters, planar_pose, split_stance_pose, table1_spec

# Muscolo 2017, Table 1: absolute CoM [mm], mass [kg]; foot, shin, thigh 1 are the left ones.
PAPER = {
    "l_foot": (6.72, (0, 200, 26.32)),
    "l_shin": (0.95, (0, 200, 300)),
    "l_thigh": (1.16, (0, 200, 750)),
    "r_foot": (6.72, (0, -200, 26.32)),
    "r_shin": (0.95, (0, -200, 300)),
    "r_thigh": (1.16, (0, -200, 750)),
    "waist": (0.94, (0, 0, 1000)),
}
PARTS = {"foot": ("foot", "sole", "ankle_yoke"), "thigh": ("thigh", "hip_yoke")}

tilts = st.floats(-0.8, 0.8)
offsets = st.floats(-0.05, 0.05)


def _q(parameters: Table1Parameters, angles: dict[str, float]) -> np.ndarray:
    return np.array([angles[name] for name in table1_spec(parameters).joint_names])


def _lump(tree, q, names):
    """Mass and CoM of some links, from the floor below the middle of the feet (robot straight)."""
    placements = place_links(tree, q)
    index = [tree.link_index[name] for name in names if name in tree.link_index]
    mass = tree.masses[index]
    return mass.sum(), mass @ placements.coms[0, index] / mass.sum()


@pytest.mark.parametrize("roll_joints", [False, True])
def test_masses_and_coms_are_those_of_the_paper_whatever_is_cut_out(roll_joints):
    tree = table1_spec(Table1Parameters(roll_joints=roll_joints)).tree()
    assert tree.total_mass == pytest.approx(18.6, abs=1e-12)
    for name, (mass, com_mm) in PAPER.items():
        side, _, part = name.partition("_")
        parts = [f"{side}_{piece}" for piece in PARTS.get(part, (part,))] if part else [name]
        found_mass, found_com = _lump(tree, np.zeros(len(tree.joint_names)), parts)
        assert found_mass == pytest.approx(mass, abs=1e-12)
        hips = np.array([0.0, 0.0, 1.0])
        assert hips + found_com == pytest.approx(np.array(com_mm) / 1e3, abs=1e-12)


def test_both_thighs_and_the_waist_are_one_link_of_322_mm():
    tree = table1_spec(Table1Parameters()).tree()
    mass, com = _lump(tree, np.zeros(6), ["l_thigh", "r_thigh", "waist"])
    assert mass == pytest.approx(3.26, abs=1e-12)
    assert 1e3 * (com[2] + 0.500) == pytest.approx(322.09, abs=0.005)


@given(shin=tilts, thigh=tilts, waist=tilts)
@settings(max_examples=20)
def test_joint_angles_give_the_absolute_tilts_asked_for(shin, thigh, waist):
    parameters = Table1Parameters()
    tree = table1_spec(parameters).tree()
    placements = place_links(tree, _q(parameters, planar_pose(parameters, shin, thigh, waist)))
    R_world_waist = rotation_about([0, 1, 0], waist)
    for link, tilt in {"l_thigh": thigh, "r_shin": shin, "l_foot": 0.0, "r_sole": 0.0}.items():
        R_world_link = R_world_waist @ placements.link(link)[0][0]
        assert np.allclose(R_world_link, rotation_about([0, 1, 0], tilt), atol=1e-12)
        toes_ward = R_world_link @ [0, 0, 1]
        assert toes_ward[0] == pytest.approx(np.sin(tilt), abs=1e-12)


@given(shin=tilts, thigh=tilts, r_a=offsets, r_b=offsets, r_c=offsets, l_b=st.floats(0.1, 0.3))
@settings(max_examples=20)
def test_total_com_is_the_papers_closed_form_for_any_r_and_l(shin, thigh, r_a, r_b, r_c, l_b):
    p = Table1Parameters(r_a=r_a, r_b=r_b, r_c=r_c, l_b=l_b)
    tree = table1_spec(p).tree()
    placements = place_links(tree, _q(p, planar_pose(p, shin, thigh)))
    R, ankle = (a[0] for a in placements.link("l_foot"))
    com = R.T @ (placements.total_com()[0] - ankle) + [0, 0, p.L_a]

    def tip(length, across, tilt):
        s, c = np.sin(tilt), np.cos(tilt)
        return np.array([length * s + across * c, length * c - across * s])

    knee = tip(p.L_b, 0, shin)
    moment = 2 * p.m_a * np.array([p.r_a, p.l_a - p.L_a])
    moment += 2 * p.m_b * tip(p.l_b, p.r_b, shin)
    moment += 2 * p.m_c * (knee + tip(p.l_c, p.r_c, thigh))
    moment += p.waist_mass * (knee + tip(p.L_c, 0, thigh))
    expected = moment / p.total_mass + [0, p.L_a]
    assert com[[0, 2]] == pytest.approx(expected, abs=1e-12)
    assert com[1] == pytest.approx(-p.half_stance, abs=1e-12)


def test_a_lateral_pose_shifts_the_com_to_the_right_and_keeps_waist_and_soles_level():
    parameters = Table1Parameters(roll_joints=True)
    tree = table1_spec(parameters).tree()
    angles = table1.lateral_pose(parameters, np.deg2rad(8.0))
    placements = place_links(tree, _q(parameters, angles))
    middle = (placements.link("l_sole")[1] + placements.link("r_sole")[1])[0] / 2
    com = placements.total_com()[0] - middle
    # The moments of Table 1 above the ankles, 2.735 kg m, on an arm of sin(8 deg).
    assert 1e3 * com[1] == pytest.approx(-1e3 * 2.74 * np.sin(np.deg2rad(8.0)) / 18.6, abs=0.1)
    assert np.allclose(placements.link("l_sole")[0][0], np.eye(3), atol=1e-12)
    with pytest.raises(UsageError, match="roll_joints=True"):
        table1.lateral_pose(Table1Parameters(), 0.1)


@given(
    ahead=st.floats(-0.3, 0.3),
    hip_x=st.floats(-0.1, 0.1),
    hip_height=st.floats(0.75, 0.93),
    waist=tilts,
)
@settings(max_examples=20)
def test_a_split_stance_closes_the_chain(ahead, hip_x, hip_height, waist):
    parameters = Table1Parameters()
    tree = table1_spec(parameters).tree()
    angles = split_stance_pose(parameters, ahead, hip_x, hip_height, waist)
    placements = place_links(tree, _q(parameters, angles))
    R_world_waist = rotation_about([0, 1, 0], waist)
    (R_left, left), (R_right, right) = (placements.link(f"{side}_sole") for side in "lr")
    assert np.allclose(R_world_waist @ R_left[0], np.eye(3), atol=1e-12)
    assert np.allclose(R_world_waist @ R_right[0], np.eye(3), atol=1e-12)
    assert R_world_waist @ (left - right)[0] == pytest.approx([ahead, 0.4, 0.0], abs=1e-12)
    waist_above = -R_world_waist @ (left + right)[0] / 2
    assert waist_above == pytest.approx([hip_x, 0.0, hip_height - 0.02], abs=1e-12)
    assert angles["l_knee"] > 0.0 < angles["r_knee"]


def test_a_leg_that_does_not_reach_is_refused_with_its_reach():
    with pytest.raises(UsageError, match=r"l_leg: the leg does not reach .*0\.1000 to 0\.9000 m"):
        split_stance_pose(Table1Parameters(), 0.3, -0.4, 1.0)


def test_twins_differ_in_the_ankles_only_and_shapes_in_the_knee():
    parameters = Table1Parameters()
    bend, tilt = np.deg2rad([30.0, 30.0])
    plan = table1.planar_twin_plan(parameters, bend, tilt)
    names = table1_spec(parameters).joint_names
    assert len(plan) == 6
    knees = []
    for one, other in zip(plan[::2], plan[1::2], strict=True):
        assert one.configuration == other.configuration
        moved = {
            name for name, a, b in zip(names, one.q, other.q, strict=True) if abs(a - b) > 1e-12
        }
        assert moved == {"l_ankle_pitch", "r_ankle_pitch"}
        assert abs(one.tilt - other.tilt) == pytest.approx(tilt)
        ankle = names.index("l_ankle_pitch")
        assert one.q[ankle] - other.q[ankle] == pytest.approx(other.tilt - one.tilt)
        knees.append(one.q[names.index("l_knee")])
    assert sorted(knees) == pytest.approx([-bend, 0.0, bend])


def test_a_slope_plan_holds_every_shape_still_on_three_floors():
    plan = table1.slope_plan(Table1Parameters(), pitch=0.05, bend=0.6)
    assert [pose.floor_pitch for pose in plan] == [0.0, 0.05, -0.05] * 3
    for level, down, up in zip(plan[::3], plan[1::3], plan[2::3], strict=True):
        assert np.array_equal(level.q, down.q)
        assert np.array_equal(level.q, up.q)
        assert level.configuration == down.configuration == up.configuration


def test_the_plan_separates_left_from_right(table1):
    """Unknown first moments of all links, known masses, level floor: what foot wrenches see."""
    tree = table1.robot.tree
    links = [k for k, link in enumerate(tree.links) if not link.name.endswith("_sole")]
    rows = []
    for pose in table1.plan:
        R_left = table1.soles(pose)["left"][0]
        R = R_left.T @ place_links(tree, pose.q).R[0, links]
        rows.append(np.hstack(list(R[:, :2])))
    _, values, directions = np.linalg.svd(np.vstack(rows))
    rank = int((values > 1e-9 * values[0]).sum())
    seen = (directions[:rank] ** 2).sum(axis=0).reshape(-1, 3)
    # Planar: 2 for the waist, 8 for the legs, the sums of x and of y of the rest; less the gauge
    # of the closed chain.
    assert rank == 11
    for side in "lr":
        for part in ("thigh", "shin"):
            z_seen = seen[links.index(tree.link_index[f"{side}_{part}"]), 2]
            assert z_seen == pytest.approx(1.0, abs=1e-9)
    assert values[0] / values[rank - 1] < 100


def test_a_misspelt_parameter_is_refused_with_its_neighbour(tmp_path):
    with pytest.raises(UsageError, match="did you mean roll_joints"):
        table1.generate(tmp_path, roll_joint=True)


def test_nothing_is_overwritten(tmp_path):
    path = table1.generate(tmp_path)
    before = path.read_bytes()
    with pytest.raises(ConfigError, match="not overwritten"):
        table1.generate(tmp_path, r_b=0.01)
    assert path.read_bytes() == before
