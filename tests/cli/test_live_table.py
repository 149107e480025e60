# SPDX-License-Identifier: Apache-2.0
"""What is shown of an observation, as text."""

from __future__ import annotations

import io
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from comcal.cli.live_table import Screen, live_table, picture, status_line
from comcal.cli.record_progress import LINE_EVERY, shown_progress
from comcal.measure.observe import Footprint, JointWay, Observation
from comcal.measure.plan import PlannedPose
from comcal.measure.progress import (
    PoseFinished,
    PoseObserved,
    PoseSkipped,
    PoseStarted,
    RecordingStarted,
    SidesMissing,
)
from comcal.measure.source import SourceStatus
from comcal.measure.still import Motion

SOLE = np.array([[0.12, 0.05], [-0.08, 0.05], [-0.08, -0.05], [0.12, -0.05]])
LEFT = np.array([0.0, 0.1])
SEEN = Observation(
    pose=PlannedPose(12, np.zeros(2)),
    is_via=False,
    waited=7.4,
    joints=(JointWay("l_knee", 0.5, 0.3), JointWay("lift", 0.1, 0.098, is_angle=False)),
    arrival=0.05,
    motions=(Motion("CoP x of l_foot + r_foot", "mm", 1.7, 1.0, 0.4, 1.0),),
    reason="joint l_knee is not where the plan wants it",
    force=604.6,
    weight=622.0,
    footprint=Footprint(np.array([0.02, 0.0]), (SOLE + LEFT, SOLE - LEFT), margin=0.08),
    temperatures={"l_foot": (31.24, 0.4)},
    status=SourceStatus({"l_foot": 1000.0}, {"l_foot": 3, "r_foot": 0}, ("can0: silent for 2 s",)),
)
SCREEN = Screen(SEEN, number=5, total=41, age=0.2, keys="s skip")


def text_of(screen: Screen, width: int = 100) -> str:
    out = io.StringIO()
    Console(file=out, width=width, highlight=False).print(live_table(screen))
    return out.getvalue()


def test_the_screen_says_everything_that_matters() -> None:
    shown = text_of(SCREEN)
    for words in (
        "pose 12 (5 of 41), on both feet, since 7 s",
        "17.2°",
        "28.6°",
        "+11.5° ↑",
        "98.0 mm",
        "+2.0 mm",
        "CoP x",
        "1.70",
        "604.6 N of 622.0 N (-2.8 %)",
        "80 mm inside",
        "l_foot 31.2 °C (+0.4)",
        "l_foot 1000/s",
        "l_foot 3",
        "can0: silent for 2 s",
        "0.2 s old",
        "joint l_knee is not where",
        "s skip",
    ):
        assert words in shown, words
    assert "r_foot 0" not in shown
    lines = [line.rstrip() for line in shown.splitlines()]
    assert max(map(len, lines)) <= 80
    many = tuple(JointWay(f"joint_{i}", 0.5, 0.3) for i in range(30))
    shown = text_of(replace(SCREEN, observation=replace(SEEN, joints=many)), width=80)
    assert len(shown.splitlines()) < 24
    assert "and 24 nearer" in shown


def test_what_is_not_known_is_not_shown() -> None:
    bare = Observation(
        SEEN.pose, False, 1.0, SEEN.joints, 0.05, motions=(), reason="too few samples"
    )
    shown = text_of(Screen(bare, 1, 1))
    for words in ("load", "warmth", "rates", "losses", "CoP", "nan"):
        assert words not in shown, words
    assert "not read for long enough" in shown


def test_a_place_beyond_the_pose_is_announced() -> None:
    shown = text_of(replace(SCREEN, observation=replace(SEEN, is_via=True)))
    assert "first beyond it" in shown


def test_a_narrow_terminal_loses_nothing_important() -> None:
    shown = text_of(SCREEN, width=60)
    assert "pose 12 (5 of 41)" in shown
    assert "l_foot 3" in shown
    assert "80 mm inside the soles" in shown
    assert "…" not in shown
    assert max(len(line.rstrip()) for line in shown.splitlines()) <= 60
    assert len(shown.splitlines()) < 24


@pytest.mark.parametrize(
    ("cop", "row", "column"),
    [([0.12, 0.15], 0, 2), ([-0.08, -0.15], -1, 26), ([0.02, 0.0], 4, 14), ([9.0, 0.0], 0, None)],
)
def test_the_cross_is_where_the_ground_pushes(
    cop: list[float], row: int, column: int | None
) -> None:
    assert SEEN.footprint is not None
    lines = picture(replace(SEEN.footprint, cop=np.array(cop))).plain.splitlines()[:-1]
    assert "+" in lines[row]
    assert sum(line.count("+") for line in lines) == 1
    if column is not None:
        assert abs(lines[row].index("+") - column) <= 1


def test_the_soles_are_drawn_left_and_right_toes_up() -> None:
    assert SEEN.footprint is not None
    left_only = replace(SEEN.footprint, soles=SEEN.footprint.soles[:1], cop=np.array([0.0, -0.3]))
    lines = picture(left_only).plain.splitlines()
    middle = lines[len(lines) // 2]
    assert "·" in middle[:14]
    assert "·" not in middle[15:]
    outside = picture(replace(SEEN.footprint, margin=-0.02)).plain
    assert "20 mm outside" in outside


def test_one_line_tells_the_same_in_short() -> None:
    line = status_line(SCREEN)
    assert line.startswith("pose 12 (5 of 41), 7 s; l_knee +11.5° to go; CoP x")
    for words in ("load 605 of 622 N", "l_foot 3", "waiting: joint l_knee"):
        assert words in line
    assert "\n" not in line


def test_lines_come_every_few_seconds_and_once_for_every_pose() -> None:
    out = io.StringIO()
    now = [0.0]
    with shown_progress(out, clock=lambda: now[0]) as show:
        show(RecordingStarted(4, 1))
        show(PoseStarted(12))
        for _ in range(60):
            now[0] += LINE_EVERY / 25.0
            show(PoseObserved(SEEN))
        show(PoseFinished(12, 3.0, 40))
        show(PoseSkipped(13, "left out by the operator", by_operator=True))
        show(SidesMissing({14: ("knee",), 15: ("hip",)}))
    lines = out.getvalue().splitlines()
    assert [line.split(",")[0] for line in lines[:3]] == ["pose 12 (2 of 4)"] * 3
    assert lines[3:5] == [
        "pose 12: still after 3.0 s, 40 samples",
        "pose 13: left out by the operator",
    ]
    assert "knee in pose 14, and of one more" in lines[5]


def test_a_simulation_says_nothing_where_nobody_looks() -> None:
    out = io.StringIO()
    with shown_progress(out) as show:
        show(RecordingStarted(2, 0))
        show(PoseStarted(1))
        show(PoseFinished(1, 1.0, 25))
    assert out.getvalue() == ""
