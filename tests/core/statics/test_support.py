# SPDX-License-Identifier: Apache-2.0
"""Which sensors carry the robot: any feet, plates, gaps in the data; P is the same whoever asks."""

from dataclasses import replace

import numpy as np
import pytest

from comcal.errors import ConfigError, DataError, MissingColumnError, NotFiniteError
from comcal.identify.groups import groups_of
from comcal.measure.plan import PlannedPose
from comcal.robot.kinematics import place_links
from comcal.robot.model import Plate
from comcal.statics.balance import balance_at, input_jacobian, residual
from comcal.statics.coefficients import balance_coefficients
from comcal.statics.configurations import placed_in_stance
from comcal.statics.stance import stance_frame
from comcal.statics.support import carrier_of, loaded_wrenches


def poses(robot, rng, n=4, support="double", **kwargs):
    names = robot.tree.joint_names
    return [PlannedPose(i + 1, rng.normal(0, 0.2, len(names)), support, **kwargs) for i in range(n)]


def carried_com(robot, carrier, q):
    """CoM of what is carried, in P."""
    at = placed_in_stance(robot, carrier, q)
    masses = robot.tree.masses * carrier.carried
    return np.einsum("k,nki->ni", masses, at.coms) / masses.sum()


def on_line(robot, table):
    """Distance of the carried CoM from the line that the coefficients state, per pose."""
    found = balance_coefficients(robot, table)
    off = []
    for i, (alpha, beta, gamma, delta) in zip(found.rows, found.values, strict=True):
        carrier = carrier_of(robot, table.support[i])
        x, y, z = carried_com(robot, carrier, table.q[i][None])[0]
        off.append([alpha + beta * z - x, gamma + delta * z - y])
    return np.array(off), found


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("support", ["double", "left", "right"])
def test_the_carried_com_lies_on_the_line_of_an_awkward_robot(seed, support, odd):
    rng = np.random.default_rng(seed)
    robot = odd.odd_biped(rng)
    plan = poses(robot, rng, support=support, floor_roll=0.05, floor_pitch=-0.08)
    off, found = on_line(robot, odd.ideal_table(robot, plan, rng=rng))
    assert np.abs(off).max() < 1e-12
    carried = robot.tree.masses[carrier_of(robot, support).carried].sum()
    np.testing.assert_allclose(found.mass, carried, rtol=1e-12)


def test_p_is_the_same_whatever_the_feet_are_called_and_in_which_order(odd):
    robot = odd.odd_biped(np.random.default_rng(3))
    at = place_links(robot.tree, np.zeros((1, len(robot.tree.joint_names))))
    wanted = stance_frame(robot, "double", at)
    # x to the toes: within the yaws of the soles, the x of the upright root.
    assert wanted[0][0, 0, 0] > 0.9
    left, right = robot.feet["left"], robot.feet["right"]
    for feet in (
        {"left": left, "right": right},
        {"a": replace(right, name="a"), "b": replace(left, name="b")},
        {"left": replace(right, name="left"), "right": replace(left, name="right")},
    ):
        found = stance_frame(replace(robot, feet=feet), "double", at)
        for a, b in zip(found, wanted, strict=True):
            np.testing.assert_allclose(a, b, atol=1e-15)


def test_p_of_two_feet_is_midway_with_y_from_right_to_left(odd):
    rng = np.random.default_rng(4)
    robot = odd.odd_biped(rng)
    at = place_links(robot.tree, rng.normal(0, 0.3, (1, len(robot.tree.joint_names))))
    R, p = (x[0] for x in stance_frame(robot, "double", at))
    left, right = (at.joint(f"{s}_ft")[1][0] for s in "lr")
    np.testing.assert_allclose(p, (left + right) / 2, atol=1e-15)
    normals = [at.link(f.link)[0][0] @ f.T_link_sole[:3, 2] for f in robot.feet.values()]
    z = np.sum(normals, axis=0)
    np.testing.assert_allclose(R[:, 2], z / np.linalg.norm(z), atol=1e-15)
    assert (left - right) @ R[:, 0] == pytest.approx(0.0, abs=1e-15)
    assert (left - right) @ R[:, 1] > 0
    assert np.linalg.det(R) == pytest.approx(1.0)


def without_sensors(robot, feet=("left", "right")):
    kept = {n: replace(f, sensor=None) if n in feet else f for n, f in robot.feet.items()}
    used = {f.sensor for f in kept.values()}
    return replace(robot, feet=kept, sensors={n: s for n, s in robot.sensors.items() if n in used})


def in_frame(R, p, wrench):
    """A wrench about the root, in root axes, as a sensor at (R, p) reads it."""
    F, M = wrench[:3], wrench[3:]
    return np.concatenate([R.T @ F, R.T @ (M - np.cross(p, F))])


def plate_table(odd, robot, plan, frames):
    """Wrenches of plates that carry everything, shared equally."""
    up, m = np.array([0.05, -0.1, 1.0]), robot.tree.masses
    up /= np.linalg.norm(up)
    wrench = {name: np.zeros((len(plan), 6)) for name in frames}
    for i, pose in enumerate(plan):
        at = place_links(robot.tree, pose.q[None])
        F = m.sum() * robot.gravity * up
        M = np.cross(m @ at.coms[0], robot.gravity * up)
        for name, frame in frames.items():
            R, p = stance_frame(robot, pose.support, at) if frame == "world" else at.link(frame)
            wrench[name][i] = in_frame(R[0], p[0], np.concatenate([F, M]) / len(frames))
    return odd.table_of(robot, plan, wrench)


@pytest.mark.parametrize(
    "frames", [{"floor": "world"}, {"floor": "l_sole"}, {"one": "l_sole", "two": "r_foot"}]
)
def test_plates_carry_the_whole_robot(frames, odd):
    rng = np.random.default_rng(5)
    robot = without_sensors(odd.odd_biped(rng))
    sides = (("left", "right"),) if len(frames) == 1 else (("left",), ("right",))
    plates = {n: Plate(n, f, feet) for (n, f), feet in zip(frames.items(), sides, strict=True)}
    robot = replace(robot, plates=plates)
    table = plate_table(odd, robot, poses(robot, rng), frames)
    off, found = on_line(robot, table)
    assert np.abs(off).max() < 1e-12
    np.testing.assert_allclose(found.mass, robot.tree.total_mass, rtol=1e-12)
    (group,) = groups_of(robot, table)
    balance = balance_at(robot, group.carrier, group.q, group.w)
    h = robot.tree.masses[:, None] * robot.tree.coms
    assert np.abs(residual(balance, robot.tree.total_mass, h)).max() < 1e-9


@pytest.mark.parametrize("support", ["double", "left"])
def test_input_jacobian_of_a_plate_in_the_world_follows_every_standing_foot(support, odd):
    rng = np.random.default_rng(6)
    robot = without_sensors(odd.odd_biped(rng))
    robot = replace(robot, plates={"floor": Plate("floor", "world", ("left", "right"))})
    carrier = carrier_of(robot, support)
    h = rng.normal(0, 0.5, (len(robot.tree.links), 3))
    q, w = rng.normal(0, 0.3, (2, len(robot.tree.joint_names))), rng.normal(0, 50, (2, 1, 6))
    _, B_q = input_jacobian(balance_at(robot, carrier, q, w), h)
    for j in range(q.shape[1]):
        step = np.eye(q.shape[1])[j] * 1e-6
        ahead, back = (
            residual(balance_at(robot, carrier, q + sign * step, w), 20.0, h) for sign in (1, -1)
        )
        np.testing.assert_allclose(B_q[:, :, j], (ahead - back) / 2e-6, atol=1e-5)


def test_a_plate_under_a_foot_without_sensor_speaks_for_all_its_feet(odd):
    """Else what the other foot's own sensor carries would be counted twice."""
    robot = without_sensors(odd.odd_biped(np.random.default_rng(7)), feet=("left",))
    robot = replace(robot, plates={"floor": Plate("floor", "world", ("left", "right"))})
    double, right = carrier_of(robot, "double"), carrier_of(robot, "right")
    assert double.sensors == ("floor",)
    assert double.carried.all()
    assert right.sensors == ("r_ft",)
    assert not right.carried.all()


def test_a_foot_that_nothing_measures_is_refused_by_name(odd):
    robot = without_sensors(odd.odd_biped(np.random.default_rng(7)), feet=("left",))
    with pytest.raises(ConfigError, match="'left' stands but has neither"):
        carrier_of(robot, "double")
    assert carrier_of(robot, "right").sensors == ("r_ft",)


@pytest.fixture
def odd_table(odd):
    rng = np.random.default_rng(8)
    robot = odd.odd_biped(rng)
    plan = [*poses(robot, rng), *poses(robot, rng, support="left")]
    plan = [replace(p, pose=i) for i, p in enumerate(plan)]
    return robot, odd.ideal_table(robot, plan, rng=rng)


def test_a_wrench_missing_from_a_sensor_in_the_air_changes_nothing(odd_table):
    robot, table = odd_table
    w = table.wrench["r_ft"].copy()
    w[4:] = np.nan
    gaps = replace(table, wrench={**table.wrench, "r_ft": w})
    np.testing.assert_array_equal(
        balance_coefficients(robot, gaps).values, balance_coefficients(robot, table).values
    )


def test_a_channel_missing_from_a_loaded_sensor_is_named(odd_table):
    robot, table = odd_table
    w = table.wrench["l_ft"].copy()
    w[2, [1, 5]] = np.nan
    gaps = replace(table, wrench={**table.wrench, "l_ft": w})
    with pytest.raises(NotFiniteError, match=r"pose 2.*ft\.l_ft\.fy, ft\.l_ft\.tz missing"):
        groups_of(robot, gaps)
    with pytest.raises(NotFiniteError):
        balance_coefficients(robot, gaps)


def test_poses_whose_com_is_given_need_no_wrench(odd_table):
    robot, table = odd_table
    w, com = table.wrench["l_ft"].copy(), table.com.copy()
    w[[1, 5]], com[[1, 5], 0] = np.nan, 0.01
    gaps = replace(table, wrench={**table.wrench, "l_ft": w}, com=com)
    assert balance_coefficients(robot, gaps).rows == (0, 2, 3, 4, 6, 7)
    assert sorted(row for g in groups_of(robot, gaps) for row in g.rows) == [0, 2, 3, 4, 6, 7]


def test_an_absent_sensor_is_named_unless_the_com_is_given_instead(odd_table):
    robot, table = odd_table
    only_left = replace(table, wrench={"l_ft": table.wrench["l_ft"]})
    with pytest.raises(MissingColumnError, match=r"no wrench of sensor 'r_ft'.*double"):
        groups_of(robot, only_left)
    com = table.com.copy()
    com[:4, 0] = 0.01
    assert [g.carrier.support for g in groups_of(robot, replace(only_left, com=com))] == ["left"]


@pytest.mark.parametrize(("channel", "family"), [(2, "ft_force"), (5, "ft_moment")])
@pytest.mark.parametrize("value", [0.0, np.nan])
def test_a_wrench_without_an_error_is_refused_and_the_key_named(channel, family, value, odd_table):
    robot, table = odd_table
    cov = table.wrench_cov["l_ft"].copy()
    cov[3, channel, channel] = value
    exact = replace(table, wrench_cov={**table.wrench_cov, "l_ft": cov})
    for refuse in (groups_of, balance_coefficients):
        with pytest.raises(DataError, match=rf"pose 3.*noise\.{family} in robot\.yaml") as caught:
            refuse(robot, exact)
        assert caught.value.exit_code == 3


def test_wrenches_are_taken_in_the_order_of_the_carrier(odd_table):
    robot, table = odd_table
    carrier = carrier_of(robot, "double")
    w, cov = loaded_wrenches(carrier, table)
    for s, name in enumerate(carrier.sensors):
        np.testing.assert_array_equal(w[:, s], table.wrench[name])
        np.testing.assert_array_equal(cov[:, s], table.wrench_cov[name])


@pytest.mark.parametrize("support", ["double", "left"])
def test_p_of_feet_without_sensors_starts_at_their_soles(support, odd):
    rng = np.random.default_rng(9)
    robot = without_sensors(odd.odd_biped(rng))
    at = place_links(robot.tree, rng.normal(0, 0.3, (1, len(robot.tree.joint_names))))
    soles = []
    for name in ("left", "right") if support == "double" else (support,):
        R, p = at.link(robot.feet[name].link)
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = R[0], p[0]
        soles.append((T @ robot.feet[name].T_link_sole)[:3, 3])
    _, origin = stance_frame(robot, support, at)
    np.testing.assert_allclose(origin[0], np.mean(soles, axis=0), atol=1e-15)
