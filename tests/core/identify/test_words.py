# SPDX-License-Identifier: Apache-2.0
"""What is said of a fit is true: combinations span what is seen, remedies show something new."""

import re
from dataclasses import replace

import numpy as np
import pytest

from comcal.identify.adjust import adjust
from comcal.identify.groups import groups_of
from comcal.identify.held_out import held_out_error
from comcal.identify.merged import merged_directions
from comcal.identify.unknowns import unknowns_of
from comcal.identify.words import combinations_of, unseen_directions
from comcal.measure.plan import PlannedPose


def fit(robot, table):
    return adjust(robot, unknowns_of(robot), groups_of(robot, table))


def poses(robot, rng, n, support="left"):
    names = robot.tree.joint_names
    return [PlannedPose(i, rng.normal(0, 0.3, len(names)), support) for i in range(n)]


@pytest.fixture
def session(odd):
    """An awkward robot in a few poses on its left foot, on a level floor."""
    rng = np.random.default_rng(1)
    robot = odd.odd_biped(rng)
    plan = poses(robot, rng, 5)
    return robot, plan, odd.noisy(odd.ideal_table(robot, plan), rng)


def test_combinations_are_as_many_as_the_rank_and_span_what_is_seen(session):
    robot, _, table = session
    found = fit(robot, table)
    combinations = combinations_of(found)
    assert len(combinations) == found.rank
    names = found.unknowns.names
    rows = np.array([[c.coefficients.get(n, 0.0) for n in names] for c in combinations])
    scaled = rows * found.unknowns.scale
    scaled /= np.linalg.norm(scaled, axis=1, keepdims=True)
    assert np.linalg.matrix_rank(scaled, tol=1e-3) == found.rank
    # Small parts are left out of a combination, and a little of the unseen stays in it.
    assert found.visibility(rows).max() < 0.2


def test_combinations_have_the_true_values_within_sigmas_that_count_cad(odd):
    """True robots are drawn as CAD allows; what is left out of a combination is then wrong too."""
    rng = np.random.default_rng(2)
    robot = odd.odd_biped(rng)
    plan = poses(robot, rng, 12)
    unknowns = unknowns_of(robot)
    off = []
    for _ in range(12):
        links = tuple(
            replace(k, com=k.com + rng.normal(0, robot.tolerances.link_com, 3))
            for k in robot.tree.links
        )
        true = replace(robot, tree=replace(robot.tree, links=links))
        found = fit(robot, odd.noisy(odd.ideal_table(robot, plan, true_robot=true), rng))
        theta = replace(unknowns, robot=true).cad
        for c in combinations_of(found):
            row = np.array([c.coefficients.get(n, 0.0) for n in unknowns.names])
            off.append((c.value - row @ theta) / c.sigma)
    assert np.sqrt(np.mean(np.square(off))) == pytest.approx(1.0, abs=0.15)
    assert np.abs(off).max() < 5.0


def test_words_of_a_combination_say_its_coefficients(session):
    robot, _, table = session
    for c in combinations_of(fit(robot, table)):
        said = {}
        for sign, factor, name in re.findall(
            r"(^|- |\+ |-)(\d[\d.e+-]* )?([a-z_]+(?: [xyz])?)", c.words
        ):
            said[name] = (-1 if "-" in sign else 1) * float(factor or 1)
        unsaid = re.search(r" and (\d+) smaller parts$", c.words)
        assert len(said) + int(unsaid.group(1) if unsaid else 0) == len(c.coefficients)
        for name, value in said.items():
            assert c.coefficients[name] == pytest.approx(value, rel=6e-3)


def remedied(robot, plan, remedy, rng):
    """The pose that a remedy asks for."""
    first = plan[0]
    joint = re.search(r"moves (\w+) by itself", remedy)
    foot = re.search(r"on the (\w+) foot", remedy)
    if joint:
        q = first.q.copy()
        q[robot.tree.joint_names.index(joint.group(1))] += 0.5
        return replace(first, pose=99, q=q)
    if foot and "several" not in remedy:
        return replace(first, pose=99, support=foot.group(1))
    if "several joints" in remedy:
        q = first.q + rng.normal(0, 0.4, first.q.shape)
        support = foot.group(1)
        return replace(first, pose=99, q=q, support=support, floor_roll=0.15, floor_pitch=0.1)
    if "slope" in remedy:
        return replace(first, pose=99, floor_roll=0.15, floor_pitch=0.1)
    return None


@pytest.mark.parametrize("seed", [1, 2])
def test_every_remedy_shows_something_new(seed, odd):
    rng = np.random.default_rng(seed)
    robot = odd.odd_biped(rng)
    kinds = set()
    for plan in (poses(robot, rng, 3), poses(robot, rng, 60)):
        found = fit(robot, odd.ideal_table(robot, plan))
        for unseen in unseen_directions(found):
            pose = remedied(robot, plan, unseen.remedy, rng)
            if pose is None:
                assert "no pose shows it" in unseen.remedy
                continue
            kinds.add(unseen.remedy.split()[2])
            more = fit(robot, odd.ideal_table(robot, [*plan, pose]))
            assert more.rank > found.rank, unseen
            columns = [found.unknowns.names.index(p) for p in unseen.parts]
            basis = np.eye(found.unknowns.size)[columns]
            assert more.visibility(basis).sum() < found.visibility(basis).sum()
    assert len(kinds) >= 2


@pytest.mark.parametrize("free_masses", [False, True])
def test_directions_that_statics_merges_are_all_that_rich_poses_leave_unseen(free_masses, odd):
    rng = np.random.default_rng(8)
    robot = odd.odd_biped(rng)
    plan = [
        replace(p, floor_roll=float(rng.normal(0, 0.1)), floor_pitch=float(rng.normal(0, 0.1)))
        for s in ("double", "left", "right")
        for p in poses(robot, rng, 25, s)
    ]
    plan = [replace(p, pose=i) for i, p in enumerate(plan)]
    unknowns = unknowns_of(robot, free_masses=free_masses)
    found = adjust(robot, unknowns, groups_of(robot, odd.ideal_table(robot, plan)))
    merged = merged_directions(unknowns)
    directions = np.array([m.direction / unknowns.scale for m in merged])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    assert np.linalg.matrix_rank(directions) == len(merged) == found.unseen.shape[1]
    assert np.abs(directions @ found.seen).max() < 1e-6


def test_what_no_pose_shows_stays_unseen_in_a_hundred_poses(odd):
    rng = np.random.default_rng(3)
    robot = odd.odd_biped(rng)
    rich = [
        replace(
            p, pose=i, floor_roll=float(rng.normal(0, 0.1)), floor_pitch=float(rng.normal(0, 0.1))
        )
        for i, p in enumerate(
            p for s in ("double", "left", "right") for p in poses(robot, rng, 30, s)
        )
    ]
    found = fit(robot, odd.ideal_table(robot, rich))
    unseen = unseen_directions(found)
    assert len(unseen) == found.unknowns.size - found.rank
    assert {u.remedy.partition(":")[0] for u in unseen} == {"no pose shows it"}


def test_a_foot_that_nothing_measures_is_no_remedy(odd):
    robot = odd.odd_biped(np.random.default_rng(4))
    feet = {**robot.feet, "right": replace(robot.feet["right"], sensor=None)}
    one = replace(robot, feet=feet, sensors={"l_ft": robot.sensors["l_ft"]})
    table = odd.ideal_table(one, poses(one, np.random.default_rng(5), 3))
    words = unseen_directions(fit(one, table))
    assert words
    assert not any("right foot" in u.remedy for u in words)


def test_an_unseen_part_by_itself_is_said_to_be_so(session):
    robot, _, table = session
    found = fit(robot, table)
    for unseen in unseen_directions(found):
        columns = [found.unknowns.names.index(p) for p in unseen.parts]
        if len(columns) == 1:
            assert unseen.words == f"{unseen.parts[0]} is not seen at all"
            assert found.visibility(np.eye(found.unknowns.size)[columns[0]]) > 0.9
        else:
            assert unseen.words.startswith(" against ".join(unseen.parts))


def test_condition_is_the_ratio_of_the_extreme_singular_values(session):
    robot, _, table = session
    found = fit(robot, table)
    assert found.condition == found.singular.max() / found.singular.min()
    assert (np.diff(found.singular) <= 0).all()
    information = np.linalg.inv(
        found.seen.T
        @ (found.cov / np.outer(found.unknowns.scale, found.unknowns.scale))
        @ found.seen
    )
    np.testing.assert_allclose(
        np.sqrt(np.linalg.eigvalsh(information))[::-1], found.singular, rtol=1e-4
    )


def test_a_fold_without_its_only_slope_is_counted(odd):
    rng = np.random.default_rng(6)
    robot = odd.odd_biped(rng)
    plan = poses(robot, rng, 24)
    plan[4] = replace(plan[4], floor_roll=0.1, floor_pitch=0.1)
    whole = fit(robot, odd.ideal_table(robot, plan))
    assert whole.rank == 1 + fit(robot, odd.ideal_table(robot, plan[5:])).rank
    held = held_out_error(robot, whole.unknowns, whole.groups, whole.rank)
    assert held.rank_lost == 1
    assert held.poses == 24
