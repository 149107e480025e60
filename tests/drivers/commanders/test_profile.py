# SPDX-License-Identifier: Apache-2.0
"""Numbers of a motion, and the state machine as a table."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from comcal.errors import ConfigError
from comcal_drivers.commanders.profile import (
    JointUnits,
    equal_duration,
    motion_time,
    speed_unit_at_joint,
)
from comcal_drivers.commanders.state_machine import State, state_of, towards_enabled

finite = st.floats(-3.0, 3.0)


@given(st.lists(finite, min_size=1, max_size=8), st.floats(0.01, 1.0), st.floats(0.01, 2.0))
def test_all_joints_arrive_together_and_none_is_faster_than_allowed(
    distance: list[float], speed: float, acceleration: float
):
    way = np.array(distance)
    speeds, accelerations = equal_duration(way, speed, acceleration)
    assert np.all(speeds <= speed)
    assert np.all(accelerations <= acceleration)
    moving = np.abs(way) > 1e-6
    times = [
        motion_time(abs(w), v, a)
        for w, v, a in zip(way[moving], speeds[moving], accelerations[moving], strict=True)
    ]
    if times:
        assert max(times) == pytest.approx(min(times), rel=1e-6)
        assert max(times) == pytest.approx(motion_time(np.abs(way).max(), speed, acceleration))


@given(
    st.floats(-2.0, 2.0), st.floats(10.0, 1e6), st.floats(1.0, 200.0), st.sampled_from([1, -1]),
    finite,
)  # fmt: skip
def test_counts_are_the_nearest_within_the_limits(
    position: float, per_turn: float, gear: float, sign: int, zero: float
):
    units = JointUnits("knee", per_turn, gear, sign, zero, 1.0)
    count = 1.0 / abs(units.counts_per_radian)
    free = units.position(units.counts(position, -math.inf, math.inf))
    assert abs(free - position) <= 0.5 * count * (1.0 + 1e-6)
    held = units.position(units.counts(position, position, math.inf))
    assert position - 1e-9 <= held <= position + count * (1.0 + 1e-6)
    held = units.position(units.counts(position, -math.inf, position))
    assert position - count * (1.0 + 1e-6) <= held <= position + 1e-9


def test_a_turn_of_the_joint_is_gear_times_the_counts_of_the_motor():
    units = JointUnits("knee", 2048.0, 100.0, -1, 0.5, 1.0)
    assert units.counts(0.5 + 2.0 * math.pi, -10.0, 10.0) == -204800
    assert units.position(-102400) == pytest.approx(0.5 + math.pi)


def test_a_position_beyond_32_bits_is_refused():
    with pytest.raises(ConfigError, match="knee"):
        JointUnits("knee", 1e9, 100.0, 1, 0.0, 1.0).counts(1.0, -3.0, 3.0)


def test_velocity_units_by_hand():
    # 60 rpm of the motor are one turn per second; behind a gear of 100, 2 pi / 100 rad/s.
    assert 60.0 * speed_unit_at_joint("rpm", 0, 2048.0, 100.0) == pytest.approx(math.tau / 100.0)
    assert 2048 * speed_unit_at_joint("counts/s", 0, 2048.0, 100.0) == pytest.approx(
        math.tau / 100.0
    )
    assert speed_unit_at_joint("rpm", -3, 1.0, 1.0) == pytest.approx(math.tau / 60e3)


@given(st.floats(1e-4, 10.0), st.floats(1e-4, 1.0))
def test_speeds_are_rounded_down_but_never_to_zero(speed: float, unit: float):
    units = JointUnits("knee", 1.0, 1.0, 1, 0.0, unit)
    told = units.speed(speed)
    assert told >= 1
    assert told * unit <= max(speed, unit) * (1.0 + 1e-6)


@pytest.mark.parametrize(
    ("word", "state"),
    [
        # Status words as the EPOS2 and the CiA 402 manuals print them, with other bits set.
        (0x0000, State.NOT_READY),
        (0x0140, State.SWITCH_ON_DISABLED),
        (0x0121, State.READY),
        (0x0123, State.SWITCHED_ON),
        (0x0137, State.OPERATION_ENABLED),
        (0x1637, State.OPERATION_ENABLED),
        (0x0117, State.QUICK_STOP),
        (0x010F, State.FAULT_REACTION),
        (0x0108, State.FAULT),
        (0x0022, State.UNKNOWN),
    ],
)
def test_status_words_mean_what_the_manuals_say(word: int, state: State):
    assert state_of(word) is state


def test_the_way_to_enabled_never_passes_a_fault():
    assert towards_enabled(State.FAULT) is None
    assert towards_enabled(State.FAULT_REACTION) is None
    steps = [State.SWITCH_ON_DISABLED, State.READY, State.SWITCHED_ON]
    assert [towards_enabled(s) for s in steps] == [0x06, 0x07, 0x0F]
