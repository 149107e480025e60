# SPDX-License-Identifier: Apache-2.0
"""Rows of a block: the newest of every device, nothing that is old, missing or from before."""

from __future__ import annotations

import numpy as np
import pytest

from comcal_drivers.source.assemble import Assembler, Pending, Slot
from comcal_drivers.source.clock import SampleClock
from comcal_drivers.source.series import Series

PERIOD = 0.01
DRIVE = (0, 1)


@pytest.fixture
def assembler() -> Assembler:
    slots = [Slot("foot", 6, 0.05), Slot("knee", 3, 0.05, joint=1, measures=DRIVE)]
    return Assembler(slots, "foot", SampleClock("foot", PERIOD, 1 << 16), joints=2)


def samples(rows: list[int], values: list[float], width: int) -> Series:
    row = np.array(rows, np.int64)
    filled = np.repeat(np.array(values, float)[:, None], width, axis=1)
    if width == 3:
        filled[:, 2] = np.nan  # this drive sends no torque
    return Series(row, PERIOD * row / 2.0, row // 2, filled)


def test_a_row_takes_the_newest_sample_that_was_known_before_it(assembler) -> None:
    foot, knee = samples([0, 2, 4], [1, 2, 3], 6), samples([1, 3], [10, 20], 3)
    block = assembler.feed({"foot": foot, "knee": knee}, {})
    np.testing.assert_array_equal(block.q[:, 1], [np.nan, 10.0, 20.0])
    np.testing.assert_array_equal(block.currents[:, 1], [np.nan, 10.0, 20.0])
    assert np.isnan(block.q[:, 0]).all()
    assert block.torques is None


def test_a_row_that_lacks_a_device_carries_no_wrench(assembler) -> None:
    foot, knee = samples([0, 2], [1, 2], 6), samples([1], [10], 3)
    block = assembler.feed({"foot": foot, "knee": knee}, {})
    assert np.isnan(block.wrenches["foot"][0]).all()
    np.testing.assert_array_equal(block.wrenches["foot"][1], np.full(6, 2.0))
    assert assembler.gaps["knee"] == 1


def test_a_silent_device_spoils_the_rows_after_its_time_out(assembler) -> None:
    rows = list(range(2, 42, 2))
    block = assembler.feed({"foot": samples(rows, rows, 6), "knee": samples([1], [5], 3)}, {})
    age = PERIOD * (np.array(rows) - 1) / 2.0
    np.testing.assert_array_equal(np.isfinite(block.wrenches["foot"][:, 2]), age <= 0.05)


def test_an_unusable_sample_spoils_its_rows(assembler) -> None:
    foot, knee = samples([2, 4, 6], [1, np.nan, 3], 6), samples([1], [7], 3)
    block = assembler.feed({"foot": foot, "knee": knee}, {})
    np.testing.assert_array_equal(np.isfinite(block.wrenches["foot"][:, 0]), [True, False, True])


def test_rows_wait_for_what_a_device_holds_back(assembler) -> None:
    foot = samples([0, 2, 4], [1, 2, 3], 6)
    first = assembler.feed({"foot": foot}, {"knee": Pending(1, PERIOD / 2)})
    assert first.t.size == 1
    then = assembler.feed({"knee": samples([1], [10], 3)}, {})
    np.testing.assert_array_equal(then.q[:, 1], [10.0, 10.0])


def test_rows_do_not_wait_for_a_device_that_has_died(assembler) -> None:
    foot = samples([0, 2, 40], [1, 2, 3], 6)
    block = assembler.feed({"foot": foot}, {"knee": Pending(41, 0.0)})
    assert block.t.size == 3
    late = assembler.feed({"foot": samples([60], [4], 6)}, {"knee": Pending(1, PERIOD / 2)})
    assert late.t.size == 1


def test_nothing_from_before_is_part_of_what_begins(assembler) -> None:
    assembler.feed({"foot": samples([0, 2], [1, 2], 6), "knee": samples([1], [10], 3)}, {})
    assembler.begin_after(3)
    foot, knee = samples([2, 4, 6, 8], [2, 3, 4, 5], 6), samples([3, 5], [20, 30], 3)
    block = assembler.feed({"foot": foot, "knee": knee}, {})
    # The foot's sample 4 comes before the knee has spoken: rows begin with 6.
    np.testing.assert_array_equal(block.wrenches["foot"][:, 0], [4.0, 5.0])
    np.testing.assert_array_equal(block.q[:, 1], [30.0, 30.0])


def test_a_device_that_says_nothing_after_a_beginning_is_missed(assembler) -> None:
    """Between two poses nobody uses the rows, and still it is told that a device was silent."""
    assembler.begin_after(3)
    rows = list(range(4, 44, 2))
    block = assembler.feed({"foot": samples(rows, rows, 6)}, {})
    assert block.t.size == 0
    ages = PERIOD * (np.array(rows) - rows[0]) / 2.0
    assert assembler.gaps["knee"] == np.count_nonzero(ages > 0.05) == 14
    assert assembler.gaps["foot"] == 0
