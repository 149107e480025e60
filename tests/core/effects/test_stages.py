# SPDX-License-Identifier: Apache-2.0
"""Several effects of one instrument are corrected against their order, whichever is named first."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest

from comcal.effects.effect import State
from comcal.effects.registry import corrected, effects, in_stages
from comcal.predict.assumed import Assumed
from comcal.robot.changes import Change
from comcal.robot.changes_table import CHANNELS

JOINT, SENSOR = "l_knee", "l_foot"


def together(state: State, changes: Iterable[Change]) -> State:
    """Correct for what was found together."""
    return in_stages(state, [(effects()[change.effect], change) for change in changes])


def test_an_offset_of_a_current_is_taken_off_before_it_is_scaled(biped14) -> None:
    """The sensor says tau / (K (1 + e)) + offset; scaled first, 0.5 A would read as 0.6."""
    robot, rng = biped14.robot, np.random.default_rng(1)
    table = biped14.measure(biped14.plan[:4])
    true = rng.uniform(1.0, 3.0, table.q.shape)
    read = true.copy()
    k = robot.tree.joint_names.index(JOINT)
    read[:, k] = true[:, k] / 1.2 + 0.5
    changes = [
        Change("torque_constant", JOINT, {"relative": 0.2}),
        Change("current_offset", JOINT, {"offset": 0.5}),
    ]
    for order in permutations(changes):
        _, found = together((Assumed(robot), replace(table, current=read)), order)
        np.testing.assert_allclose(found.current, true)


def test_an_offset_of_a_sensor_is_taken_off_before_its_gain(biped14) -> None:
    robot, rng = biped14.robot, np.random.default_rng(2)
    table = biped14.measure(biped14.plan[:4])
    true = rng.uniform(-5.0, 5.0, table.wrench[SENSOR].shape)
    gain, bias = rng.uniform(-0.3, 0.3, 6), rng.uniform(-9.0, 9.0, 6)
    # Both on the sensor's side of a cut of which the robot's side is read.
    read = {**table.wrench, SENSOR: true * (1.0 + gain)}
    offset = Change("ft_bias", SENSOR, dict(zip(CHANNELS, bias.tolist(), strict=True)))
    _, shifted = corrected(Assumed(robot), replace(table, wrench=read), [offset])
    added = read[SENSOR] - shifted.wrench[SENSOR]
    read = {**read, SENSOR: read[SENSOR] + added}
    scale = Change("ft_gain", SENSOR, {f"gain_{c}": g for c, g in zip(CHANNELS, gain, strict=True)})
    for order in permutations([offset, scale]):
        _, found = together((Assumed(robot), replace(table, wrench=read)), order)
        np.testing.assert_allclose(found.wrench[SENSOR], true, atol=1e-9)


def test_a_sensor_is_turned_back_before_its_gain(biped14) -> None:
    """It reads R (1 + gain) w: turned back last, 0.05 rad at a gain of 1.1 would be 0.055."""
    robot, rng = biped14.robot, np.random.default_rng(3)
    table = biped14.measure(biped14.plan[:4])
    true = rng.uniform(-5.0, 5.0, table.wrench[SENSOR].shape)
    gain, turn = 0.1, 0.05
    scale = Change("ft_gain", SENSOR, {"gain_fz": gain})
    turned = Change("ft_mounting", SENSOR, {"ry": turn})
    scaled = true.copy()
    scaled[:, 2] *= 1.0 + gain
    read = {**table.wrench, SENSOR: scaled}
    # Turning back by the opposite angle is turning.
    back = Change("ft_mounting", SENSOR, {"ry": -turn})
    _, seen = corrected(Assumed(robot), replace(table, wrench=read), [back])
    for order in permutations([turned, scale]):
        _, found = together((Assumed(robot), seen), order)
        np.testing.assert_allclose(found.wrench[SENSOR], true, atol=1e-9)


def test_a_spring_gives_way_to_what_everything_else_weighs(biped14) -> None:
    robot = biped14.robot
    table = biped14.measure(biped14.plan[:4])
    spring = Change("joint_compliance", "waist_pitch", {"stiffness": 2000.0})
    load = Change("payload", "torso", {"mass": 5.0, "com_x": 0.1})
    state = Assumed(robot), table
    loaded = together(state, [load])
    expected = effects()["joint_compliance"].correct(*loaded, spring)[1].q
    assert np.abs(expected - together(state, [spring])[1].q).max() > 1e-4
    for order in permutations([spring, load]):
        np.testing.assert_array_equal(together(state, order)[1].q, expected)


@pytest.mark.parametrize(
    "own",
    [
        Change("link_mass", "torso", {"mass": -0.7}),
        Change("link_com", "torso", {"com_x": 0.02, "com_z": -0.01}),
    ],
)
def test_what_a_link_carries_is_not_the_link(biped14, own: Change) -> None:
    """Its own CoM is off by as much, and its mass sits where it sat, whatever is strapped on."""
    robot = biped14.robot
    table = biped14.measure(biped14.plan[:2])
    load = Change("payload", "torso", {"mass": 30.0, "com_x": 0.3, "com_y": -0.2})
    one, other = (
        together((Assumed(robot), table), order)[0].robot.tree
        for order in permutations([own, load])
    )
    k = robot.tree.link_index["torso"]
    assert one.links[k].mass == pytest.approx(other.links[k].mass)
    np.testing.assert_allclose(one.links[k].com, other.links[k].com, atol=1e-12)
    alone = together((Assumed(robot), table), [load])[0].robot.tree.links[k].com
    assert np.abs(alone - one.links[k].com).max() > 1e-3


@pytest.mark.parametrize("first", [0, 1])
def test_wires_are_put_right_before_anything_else(biped14, first: int) -> None:
    robot = biped14.robot
    table = biped14.measure(biped14.plan[:4])
    true = table.wrench[SENSOR]
    unit = Change("unit_error", SENSOR, {"channels": ("fx", "fy", "fz"), "factor": 9.0})
    offset = Change("ft_bias", SENSOR, {"fz": 4.0})
    _, shifted = corrected(Assumed(robot), table, [offset])
    read = true + (true - shifted.wrench[SENSOR])
    read[:, :3] *= 9.0
    order = [unit, offset] if first == 0 else [offset, unit]
    wrong = replace(table, wrench={**table.wrench, SENSOR: read})
    _, found = together((Assumed(robot), wrong), order)
    np.testing.assert_allclose(found.wrench[SENSOR], true, atol=1e-9)
