# SPDX-License-Identifier: Apache-2.0
"""Whatever goes wrong on a bus: no wrong pose, no lost pose, no silent loss, no endless wait.

The scenarios are those of tests/studies/bus_faults.py, a few of each kind; every one that runs here
has proven by the reader's own log that its fault has reached the reader.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

ON_FRAMES = ("drop", "duplicate", "reorder", "swap_halves", "dlc", "saturate", "status")
ON_CLOCKS = ("counter_wrap", "counter_jump", "clock_step")
OUTAGES = ("silence", "disconnect", "bus_off")
ELSEWHERE = [
    ("drop", "replay"),
    ("silence", "replay"),
    ("clock_step", "slcan"),
    ("disconnect", "slcan"),
    ("bus_off", "socketcand"),
    ("full_disk", "socketcand"),
]

Run = Callable[..., dict[str, Any]]


def assert_is_well(record: dict[str, Any]) -> None:
    bad = {name: record[name] for name in ("wrong", "lost", "uncounted", "hung")}
    assert not any(bad.values()), f"{record['faults']} of {record['variant']}: {record['details']}"


@pytest.mark.parametrize("kind", [*ON_FRAMES, *ON_CLOCKS, *OUTAGES, "full_disk"])
def test_a_fault_on_the_bus_neither_spoils_nor_loses_a_pose(scenario: Run, kind: str) -> None:
    assert_is_well(scenario(kind, "virtual"))


@pytest.mark.parametrize(("kind", "path"), ELSEWHERE)
def test_the_same_holds_on_other_paths(scenario: Run, kind: str, path: str) -> None:
    assert_is_well(scenario(kind, path))


@pytest.mark.slow
def test_a_recording_that_was_killed_goes_on_where_it_was(scenario: Run) -> None:
    assert_is_well(scenario("kill", "slcan"))


def untouched(watched: Any) -> None:
    """Change nothing."""


def one_sample_shifted(watched: Any) -> None:
    """Add a newton to every force, as a pairing of wrong halves might."""
    for blocks in watched.blocks.values():
        for block in blocks:
            block.wrenches["l_foot"][:, 0] += 1.0


def nobody_told(watched: Any) -> None:
    watched.status.clear()
    watched.notes.clear()


def a_row_gone(watched: Any) -> None:
    watched.rows[-1].pop()


@pytest.mark.parametrize(
    ("change", "found"),
    [
        (untouched, set()),
        (one_sample_shifted, {"wrong"}),
        (nobody_told, {"uncounted"}),
        (a_row_gone, {"lost"}),
    ],
)
def test_the_judge_sees_what_must_not_happen(judged: Run, change: Any, found: set[str]) -> None:
    judgement = judged(change)
    assert judgement.reached
    bad = {name for name in ("wrong", "lost", "uncounted", "hung") if getattr(judgement, name)}
    assert bad == found
