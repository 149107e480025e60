# SPDX-License-Identifier: Apache-2.0
"""Logs replayed by joint positions: which samples become which pose, and what is said otherwise."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import astuple
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from comcal.errors import DataError, NotReachedError
from comcal.measure.plan import PlannedPose
from comcal.measure.pose_row import cut
from comcal.measure.source import Block
from comcal_drivers.replay.assign import assign_any_order, assign_in_order
from comcal_drivers.replay.reading import BlockReader
from comcal_drivers.replay.seek import Order, PoseSeeker, SeekOptions
from comcal_drivers.replay.visits import Visit, find_visits

RATE = 100.0
JOINTS = ("hip", "knee")
PLACES = {"A": (0.0, 0.0), "B": (0.5, -0.2), "C": (-0.3, 0.8), "D": (1.0, 1.0)}


class ListLog:
    """A log in memory, cut into blocks of some length; ``started`` counts how often it was read."""

    name = "walk.log"

    def __init__(self, t: np.ndarray, q: np.ndarray, length: int = 37) -> None:
        self.t, self.q, self.length = t, q, length
        self.started = 0

    def blocks(self, start: float) -> Iterator[Block]:
        self.started += 1
        first = max(int(np.searchsorted(self.t, start)) - 5, 0)  # somewhat before, as allowed
        for i in range(first, self.t.size, self.length):
            piece = slice(i, i + self.length)
            force = np.zeros((self.t[piece].size, 6))
            force[:, 2] = self.t[piece]
            yield Block(self.t[piece], self.q[piece], {"foot": force})


def walk(stays: Sequence[tuple[str, float]], transit: float = 0.4, length: int = 37) -> ListLog:
    """A robot that stands at places for some seconds each, moving in a straight line between."""
    q = []
    for k, (place, seconds) in enumerate(stays):
        here = np.array(PLACES[place])
        if k > 0:
            before = np.array(PLACES[stays[k - 1][0]])
            steps = np.linspace(0.0, 1.0, round(transit * RATE), endpoint=False)[1:]
            q += [before + s * (here - before) for s in steps]
        q += [here] * round(seconds * RATE)
    return ListLog(np.arange(len(q)) / RATE, np.array(q), length)


def poses(places: str) -> tuple[PlannedPose, ...]:
    return tuple(PlannedPose(10 + i, np.array(PLACES[p])) for i, p in enumerate(places))


def seeker(log: ListLog, plan: str, **options: object) -> PoseSeeker:
    return PoseSeeker(log, JOINTS, poses(plan), SeekOptions(**options))


def test_poses_are_read_where_the_robot_stood_in_them() -> None:
    log = walk([("A", 2.0), ("B", 2.0), ("A", 2.0), ("C", 2.0)])
    replay = seeker(log, "ABAC")
    starts = []
    for pose in poses("ABAC"):
        replay.move_to(pose)
        block = replay.read(1.0)
        assert block.t.size == 100
        assert np.abs(block.q - pose.q).max() <= 0.05
        np.testing.assert_array_equal(block.wrenches["foot"][:, 2], block.t)
        starts.append(block.t[0])
    assert starts == sorted(starts)
    assert log.started == 2  # once for the places, once for the samples


def test_pieces_follow_one_another_without_gap_or_overlap() -> None:
    log = walk([("A", 3.0), ("B", 3.0)])
    replay = seeker(log, "AB")
    replay.move_to(poses("AB")[1])
    pieces = [replay.read(seconds) for seconds in (1.0, 0.2, 0.2, 0.05)]
    assert [p.t.size for p in pieces] == [100, 20, 20, 5]
    t = np.concatenate([p.t for p in pieces])
    np.testing.assert_allclose(np.diff(t), 1 / RATE)


def test_reading_stops_where_the_robot_leaves_the_pose() -> None:
    replay = seeker(walk([("A", 1.0), ("B", 2.0)]), "AB")
    replay.move_to(poses("AB")[0])
    read = [replay.read(0.4) for _ in range(3)]
    assert np.concatenate([np.abs(b.q - PLACES["A"]) for b in read]).max() <= 0.05
    with pytest.raises(NotReachedError, match=r"has left the pose.*stood there for 1\.0"):
        replay.read(0.4)


def test_sent_to_a_pose_again_it_goes_on_and_then_takes_the_next_visit() -> None:
    replay = seeker(walk([("A", 3.0), ("B", 1.0), ("A", 2.0), ("C", 1.0)]), "AC")
    pose = poses("AC")[0]
    replay.move_to(pose)
    first = replay.read(2.0)
    replay.move_to(pose)
    second = replay.read(0.4)
    assert second.t[0] == pytest.approx(first.t[-1] + 1 / RATE)
    replay.read(0.4)
    replay.move_to(pose)  # too little is left of this visit
    third = replay.read(1.0)
    assert third.t[0] > 4.0
    replay.read(0.8)
    with pytest.raises(NotReachedError, match="no further visit"):
        replay.move_to(pose)


def test_a_pose_that_never_comes_costs_no_other_and_says_how_near_it_came() -> None:
    log = walk([("A", 1.0), ("C", 1.0), ("B", 1.0)])
    plan = poses("ADCB")
    replay = PoseSeeker(log, JOINTS, plan)
    replay.move_to(plan[0])
    with pytest.raises(NotReachedError) as caught:
        replay.move_to(plan[1])
    message = str(caught.value)
    assert "walk.log: pose 11" in message
    assert "nearest at t = 2.6" in message  # between C and B
    assert "joint hip is 0.82" in message
    assert "limit 0.05" in message
    for pose in plan[2:]:
        replay.move_to(pose)
        assert np.abs(replay.read(0.5).q - pose.q).max() <= 0.05


def test_a_pose_out_of_order_is_left_out_unless_any_order_is_allowed() -> None:
    stays = [("B", 1.0), ("C", 1.0), ("D", 1.0), ("A", 1.0)]
    replay = seeker(walk(stays), "ABCD")
    with pytest.raises(NotReachedError, match="order: any"):
        replay.move_to(poses("ABCD")[0])
    for pose in poses("ABCD")[1:]:
        replay.move_to(pose)
    anyhow = seeker(walk(stays), "ABCD", order=Order.ANY)
    for pose in poses("ABCD"):
        anyhow.move_to(pose)
        np.testing.assert_allclose(anyhow.read(0.5).q.mean(axis=0), pose.q, atol=0.05)


def test_passing_through_is_no_visit() -> None:
    log = walk([("A", 1.0), ("B", 1.0)])
    middle = PlannedPose(7, np.array([0.25, -0.1]))  # half way
    replay = PoseSeeker(log, JOINTS, (middle,))
    with pytest.raises(NotReachedError, match=r"only passes through.*t = 1\..*at least 0\.5 s"):
        replay.move_to(middle)


def test_poses_nearer_to_one_another_than_arrival_are_told_apart() -> None:
    q = np.concatenate([np.full((200, 1), 0.0), np.full((200, 1), 0.03), np.full((200, 1), 0.0)])
    log = ListLog(np.arange(len(q)) / RATE, np.hstack([q, 0 * q]))
    plan = tuple(PlannedPose(i, np.array([x, 0.0])) for i, x in enumerate([0.0, 0.03, 0.0]))
    replay = PoseSeeker(log, JOINTS, plan)
    found = []
    for pose in plan:
        replay.move_to(pose)
        block = replay.read(1.0)
        np.testing.assert_array_equal(block.q, np.tile(pose.q, (100, 1)))
        found.append(block.t[0])
    assert found == [0.0, 2.0, 4.0]


def test_a_resumed_replay_takes_the_same_samples() -> None:
    stays = [(p, 1.0) for p in "ABABCABD"]
    plan = poses("ABABCABD")
    whole = PoseSeeker(walk(stays), JOINTS, plan)
    times = {}
    for pose in plan:
        whole.move_to(pose)
        times[pose.pose] = whole.read(0.5).t
    for first in range(1, len(plan)):
        later = PoseSeeker(walk(stays), JOINTS, plan)
        for pose in plan[first - 1 :]:
            later.move_to(pose)
            np.testing.assert_array_equal(later.read(0.5).t, times[pose.pose])


def test_a_redone_pose_has_a_new_number_and_the_old_place() -> None:
    plan = poses("ABC")
    replay = PoseSeeker(walk([(p, 1.0) for p in "ABCB"]), JOINTS, plan)
    replay.move_to(plan[0])
    replay.read(0.5)
    replay.move_to(PlannedPose(99, plan[1].q))
    assert 1.0 < replay.read(0.5).t[0] < 2.0
    unknown = PoseSeeker(walk([(p, 1.0) for p in "ABCB"]), JOINTS, ())
    for place, expected in (("B", 1.4), ("C", 2.8), ("B", 4.2)):
        unknown.move_to(PlannedPose(len(place) + round(10 * expected), np.array(PLACES[place])))
        assert unknown.read(0.5).t[0] == pytest.approx(expected, abs=0.1)


def test_without_a_pose_the_log_is_read_from_its_beginning_to_its_end() -> None:
    log = walk([("A", 1.0)])
    gap = np.where(np.arange(log.t.size) < 50, log.t, log.t + 30.0)
    replay = PoseSeeker(ListLog(gap, log.q), JOINTS, ())
    sizes = [replay.read(0.25).t.size for _ in range(4)]
    assert sizes == [25, 25, 25, 25]
    with pytest.raises(DataError, match="log has ended"):
        replay.read(0.25)
    with pytest.raises(DataError, match="no samples"):
        PoseSeeker(ListLog(np.empty(0), np.empty((0, 2))), JOINTS, ()).read(1.0)


def test_samples_without_positions_are_named_as_the_reason() -> None:
    log = walk([("A", 1.0)])
    log.q[:, 1] = np.nan
    with pytest.raises(NotReachedError, match="no sample of the log has all joint positions"):
        seeker(log, "A").move_to(poses("A")[0])


@settings(max_examples=30)
@given(st.data())
def test_visits_do_not_depend_on_how_the_log_is_cut(data: st.DataObject) -> None:
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32)))
    n = data.draw(st.integers(1, 200))
    t = np.cumsum(rng.choice([0.01, 0.2, 0.7], n))
    q = np.array([0.0, 0.0]) + rng.choice([0.0, 0.04, 0.1], (n, 2))
    q[rng.random(n) < 0.1] = np.nan
    places = np.array([[0.0, 0.0], [0.04, 0.0], [0.1, 0.1]])
    block = Block(t, q, {})
    cuts = sorted(data.draw(st.lists(st.integers(0, n), max_size=6)))
    parts = [cut(block, slice(a, b)) for a, b in zip([0, *cuts], [*cuts, n], strict=True)]
    found, whole = find_visits(parts, places, 0.05), find_visits([block], places, 0.05)
    np.testing.assert_equal(astuple(found), astuple(whole))  # here NaN equals NaN


def matches(plan: Sequence[int], seen: Sequence[int]) -> int:
    """The most poses that can be found in order, by trying everything."""
    for n in range(len(plan), 0, -1):
        for chosen in combinations(range(len(plan)), n):
            rest = iter(seen)
            if all(any(place == plan[i] for place in rest) for i in chosen):
                return n
    return 0


@settings(max_examples=60)
@given(st.lists(st.integers(0, 3), max_size=7), st.lists(st.integers(0, 3), max_size=7))
def test_as_many_poses_as_possible_are_found_in_order(plan: list[int], seen: list[int]) -> None:
    visits = [[Visit(i, i + 0.5) for i, p in enumerate(seen) if p == place] for place in range(4)]
    found = assign_in_order(plan, visits)
    first = [tried[0].start for tried in found if tried]
    assert len(first) == matches(plan, seen)
    assert first == sorted(set(first))
    for place, tried in zip(plan, found, strict=True):
        assert all(visit in visits[place] for visit in tried)
    everything = [visit for tried in found for visit in tried]
    assert len(everything) == len(set(everything))  # no visit serves two poses


def test_in_any_order_visits_of_one_place_are_taken_in_turn() -> None:
    a, b, c, other = (Visit(i, i + 0.5) for i in (5.0, 1.0, 7.0, 3.0))
    assert assign_any_order([0, 1, 0], [[b, a, c], [other]]) == ((b, c), (other,), (a, c))
    assert assign_any_order([0, 0], [[b]]) == ((b,), ())


@settings(max_examples=40)
@given(st.data())
def test_reading_does_not_depend_on_how_the_log_is_cut(data: st.DataObject) -> None:
    n = data.draw(st.integers(1, 120))
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32)))
    t = np.cumsum(rng.choice([0.01, 0.02, 1.5], n))
    whole, pieces = (ListLog(t, np.zeros((n, 2)), length) for length in (n, 7))
    a, b = BlockReader(whole.blocks), BlockReader(pieces.blocks)
    for _ in range(6):
        if data.draw(st.booleans()):
            to = data.draw(st.floats(0.0, float(t[-1])))
            a.go_to(to)
            b.go_to(to)
        duration, last = data.draw(st.floats(0.01, 2.0)), data.draw(st.floats(0.0, 200.0))
        read = [reader.read(duration, last) for reader in (a, b)]
        assert (read[0] is None) == (read[1] is None)
        if read[0] is not None and read[1] is not None:
            np.testing.assert_array_equal(read[0].t, read[1].t)
            assert read[0].t[-1] <= last
            assert read[0].t[-1] - read[0].t[0] <= duration
