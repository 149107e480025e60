# SPDX-License-Identifier: Apache-2.0
"""Stillness: what must pass and what must not. Not covered: real robots."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from comcal.measure.cop import centers_of_pressure
from comcal.measure.plan import PlannedPose
from comcal.measure.source import Block
from comcal.measure.still import StillCriterion, find_still_window, judge_stillness
from comcal.robot.model import Plate, Robot, Sense

RATE = 125.0
DEFAULT = StillCriterion()
Make = Callable[..., Any]


def reading(
    fake: Any, pose: PlannedPose, seconds: float, sway: Callable[[np.ndarray], np.ndarray]
) -> Block:
    fake.sway = sway
    fake.move_to(pose)
    return fake.read(seconds)


def test_a_still_robot_with_real_sensor_noise_is_accepted(
    make_fake: Make, robot: Robot, plan: tuple[PlannedPose, ...]
) -> None:
    accepted = [
        find_still_window(
            reading(make_fake(seed=s), plan[0], 1.4, np.zeros_like), robot, "double", DEFAULT
        )
        is not None
        for s in range(200)
    ]
    assert np.mean(accepted) > 0.98  # within 1.4 s; the others a little later


@pytest.mark.parametrize("frequency", [0.5, 0.8, 1.0, 1.7, 3.0, 5.0, 12.0])
@pytest.mark.parametrize("noise", [0.0, 0.5])
def test_a_sway_of_two_millimetres_is_refused_at_any_frequency(
    make_fake: Make,
    robot: Robot,
    plan: tuple[PlannedPose, ...],
    frequency: float,
    noise: float,
) -> None:
    for seed in range(5):
        phase = seed * 1.3
        block = reading(
            make_fake(noise=noise, seed=seed),
            plan[0],
            5.0,
            lambda t, phase=phase: 2e-3 * np.sin(2 * np.pi * frequency * t + phase),
        )
        assert find_still_window(block, robot, "double", DEFAULT) is None


@pytest.mark.parametrize("speed", [2e-3, 5e-3, 2e-2])
def test_a_drift_is_refused(
    make_fake: Make, robot: Robot, plan: tuple[PlannedPose, ...], speed: float
) -> None:
    block = reading(make_fake(), plan[0], 5.0, lambda t: speed * (t - t[0]))
    assert find_still_window(block, robot, "double", DEFAULT) is None


def test_without_settling_time_the_straight_line_alone_refuses_a_drift(
    make_fake: Make, robot: Robot, plan: tuple[PlannedPose, ...]
) -> None:
    # 8 mm/s is 1.5 mm in 200 ms, of standard deviation 0.46 mm: Cotton's test alone lets it pass.
    block = reading(make_fake(noise=0.0), plan[0], 1.0, lambda t: 8e-3 * t)
    only_cotton = replace(DEFAULT, settle=0.0, drift=1.0)
    assert find_still_window(block, robot, "double", only_cotton) is not None
    assert find_still_window(block, robot, "double", replace(DEFAULT, settle=0.0)) is None


def test_the_turning_point_of_a_slow_sway_deceives_cottons_test_alone(
    make_fake: Make, robot: Robot, plan: tuple[PlannedPose, ...]
) -> None:
    block = reading(
        make_fake(noise=0.0), plan[0], 3.0, lambda t: 5e-3 * np.sin(2 * np.pi * 0.8 * t)
    )
    assert find_still_window(block, robot, "double", replace(DEFAULT, settle=0.0)) is not None
    assert find_still_window(block, robot, "double", DEFAULT) is None


def test_the_latest_window_is_taken_and_has_the_length_asked_for(
    make_fake: Make, robot: Robot, plan: tuple[PlannedPose, ...]
) -> None:
    block = reading(
        make_fake(noise=0.0),
        plan[0],
        4.0,
        lambda t: np.where((t - t[0] > 1.0) & (t - t[0] < 3.0), 0.0, 0.01 * np.sin(40 * t)),
    )
    window = find_still_window(block, robot, "double", DEFAULT)
    assert window is not None
    assert window.stop - window.start == 25
    assert block.t[window.stop - 1] - block.t[0] == pytest.approx(3.0, abs=0.02)


@pytest.mark.parametrize(("rate", "samples"), [(1000.0, 200), (125.0, 25), (40.0, 25)])
def test_a_window_lasts_200_ms_and_has_25_samples(robot: Robot, rate: float, samples: int) -> None:
    n = int(3 * rate)
    wrench = np.tile([0.0, 0.0, 90.0, 0.0, 0.0, 0.0], (n, 1))
    block = Block(np.arange(n) / rate, np.zeros((n, 6)), {name: wrench for name in robot.sensors})
    window = find_still_window(block, robot, "double", DEFAULT)
    assert window is not None
    assert window.stop - window.start == samples


def test_an_unloaded_foot_is_not_still_but_says_so(fake: Any, robot: Robot) -> None:
    n = 200
    light = np.tile([0.0, 0.0, 1.0, 0.0, 0.0, 0.0], (n, 1))
    block = Block(np.arange(n) / RATE, np.zeros((n, 6)), {name: light for name in robot.sensors})
    judged = judge_stillness(block, robot, "double", DEFAULT)
    assert judged.window is None
    assert "must carry 10 N" in judged.reason


def test_the_reason_names_the_test_its_number_and_its_limit(
    make_fake: Make, robot: Robot, plan: tuple[PlannedPose, ...]
) -> None:
    block = reading(
        make_fake(noise=0.0), plan[0], 3.0, lambda t: 5e-3 * np.sin(2 * np.pi * 10.0 * t)
    )
    reason = judge_stillness(block, robot, "double", DEFAULT).reason
    assert reason.startswith("standard deviation of CoP x of l_foot + r_foot (3.")
    assert reason.endswith("mm, limit 1 mm)")


@pytest.mark.parametrize("damage", ["nan", "gap"])
def test_windows_with_lost_samples_are_not_used(
    make_fake: Make, robot: Robot, plan: tuple[PlannedPose, ...], damage: str
) -> None:
    block = reading(make_fake(noise=0.0), plan[0], 1.3, np.zeros_like)
    last = block.t.size - 1
    if damage == "nan":
        block.wrenches["l_foot"][last - 3, 2] = np.nan
        window = find_still_window(block, robot, "double", DEFAULT)
        assert window is not None
        assert window.stop <= last - 3
    else:
        t = block.t.copy()
        t[last - 3 :] += 1.0
        window = find_still_window(replace(block, t=t), robot, "double", DEFAULT)
        assert window is not None
        assert window.stop <= last - 3


def test_a_hanging_robot_is_judged_by_encoders_and_wrenches(fake: Any, robot: Robot) -> None:
    rng = np.random.default_rng(3)
    n = 200
    t = np.arange(n) / RATE
    q = 2e-4 * rng.standard_normal((n, 6))
    wrench = 0.5 * rng.standard_normal((n, 6)) * np.repeat([1.0, 0.1], 3)
    still = Block(t, q, {name: wrench for name in robot.sensors})
    assert find_still_window(still, robot, "none", DEFAULT) is not None
    swinging = q.copy()
    swinging[:, 2] += 0.05 * np.sin(2 * np.pi * t)
    assert find_still_window(replace(still, q=swinging), robot, "none", DEFAULT) is None
    pulled = wrench.copy()
    pulled[:, 0] += 5.0 * np.sin(2 * np.pi * t)
    moved = replace(still, wrenches={name: pulled for name in robot.sensors})
    assert find_still_window(moved, robot, "none", DEFAULT) is None


def test_cop_is_where_the_weight_is_and_does_not_depend_on_the_split(robot: Robot) -> None:
    """Two vertical forces: the CoP divides the distance of the feet, whatever their sense."""
    n = 50
    feet = [robot.sensors[foot.sensor] for foot in robot.feet.values() if foot.sensor]
    left, right = (s.name for s in feet)
    w = {name: np.zeros((n, 6)) for name in (left, right)}
    w[left][:, 2], w[right][:, 2] = 120.0, 60.0
    block = Block(np.arange(n) / RATE, np.zeros((n, 6)), w)
    (cop,) = centers_of_pressure(block, robot, "double", n)
    distance = 0.1  # of the soles of Table 1 from the middle, or so
    assert cop.force == pytest.approx(180.0)
    assert cop.xy[0, 0] == pytest.approx(0.0, abs=1e-12)
    assert cop.xy[0, 1] > 0.1 * distance  # to the left, where the weight is
    turned = replace(
        robot, sensors={k: replace(s, sense=Sense.ON_GROUND) for k, s in robot.sensors.items()}
    )
    negated = replace(block, wrenches={k: -v for k, v in w.items()})
    (same,) = centers_of_pressure(negated, turned, "double", n)
    np.testing.assert_allclose(same.xy, cop.xy)
    shifted = {name: v.copy() for name, v in w.items()}
    for name in shifted:  # the same resultant 30 mm further to the toes
        shifted[name][:, 4] = -0.03 * shifted[name][:, 2]
    (front,) = centers_of_pressure(replace(block, wrenches=shifted), robot, "double", n)
    np.testing.assert_allclose(front.xy[0], cop.xy[0] + [0.03, 0.0], atol=1e-12)


def test_a_plate_in_the_world_counts_when_feet_have_no_sensor(robot: Robot) -> None:
    feet = {name: replace(foot, sensor=None) for name, foot in robot.feet.items()}
    plates = {"amti": Plate("amti", "world", tuple(feet))}
    on_plate = replace(robot, sensors={}, feet=feet, plates=plates)
    n = 200
    w = np.zeros((n, 6))
    w[:, 2], w[:, 3], w[:, 4] = 200.0, 4.0, -10.0
    block = Block(np.arange(n) / RATE, np.zeros((n, 6)), {"amti": w})
    (cop,) = centers_of_pressure(block, on_plate, "double", n)
    np.testing.assert_allclose(cop.xy[0], [0.05, 0.02])
    assert find_still_window(block, on_plate, "double", DEFAULT) is not None


def test_samples_that_were_fetched_in_bursts_are_judged_by_their_mean_spacing(
    make_fake: Make, robot: Robot, plan: tuple[PlannedPose, ...]
) -> None:
    block = reading(make_fake(), plan[0], 3.0, np.zeros_like)
    k = np.arange(block.t.size)
    stamps = block.t[10 * (k // 10)] + 1e-6 * (k % 10)  # ten from the adapter at a time
    window = judge_stillness(replace(block, t=stamps), robot, "double", DEFAULT).window
    assert window is not None
    assert block.t[window][-1] - block.t[window][0] == pytest.approx(DEFAULT.window, abs=0.05)


def test_missing_samples_are_called_so(
    make_fake: Make, robot: Robot, plan: tuple[PlannedPose, ...]
) -> None:
    block = reading(make_fake(), plan[0], 3.0, np.zeros_like)
    for wrench in block.wrenches.values():
        wrench[::20] = np.nan
    stillness = judge_stillness(block, robot, "double", DEFAULT)
    assert stillness.reason == f"samples of {' + '.join(block.wrenches)} are missing"
