# SPDX-License-Identifier: Apache-2.0
"""Frames are conventions: how sensors, soles and the tree are described changes no result."""

from dataclasses import replace

import numpy as np
import pytest

from comcal.identify.adjust import adjust
from comcal.identify.cad_inputs import cad_inputs
from comcal.identify.groups import groups_of
from comcal.identify.paper_route import paper_route
from comcal.identify.solution import total_com_at
from comcal.identify.unknowns import unknowns_of
from comcal.measure.plan import PlannedPose
from comcal.measure.poses_csv import read_poses
from comcal.robot.frames import rotation_about, rotation_from_rpy
from comcal.robot.model import Sense
from comcal.statics.coefficients import balance_coefficients
from comcal.statics.configurations import placed_in_stance
from comcal.statics.support import carrier_of

TURN = rotation_from_rpy([0.3, -1.2, 2.0])


def fit(robot, table):
    return adjust(robot, unknowns_of(robot), groups_of(robot, table))


def poses(robot, rng, n, support):
    names = robot.tree.joint_names
    return [PlannedPose(i, rng.normal(0, 0.25, len(names)), support) for i in range(n)]


def mixed(robot, rng, n=8):
    plan = [p for s in ("double", "left", "right") for p in poses(robot, rng, n, s)]
    return [replace(p, pose=i) for i, p in enumerate(plan)]


def same_noise(odd, table, other, turns):
    """Both tables with the same errors, those of turned sensors turned."""
    rng = np.random.default_rng(5)
    w, w_other = {}, {}
    for name in table.wrench:
        e = rng.normal(size=table.wrench[name].shape) * np.repeat([odd.FORCE, odd.MOMENT], 3)
        w[name] = table.wrench[name] + e
        R = turns.get(name, np.eye(3))
        w_other[name] = other.wrench[name] + np.hstack([e[:, :3] @ R, e[:, 3:] @ R])
    return replace(table, wrench=w), replace(other, wrench=w_other)


def test_sensor_axes_may_be_turned_at_will(odd):
    rng = np.random.default_rng(1)
    robot = odd.odd_biped(rng)
    turned = odd.turned_sensor(robot, "l_ft", TURN)
    plan = mixed(robot, rng)
    tables = [odd.ideal_table(r, plan, rng=np.random.default_rng(2)) for r in (robot, turned)]
    assert np.abs(tables[0].wrench["l_ft"] - tables[1].wrench["l_ft"]).max() > 1.0
    tables = same_noise(odd, *tables, {"l_ft": TURN})
    a, b = (balance_coefficients(r, t) for r, t in zip((robot, turned), tables, strict=True))
    np.testing.assert_allclose(a.values, b.values, atol=1e-12)
    np.testing.assert_allclose(a.cov, b.cov, atol=1e-12)
    a, b = (fit(r, t) for r, t in zip((robot, turned), tables, strict=True))
    assert a.rank == b.rank
    assert a.chi2 == pytest.approx(b.chi2, rel=1e-7)
    scale = np.sqrt(np.diag(a.cov) + np.diag(a.cov_cad))
    assert (np.abs(a.theta - b.theta) / scale).max() < 1e-5


def test_sensor_axes_may_be_turned_at_will_by_cramer(skewed, odd):
    turned_bench = replace(skewed, robot=odd.turned_sensor(skewed.robot, "l_foot", TURN))
    a, b = (paper_route(x.robot, x.measure()) for x in (skewed, turned_bench))
    np.testing.assert_allclose(a.choices[0].w, b.choices[0].w, atol=1e-10)
    for x, y in zip(a.totals, b.totals, strict=True):
        np.testing.assert_allclose(x.xyz, y.xyz, atol=1e-10)
        np.testing.assert_allclose(x.cov, y.cov, atol=1e-12)
    np.testing.assert_allclose(a.choices[0].noise_gain, b.choices[0].noise_gain, rtol=1e-6)


def test_yawed_soles_turn_p_of_one_foot_and_nothing_else(odd):
    rng = np.random.default_rng(3)
    robot = odd.odd_biped(rng, yaw=0.0)
    yaw = np.eye(4)
    yaw[:3, :3] = rotation_about([0, 0, 1], 0.4)
    feet = {n: replace(f, T_link_sole=f.T_link_sole @ yaw) for n, f in robot.feet.items()}
    yawed = replace(robot, feet=feet)
    plan = mixed(robot, rng)
    table = odd.noisy(odd.ideal_table(robot, plan, rng=rng), rng)
    a, b = balance_coefficients(robot, table), balance_coefficients(yawed, table)
    np.testing.assert_allclose(a.values[:8], b.values[:8], atol=1e-12)
    R = yaw[:2, :2]
    np.testing.assert_allclose(a.values[8:, [0, 2]], b.values[8:, [0, 2]] @ R.T, atol=1e-12)
    np.testing.assert_allclose(a.values[8:, [1, 3]], b.values[8:, [1, 3]] @ R.T, atol=1e-12)
    a, b = fit(robot, table), fit(yawed, table)
    np.testing.assert_allclose(a.theta, b.theta, atol=1e-9)


@pytest.mark.parametrize("root", ["l_sole", "r_foot", "hand"])
def test_the_root_may_be_any_link(root, odd):
    rng = np.random.default_rng(4)
    robot = odd.odd_biped(rng)
    other = odd.rooted_at(robot, root)
    plan = [
        replace(p, floor_pitch=float(rng.normal(0, 0.1)), floor_roll=float(rng.normal(0, 0.1)))
        for p in mixed(robot, rng)
    ]
    columns = [robot.tree.joint_names.index(name) for name in other.tree.joint_names]
    moved = [replace(p, q=p.q[columns]) for p in plan]
    clean, again = odd.ideal_table(robot, plan), odd.ideal_table(other, moved)
    for name in clean.wrench:  # the oracle itself does not notice
        np.testing.assert_allclose(again.wrench[name], clean.wrench[name], atol=1e-9)

    true = perturbed(robot, rng)
    clean = odd.ideal_table(robot, plan, true_robot=true, rng=rng)
    for table, atol in ((clean, 1e-8), (odd.noisy(clean, rng), None)):
        same = replace(table, q=table.q[:, columns], q_cov=table.q_cov[:, columns])
        a, b = balance_coefficients(robot, table), balance_coefficients(other, same)
        np.testing.assert_allclose(a.values, b.values, atol=1e-12)
        np.testing.assert_allclose(a.cov, b.cov, atol=1e-9)
        a, b = fit(robot, table), fit(other, same)
        assert a.rank == b.rank
        for p, m in zip(plan[::5], moved[::5], strict=True):
            x, cov, cad = total_com_at(a, cad_inputs(a), p.support, p.q[None])
            y, _, _ = total_com_at(b, cad_inputs(b), m.support, m.q[None])
            if atol:
                truth = placed_in_stance(true, carrier_of(true, p.support), p.q[None]).total_com()
                np.testing.assert_allclose(x, truth, atol=atol)
                np.testing.assert_allclose(y, truth, atol=atol)
            else:  # noise turns the directions that are not seen, in each frame a little otherwise
                sigma = np.sqrt(np.diag(cov[0] + cad[0]))
                assert (np.abs(x - y)[0] < 0.3 * sigma).all()


def perturbed(robot, rng):
    free = unknowns_of(robot).links
    links = tuple(
        replace(k, com=k.com + rng.normal(0, 0.02, 3)) if i in free else k
        for i, k in enumerate(robot.tree.links)
    )
    return replace(robot, tree=replace(robot.tree, links=links))


def test_a_sensor_that_reports_on_ground_and_is_not_tared_gives_the_same(odd, tmp_path):
    """From the file on: raw = offset - what the part below exerts on the part above."""
    rng = np.random.default_rng(7)
    robot = odd.odd_biped(rng)
    table = odd.noisy(odd.ideal_table(robot, mixed(robot, rng), rng=rng), rng)
    sensors = {
        "l_ft": replace(robot.sensors["l_ft"], sense=Sense.ON_GROUND),
        "r_ft": robot.sensors["r_ft"],
    }
    told = replace(robot, sensors=sensors, noise=replace(robot.noise, encoder=odd.ENCODER))
    offset = {s: rng.normal(0, 3.0, 6) for s in sensors}
    raw = {
        "l_ft": offset["l_ft"] - table.wrench["l_ft"],
        "r_ft": offset["r_ft"] + table.wrench["r_ft"],
    }
    header = [
        "pose", "support", *(f"q.{n}" for n in robot.tree.joint_names),
        *(f"ft.{s}.{c}" for s in raw for c in ("fx", "fy", "fz", "tx", "ty", "tz")),
    ]  # fmt: skip
    lines = [",".join(header)]
    for i, (pose, support) in enumerate(zip(table.pose, table.support, strict=True)):
        numbers = np.concatenate([table.q[i], *(w[i] for w in raw.values())])
        lines.append(",".join([str(pose), support, *(repr(float(x)) for x in numbers)]))
    path = tmp_path / "poses.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    read = read_poses(path, told, {s: (v, np.zeros(6)) for s, v in offset.items()})
    for name, w in table.wrench.items():
        np.testing.assert_allclose(read.wrench[name], w, atol=1e-12)
    a, b = fit(robot, table), fit(told, read)
    np.testing.assert_allclose(a.theta, b.theta, atol=1e-8)
    assert a.chi2 == pytest.approx(b.chi2, rel=1e-9)
