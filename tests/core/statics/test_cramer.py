# SPDX-License-Identifier: Apache-2.0
"""Cramer's rule on planar chains: exact for any n, regular exactly when the shape changes."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from comcal.errors import NotARigidTiltError, RankError
from comcal.identify.paper_route import paper_route
from comcal.measure.plan import PlannedPose
from comcal.robot.model import Foot, Robot, Sensor
from comcal.robot.tree import Joint, JointType, Link, Tree
from comcal.statics.cramer import cramer_rule
from comcal_sims.robots.table1 import Table1Parameters, planar_twin_plan


@given(st.integers(1, 6), st.integers(0, 2**32 - 1))
def test_cramer_s_quotients_equal_the_solution(n, seed):
    rng = np.random.default_rng(seed)
    E = np.exp(1j * rng.uniform(-1.5, 1.5, (3, n, n)))
    H = rng.normal(size=(3, n)) + 1j * rng.normal(size=(3, n))
    K = np.einsum("bij,bj->bi", E, H)
    good = np.abs(np.linalg.det(E)) > 1e-3
    np.testing.assert_allclose(cramer_rule(E, K)[good], H[good], atol=1e-8)


@given(st.floats(-1.5, 1.5), st.floats(-1.5, 1.5), st.floats(-1.5, 1.5))
def test_for_two_segments_the_determinant_is_the_change_of_shape(a, b, bend):
    E = np.exp(1j * np.array([[a, a], [b, b + bend]]))
    assert abs(np.linalg.det(E)) ** 2 == pytest.approx(2 * (1 - np.cos(bend)), abs=1e-12)


def single_leg(n: int, rng: np.random.Generator) -> Robot:
    """A chain of n segments on one foot, all axes +y, random lengths, masses and CoMs (r != 0)."""

    def link(name, mass):
        return Link(name, mass, rng.normal(0, 0.1, 3) * [1, 0, 1], np.eye(3) * 1e-3)

    def joint(name, kind, parent, child, z, x=0.0):
        T = np.eye(4)
        T[:3, 3] = [x, 0.0, z]
        axis = np.array([0.0, 1.0, 0.0]) * (kind is not JointType.FIXED)
        return Joint(name, kind, parent, child, T, axis)

    links = [link("sole", 0.2), link("foot", 1.5)]
    joints = [joint("ft", JointType.FIXED, "sole", "foot", 0.02)]
    for v in range(n):
        length = 0.08 if v == 0 else float(rng.uniform(0.2, 0.4))
        parent = "foot" if v == 0 else f"s{v}"
        joints.append(
            joint(f"j{v + 1}", JointType.REVOLUTE, parent, f"s{v + 1}", length, rng.normal(0, 0.03))
        )
        links.append(link(f"s{v + 1}", float(rng.uniform(0.8, 4.0))))
    tree = Tree("chain", tuple(links), tuple(joints))
    foot = Foot("only", "sole", "ft", None, np.eye(4), "j1")
    return Robot("chain", tree, sensors={"ft": Sensor("ft", "ft")}, feet={"only": foot})


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5])
def test_any_number_of_segments_comes_back_from_n_plus_one_shapes(n, odd):
    rng = np.random.default_rng(100 + n)
    robot = single_leg(n, rng)
    shapes = np.zeros((n + 1, n))
    shapes[1:, :] = np.diag(rng.uniform(0.6, 1.0, n)) if n > 1 else 0.0
    if n > 1:
        shapes[1] = rng.uniform(-0.5, 0.5, n)
        shapes[1, 1] = -0.7
    plan = []
    for i, shape in enumerate(shapes):
        for tilt in (-0.3, 0.35):
            q = shape.copy()
            q[0] = tilt + (0.0 if n > 1 else 0.02 * i)
            plan.append(PlannedPose(len(plan) + 1, q, "only", f"c{i}", tilt))
    found = paper_route(robot, odd.ideal_table(robot, plan))
    assert found.chain is not None, found.reason
    # The root of this tree is the sole, so each link hangs on its own anchor.
    best = found.choices[0]
    for v, segment in enumerate(found.chain.segments):
        (k,) = segment.links
        com = robot.tree.links[k].com
        assert best.w[v] == pytest.approx(com[2] + 1j * com[0], abs=1e-9)
    for choice in found.choices:
        if choice.choice.checking:
            assert np.abs(choice.misfit).max() < 1e-10


def bent_shapes(n_shapes):
    """Twin pairs of Table 1 with the knees bent by equal steps."""
    angles = np.linspace(0.0, 0.9, n_shapes)
    plan = []
    for i, bend in enumerate(angles):
        for tilt in (0.0, 0.4):
            q = {"ankle_pitch": bend / 2 - tilt, "knee": -bend}
            plan.append((i, tilt, {f"{s}_{j}": a for s in "lr" for j, a in q.items()}))
    return plan


@pytest.mark.parametrize("n_shapes", [4, 5])
def test_more_configurations_than_needed_give_every_choice_best_first(n_shapes, skewed, odd):
    names = skewed.robot.tree.joint_names
    plan = [
        PlannedPose(k, np.array([q.get(n, 0.0) for n in names]), "double", f"c{i}", tilt)
        for k, (i, tilt, q) in enumerate(bent_shapes(n_shapes))
    ]
    found = paper_route(skewed.robot, odd.ideal_table(skewed.robot, plan))
    n = len(found.chain.segments)
    assert n == 2
    regular = [c.choice for c in found.choices]
    assert len({c.solving for c in regular}) == len(regular)
    assert len(regular) == n_shapes * (n_shapes - 1) // 2
    determinants = [c.determinant for c in regular]
    assert determinants == sorted(determinants, reverse=True)
    for choice in found.choices:
        assert sorted((*choice.choice.solving, *choice.choice.checking)) == list(range(n_shapes))
        np.testing.assert_allclose(choice.w, found.choices[0].w, atol=1e-8)
        assert np.abs(choice.misfit).max() < 1e-9


def test_the_misfit_is_how_far_the_checking_com_is_off(skewed):
    """Predicted minus measured, x and z [m]."""
    from comcal.statics.configurations import placed_in_stance
    from comcal.statics.support import carrier_of

    plan = [p for p in skewed.plan if p.configuration and p.pose % 2]
    table = skewed.measure(plan)
    at = placed_in_stance(skewed.robot, carrier_of(skewed.robot, "double"), table.q)
    com = at.total_com()
    com[2] += [0.003, 0.0, -0.002]
    empty = {s: np.full_like(w, np.nan) for s, w in table.wrench.items()}
    table = replace(table, com=com, com_var=np.full((len(plan), 3), 1e-8), wrench=empty)
    found = paper_route(skewed.robot, table)
    checked = next(c for c in found.choices if c.choice.solving == (0, 1))
    np.testing.assert_allclose(checked.misfit, [-0.003, 0.002], atol=1e-9)
    assert (checked.misfit_sigma > 1e-4).all()


def test_too_many_choices_are_refused_before_they_are_counted_out(odd):
    rng = np.random.default_rng(3)
    robot = single_leg(6, rng)
    plan = []
    for i in range(13):
        shape = rng.uniform(-0.7, 0.7, 6)
        for tilt in (0.0, 0.3):
            q = shape.copy()
            q[0] += tilt
            plan.append(PlannedPose(len(plan), q, "only", f"c{i}", tilt))
    found = paper_route(robot, odd.ideal_table(robot, plan))
    assert found.chain is None
    assert "500 choices" in found.reason
    assert len(found.totals) == 13


def test_table1_by_cramer_has_the_paper_s_values(table1):
    found = paper_route(table1.robot, table1.measure())
    names = [s.name(table1.robot) for s in found.chain.segments]
    assert names == ["l/r_shin", "l/r_thigh+waist"]
    np.testing.assert_allclose([s.mass for s in found.chain.segments], [1.90, 3.26])
    assert len(found.choices) == 3
    for choice in found.choices:
        # method, E7: both legs in parallel and the waist, l_c = 322.09 mm.
        np.testing.assert_allclose(choice.w, [0.2, 0.32208589], atol=1e-8)


def test_links_with_r_come_back_by_cramer(skewed):
    found = paper_route(skewed.robot, skewed.measure())
    thighs = (2 * 1.16 * -0.02) / 3.26
    wanted = [0.2 + 0.01j, 0.32208589 + 1j * thighs]
    np.testing.assert_allclose(found.choices[0].w, wanted, atol=1e-8)


def test_twins_alone_are_one_shape_and_refused(table1):
    plan = [p for p in table1.plan if p.configuration == "straight"]
    found = paper_route(table1.robot, table1.measure(plan))
    assert found.chain is None
    assert "n + 1" in found.reason
    assert len(found.totals) == 1


def test_equal_shapes_under_different_names_have_no_determinant(table1):
    plan = [p for p in table1.plan if p.configuration == "straight"]
    same = [replace(p, pose=10 + i, configuration="again") for i, p in enumerate(plan)]
    third = [replace(p, pose=20 + i, configuration="third") for i, p in enumerate(plan)]
    found = paper_route(table1.robot, table1.measure([*plan, *same, *third]))
    # One segment only: nothing bends, so the chain is one rigid body and solves as such.
    assert found.chain is not None
    assert len(found.chain.segments) == 1


def test_a_tilt_too_small_is_refused_with_its_size(table1):
    plan = planar_twin_plan(Table1Parameters(), bend=np.deg2rad(40), tilt=np.deg2rad(1.0))
    found = paper_route(table1.robot, table1.measure(plan))
    assert not found.totals
    assert all(isinstance(e, RankError) for e in found.refused)
    assert "1.00 deg" in found.reason
    assert "tilted too little" in found.reason


def test_a_lateral_sway_on_two_feet_is_never_a_rigid_tilt(table1_roll):
    sway = [p for p in table1_roll.plan if abs(p.q).max() > 0 and not p.configuration][-4:]
    plan = [replace(p, configuration="sway") for p in sway]
    found = paper_route(table1_roll.robot, table1_roll.measure(plan))
    assert isinstance(found.refused[0], NotARigidTiltError)


def test_shapes_that_are_not_twins_are_named_with_what_moved(table1):
    plan = [replace(table1.plan[0], configuration="x"), replace(table1.plan[2], configuration="x")]
    found = paper_route(table1.robot, table1.measure(plan))
    assert "l_knee" in str(found.refused[0])


def test_paper_route_sigmas_are_those_of_repeated_measurements(table1):
    rng = np.random.default_rng(5)
    robot = replace(
        table1.robot, tolerances=replace(table1.robot.tolerances, link_com=0, link_mass=0)
    )
    plan = [p for p in table1.plan if p.configuration]
    table = table1.measure(plan)
    w, com = [], []
    for _ in range(60):
        found = paper_route(robot, table1.noisy(table, rng))
        solving = [c for c in found.choices if c.choice.solving == (1, 2)]
        w.append(solving[0].w)
        com.append(found.totals[0].carried_xyz)
    found = paper_route(robot, table)
    best = next(c for c in found.choices if c.choice.solving == (1, 2))
    drawn = np.stack([np.std(np.imag(w), axis=0), np.std(np.real(w), axis=0)], axis=1).ravel()
    assert np.abs(drawn / np.sqrt(np.diag(best.cov)) - 1).max() < 0.3
    assert np.abs(np.std(com, axis=0) / np.sqrt(np.diag(found.totals[0].cov)) - 1).max() < 0.3


def test_given_coms_are_solved_without_force_sensors(skewed):
    """Muscolo: with the total CoM known a priori, section 3 alone is used."""
    plan = [p for p in skewed.plan if p.configuration and p.pose % 2]
    table = skewed.measure(plan)
    from comcal.statics.configurations import placed_in_stance
    from comcal.statics.support import carrier_of

    at = placed_in_stance(skewed.robot, carrier_of(skewed.robot, "double"), table.q)
    empty = {s: np.full_like(w, np.nan) for s, w in table.wrench.items()}
    table = replace(table, com=at.total_com(), com_var=np.full((len(plan), 3), 1e-8), wrench=empty)
    found = paper_route(skewed.robot, table)
    assert {t.by for t in found.totals} == {"given"}
    assert len(found.choices) == 3
    thighs = (2 * 1.16 * -0.02) / 3.26
    np.testing.assert_allclose(
        found.choices[0].w, [0.2 + 0.01j, 0.32208589 + 1j * thighs], atol=1e-8
    )
