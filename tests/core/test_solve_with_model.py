# SPDX-License-Identifier: Apache-2.0
"""Solving with a known model: what it says is undone, and how well it says it is in every sigma."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from comcal.effects.extend import Extended, extend
from comcal.identify.paper_route import paper_route
from comcal.identify.scope import Scope
from comcal.identify.solution import Solution, solve_all
from comcal.measure.plan import PlannedPose
from comcal.measure.source import SourceRequest
from comcal.measure.table import PoseTable
from comcal.predict.assumed import Assumed
from comcal.predict.parity import parity
from comcal.robot.changes import Change
from comcal.robot.changes_text import parse_change
from comcal.robot.changes_yaml import KnownChange
from comcal.robot.model import Robot
from comcal.statics.coefficients import balance_coefficients
from comcal.workflow.sources import open_source

HIDDEN = {
    "payload@torso:mass=5,com_x=0.1,com_z=0.2": 5e-3,
    "payload@l_thigh:mass=1,com_z=-0.2": 5e-3,
    "link_length@waist_pitch:x=0.01": 1e-4,
    "joint_offset@waist_pitch:offset=0.02": 1e-3,
    "joint_offset@l_knee:offset=0.01": 1e-3,
    "joint_compliance@waist_pitch:stiffness=2000": 1e-4,
    "ft_gain@r_foot:gain_fz=0.05": 1e-3,
    "ft_bias@l_foot:fz=5,ty=0.5": 1e-3,
    "ft_mounting@l_foot:rx=0.02,ry=-0.01": 1e-3,
    "torque_constant@l_knee:relative=0.1": 1e-4,
    "imu_mounting:roll=0.02": 1e-5,
    "cable_pull@torso:force_x=8,force_y=3,force_z=-20": 1e-3,
    "tether@torso:force_x=5,k_xx=80": 1e-3,
    "external_contact@l_shin:force_x=10,force_z=5,point_x=0.1,poses=4+7+19": 1e-3,
    "external_contact@r_arm:force_y=10,poses=4+7+19": 1e-3,
}
"""What is hidden, and by how much it moves some CoM where nobody knows of it [m]."""
TORQUES = Scope(torques=True)


@pytest.fixture(scope="module")
def robot(biped14) -> Robot:
    """The biped with currents that count: its gears have no friction."""
    tolerances = replace(biped14.robot.tolerances, other={"joint_friction": 0.0})
    return replace(biped14.robot, tolerances=tolerances)


@pytest.fixture(scope="module")
def plan(biped14) -> tuple[PlannedPose, ...]:
    """Every third pose, and all that hang."""
    return tuple(p for i, p in enumerate(biped14.plan) if i % 3 == 0 or p.support == "none")


@pytest.fixture(scope="module")
def clean(biped14, robot, plan) -> PoseTable:
    table = biped14.measure(plan)
    table = replace(
        table, torque=np.full(table.q.shape, np.nan), current_var=np.full(table.q.shape, 1e-4)
    )
    return readings(robot, table, plan)


@pytest.fixture(scope="module")
def nominal(robot, clean) -> np.ndarray:
    """CoMs found where nothing is hidden."""
    return coms(solved(robot, clean))


def readings(robot: Robot, clean: PoseTable, plan: Sequence, *hidden: str) -> PoseTable:
    """What sensors without errors read of a robot that hides something."""
    request = SourceRequest(robot, seed=1, effects=hidden, noise=False, plan=tuple(plan))
    blocks = []
    with open_source("builtin", request) as source:
        for pose in plan:
            source.move_to(pose)
            blocks.append(source.read(1 / 120))
    return replace(
        clean,
        q=np.array([b.q[0] for b in blocks]),
        wrench={s: np.array([b.wrenches[s][0] for b in blocks]) for s in clean.wrench},
        current=np.array([b.currents[0] for b in blocks]),
        imu=np.array([b.imu[0] for b in blocks]),
        t=np.array([b.t[0] for b in blocks]),
    )


def coms(solution: Solution, added: Change | None = None) -> np.ndarray:
    """CoMs that are measured by themselves, less a body that is known to be added."""
    found = []
    for link in solution.links:
        com, mass = np.where(link.identifiable, link.com, 0.0), link.mass
        if added is not None and added.effect == "payload" and added.target == link.link:
            place = np.array(added.numbers("com_x", "com_y", "com_z"))
            com = (mass * com - added.number("mass") * place) / (mass - added.number("mass"))
            com = np.where(link.identifiable, com, 0.0)
        found.append(com)
    return np.array(found)


def solved(robot: Robot, table: PoseTable) -> Solution:
    return solve_all(robot, table, TORQUES, links_only=True)


@pytest.mark.parametrize("hidden", HIDDEN)
def test_the_true_model_gives_the_nominal_links_back(hidden, plan, robot, clean, nominal) -> None:
    table = readings(robot, clean, plan, hidden)
    change = parse_change(hidden)
    known = extend(robot, table, [KnownChange(change)])
    found = solved(known.robot, known.table)
    assert found.adjustment.chi2 < 1e-3
    np.testing.assert_allclose(coms(found, change), nominal, atol=1e-6)
    assert np.abs(coms(solved(robot, table)) - nominal).max() > HIDDEN[hidden]


def test_two_changes_are_undone_together_in_their_order(plan, robot, clean) -> None:
    hidden = ("payload@torso:mass=3,com_z=0.2", "cable_pull@torso:force_x=10")
    known = [KnownChange(parse_change(text)) for text in hidden]
    both = extend(robot, readings(robot, clean, plan, *hidden), known)
    assert solved(both.robot, both.table).adjustment.chi2 < 1e-6


def test_readings_without_loads_are_those_of_the_same_model_without_loads(
    plan, robot, clean
) -> None:
    """All kinds of rows but closure vanish, of whatever support; the split may be another one."""
    hidden = "external_contact@r_shin:force_x=10,force_y=4"
    known = extend(robot, readings(robot, clean, plan, hidden), [KnownChange(parse_change(hidden))])
    left = parity(Assumed(known.robot), known.table)
    kinds = {row.kind for row in left.row}
    assert kinds == {"equilibrium", "sensor", "torque", "closure", "imu"}
    assert np.nanmax(np.abs(left.values)) < 1e-9


def known_with_sigma(robot: Robot, table: PoseTable, text: str, **sigma: float) -> Extended:
    return extend(robot, table, [KnownChange(parse_change(text), sigma)])


def test_what_has_a_sigma_is_shared_exact_or_of_no_account(robot, clean) -> None:
    gain = known_with_sigma(robot, clean, "ft_gain@r_foot:gain_fz=0.05", gain_fz=0.01)
    assert gain.shared == ("ft_gain@r_foot gain_fz",)
    assert (gain.exact, gain.idle) == ((), ())
    body = known_with_sigma(robot, clean, "payload@torso:mass=5", mass=0.1)
    assert body.exact == ("payload@torso mass",)
    assert not body.table.shared
    for text in ("ground_tilt:roll=0.01", "sole_compliance@left:tilt_x=1e-4"):
        key = text.partition(":")[2].partition("=")[0]
        idle = known_with_sigma(robot, clean, text, **{key: 0.001})
        assert idle.idle == (text.partition(":")[0],)
        assert (idle.shared, idle.exact) == ((), ())
    published = known_with_sigma(robot, clean, "internal_torque_term:factor=-1")
    assert published.idle == ("internal_torque_term",)
    np.testing.assert_array_equal(published.table.wrench["l_foot"], clean.wrench["l_foot"])


def test_sigmas_hold_when_the_model_is_off_by_its_own(biped14, robot, clean) -> None:
    """Noise and the error of the model drawn 12 times: the CoM's z value is standard normal."""
    sigma, rng = 0.03, np.random.default_rng(5)
    standing = clean.select([support != "none" for support in clean.support])
    true = replace(standing, current=np.full(standing.q.shape, np.nan))
    torso = robot.tree.link_index["torso"]
    z, taken_as_exact = [], []
    for _ in range(12):
        noisy, off = biped14.noisy(true, rng), sigma * rng.standard_normal()
        known = known_with_sigma(
            robot, noisy, f"joint_offset@waist_pitch:offset={off!r}", offset=sigma
        )
        for store, shared in ((z, known.table.shared), (taken_as_exact, {})):
            link = solve_all(
                known.robot, replace(known.table, shared=shared), links_only=True
            ).links[torso]
            store.append((link.com[0] - robot.tree.links[torso].com[0]) / np.sqrt(link.cov[0, 0]))
    assert 0.6 < np.sqrt(np.mean(np.square(z))) < 1.4
    assert np.sqrt(np.mean(np.square(taken_as_exact))) > 2.0


@pytest.mark.parametrize(
    ("text", "sigma"),
    [
        ("ft_gain@r_foot:gain_fz=0.02", {"gain_fz": 1e-4}),
        ("joint_offset@r_knee:offset=1e-5", {"offset": 1e-5}),
        ("cable_pull@waist:force_x=1", {"force_x": 1e-3}),
    ],
)
def test_the_sigma_of_a_model_moves_both_parts_of_the_papers_route(table1, text, sigma) -> None:
    """One shared error adds the square of what it does, by which the route is done again."""
    robot, table = table1.robot, table1.measure()
    known = known_with_sigma(robot, table, text, **sigma)
    change = parse_change(text)
    (key,) = sigma
    more = replace(change, parameters={key: change.number(key) + sigma[key]})
    moved = extend(robot, table, [KnownChange(more)])
    alone = extend(robot, table, [KnownChange(change)])
    values, covs = [], []
    for part in (alone, moved, known):
        coefficients, route = (
            f(part.robot, part.table) for f in (balance_coefficients, paper_route)
        )
        values.append((coefficients.values, np.array([t.xyz for t in route.totals])))
        covs.append((coefficients.cov, np.array([t.cov for t in route.totals])))
    assert values[0][1].size
    for k in range(2):
        step = values[1][k] - values[0][k]
        assert np.abs(step).max() > 0.0
        added = covs[2][k] - covs[0][k]
        expected = step[:, :, None] * step[:, None]
        # Feet that turn in P are left out of the sigma of a total.
        assert np.abs(added - expected).max() < 0.15 * np.abs(expected).max()
