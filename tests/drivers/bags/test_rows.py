# SPDX-License-Identifier: Apache-2.0
"""What a row holds: the newest value of every channel before the clock's sample, by its stamp."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from comcal.errors import DataError
from comcal.measure.pose_row import join
from comcal.measure.source import Block
from comcal.robot.model import Robot
from comcal_drivers.bags.channels import Channels
from comcal_drivers.bags.configuration import BagSection
from comcal_drivers.bags.log import BagLog
from comcal_drivers.bags.messages import Message, Shape
from comcal_drivers.bags.rows import RowMaker
from comcal_drivers.bags.stream import LATENESS, Counts, Stream
from comcal_drivers.bags.survey import Survey

SECOND = 1_000_000_000
MS = 1_000_000
HEADER = Survey(header=True, notes=(), origin=0, delay=0, has_effort=False)
CHANNELS = Channels(
    joints=("/joints",),
    currents=(),
    wrenches={"l_foot": "/l", "r_foot": "/r"},
    imu=None,
    temperatures={},
    clock="l_foot",
)


SHAPES: dict[tuple[object, ...], Shape] = {}


def message(topic: str, stamp: int, logged: int, names: Sequence[str], values: Any) -> Message:
    """A message as the decoder makes it: one shape for all that differ in numbers only."""
    numbers = np.asarray(values, dtype="<f8")
    key = topic, tuple(names), numbers.size
    counts = (numbers.size, 0) if names else (numbers.size,)
    shape = SHAPES.setdefault(key, Shape("", "", tuple(names), counts))
    return Message(topic, logged, stamp, shape, numbers.tobytes())


def wrench(topic: str, stamp: int, logged: int, value: float) -> Message:
    return message(topic, stamp, logged, (), [value] * 6)


def joints(names: Sequence[str], stamp: int, logged: int, value: float) -> Message:
    return message("/joints", stamp, logged, names, [value] * len(names))


def made(
    robot: Robot, messages: Sequence[Message], looks: Sequence[int] = (), timeout: float = 0.1
) -> tuple[Block | None, Counts]:
    """Make rows of messages, asking for what is complete after each of some of them."""
    counts = Counts()
    section = BagSection(timeout=timeout)
    maker = RowMaker(robot, CHANNELS, section, "ignore", HEADER, counts)
    blocks = []
    for k, one in enumerate(messages):
        if k in looks:
            blocks.append(maker.blocks(one.log_ns))
        maker.add(one)
    blocks = [b for b in [*blocks, maker.blocks(None)] if b is not None]
    return (join(blocks) if blocks else None), counts


@settings(max_examples=50)
@given(st.data())
def test_rows_hold_what_a_slow_search_finds_however_often_one_looks(
    recording: Any, data: st.DataObject
) -> None:
    robot = recording.robot
    names = robot.tree.joint_names
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32)))
    n = data.draw(st.integers(1, 80))
    topics = rng.choice(["/l", "/r", "/joints"], n)
    logged = np.cumsum(rng.choice([0, 3, 20, 400, 900], n)) * MS + SECOND
    # Messages are measured before they are written, some long before, some twice at one time.
    stamps = logged - rng.choice([0, 1, 5, 90, 700], n) * MS
    messages = [
        joints(names, s, w, i) if topic == "/joints" else wrench(topic, s, w, i)
        for i, (topic, s, w) in enumerate(
            zip(topics, stamps.tolist(), logged.tolist(), strict=True)
        )
    ]
    looks = data.draw(st.lists(st.integers(0, n), max_size=10))
    block, counts = made(robot, messages, looks)

    kept: dict[str, list[tuple[int, int, int]]] = {"/l": [], "/r": [], "/joints": []}
    dropped = 0
    for i, topic in enumerate(topics):
        before = [s for s, _, _ in kept[topic]]
        if before and stamps[i] <= max(before):
            dropped += 1
        else:
            kept[topic].append((int(stamps[i]), int(logged[i]), i))
    lost = counts.lost()
    assert sum(v for k, v in lost.items() if not k.endswith("stale")) == dropped
    if not kept["/l"]:
        assert block is None
        return
    assert block is not None
    np.testing.assert_array_equal(block.t, np.array([s for s, _, _ in kept["/l"]]) / SECOND)
    for row, (stamp, written, i) in enumerate(kept["/l"]):
        assert (block.wrenches["l_foot"][row] == i).all()
        for topic, values in (("/r", block.wrenches["r_foot"]), ("/joints", block.q)):
            known = [m for m in kept[topic] if m[0] <= stamp and m[1] <= written + LATENESS]
            newest = max(known, default=None)
            if newest is None or stamp - newest[0] > 100 * MS:
                assert np.isnan(values[row]).all()
            else:
                assert (values[row] == newest[2]).all()


def test_joints_come_by_name_from_several_senders(recording: Any) -> None:
    robot = recording.robot
    names = list(robot.tree.joint_names)
    legs, others = names[:5], names[5:][::-1]
    messages = []
    for k in range(20):
        t = SECOND + 10 * k * MS
        messages += [
            joints([*others, "left_thumb"], t - 4 * MS, t, 100 + k),
            joints(["right_thumb"], t - 3 * MS, t, -1.0),
            joints(legs, t - 2 * MS, t, k),
            wrench("/l", t, t, k),
            wrench("/r", t, t, k),
        ]
    block, counts = made(robot, messages)
    assert block is not None
    k = np.arange(20.0)
    np.testing.assert_array_equal(block.q[:, :5], np.tile(k[:, None], 5))
    np.testing.assert_array_equal(block.q[:, 5:], np.tile(100 + k[:, None], len(others)))
    assert counts.lost() == {}


def test_a_sender_that_falls_silent_is_stale_after_the_timeout(recording: Any) -> None:
    robot = recording.robot
    names = robot.tree.joint_names
    messages = [joints(names, SECOND, SECOND, 1.0)]
    messages += [wrench("/l", SECOND + 10 * k * MS, SECOND + 10 * k * MS, k) for k in range(20)]
    block, counts = made(robot, messages)
    assert block is not None
    np.testing.assert_array_equal(np.isfinite(block.q).all(axis=1), np.arange(20) <= 10)
    assert counts.lost() == {"joints stale": 9, "r_foot stale": 20}


def test_messages_of_unequal_lengths_are_counted_and_not_used(recording: Any) -> None:
    robot = recording.robot
    names = robot.tree.joint_names
    bad = message("/joints", SECOND, SECOND, names, [1.0] * (len(names) - 1))
    block, counts = made(robot, [bad, wrench("/l", SECOND, SECOND, 1.0)])
    assert block is not None
    assert np.isnan(block.q).all()
    assert counts.lost()["joints malformed"] == 1


def test_a_clock_that_is_set_back_is_refused_with_the_way_out() -> None:
    stream = Stream("l_foot", 1, Counts())
    stream.add(5 * SECOND, 0, bytes(8))
    stream.add(5 * SECOND - 10, 1, bytes(8))
    with pytest.raises(DataError, match=r"l_foot: stamps go back.*2\.000 s.*stamps: log"):
        stream.add(3 * SECOND, 2, bytes(8))


def log_of(bag: Any, recording: Any, **options: Any) -> BagLog:
    return BagLog(bag.file, recording.robot, BagSection.model_validate(options))


def whole(log: BagLog) -> Block:
    return join(list(log.blocks(-np.inf)))


def feet(bag: Any, stamp: int, value: float = 1.0, **when: int) -> None:
    for sensor in ("l_foot", "r_foot"):
        bag.wrench(f"/ft/{sensor}", stamp, [value] * 6, **when)


def test_reading_from_the_middle_gives_the_same_samples(
    kind: str, recording: Any, new_bag: Callable[..., Any]
) -> None:
    names = recording.robot.tree.joint_names
    epoch = 1_700_000_000 * SECOND
    with new_bag(kind) as bag:
        for k in range(2500):
            t = epoch + k * 40 * MS
            feet(bag, t, k, logged=t + 40 * MS)
            if k % 3 == 0:
                bag.joints("/joint_states", t + MS, names, [k] * len(names), logged=t + 41 * MS)
            if k % 1000 == 0:
                bag.temperature("/temperature/l_foot", t, k, logged=t + 40 * MS)
    log = log_of(bag, recording)
    everything = whole(log)
    assert everything.t.size == 2500
    assert np.isnan(everything.q[0]).all()
    later = join(list(log.blocks(90.0)))
    assert 20.0 < later.t[0] <= 90.0
    a, b = (block.t >= 90.0 for block in (everything, later))
    np.testing.assert_array_equal(everything.t[a], later.t[b])
    np.testing.assert_array_equal(everything.q[a], later.q[b])
    assert everything.temperatures is not None
    assert later.temperatures is not None
    temperatures = [x.temperatures["l_foot"][y] for x, y in ((everything, a), (later, b))]
    np.testing.assert_array_equal(*temperatures)
    assert temperatures[0][0] == 2000.0


def test_header_stamps_count_where_they_share_a_clock(
    recording: Any, new_bag: Callable[..., Any]
) -> None:
    names = recording.robot.tree.joint_names
    zeros = [0.0] * len(names)

    def bag_with(name: str, joint_stamp: Callable[[int], int]) -> Any:
        with new_bag("mcap", name) as bag:
            for k in range(100):
                logged = 500 * SECOND + 10 * k * MS
                feet(bag, logged - 30 * MS, logged=logged)
                bag.joints("/joint_states", joint_stamp(logged), names, zeros, logged=logged)
        return bag

    one = log_of(bag_with("one", lambda logged: logged - 20 * MS), recording)
    assert one.engine.endswith("header stamps, clock l_foot")
    assert whole(one).t[0] == 499.97
    unset = log_of(bag_with("unset", lambda _: 0), recording)
    assert "/joint_states has no header stamps" in unset.notes[0]
    assert whole(unset).t[0] == 500.0
    other = bag_with("other", lambda logged: logged - 400 * SECOND)
    apart = log_of(other, recording)
    assert "/joint_states are 400 s apart" in apart.notes[0]
    assert np.isfinite(whole(apart).q).all()
    assert whole(log_of(other, recording, stamps="header")).t[0] == 499.97
    assert np.isnan(
        whole(log_of(other, recording, stamps="header", clock="joints")).wrenches["l_foot"]
    ).all()


def test_units_and_names_of_the_messages_are_those_configured(
    recording: Any, new_bag: Callable[..., Any]
) -> None:
    names = list(recording.robot.tree.joint_names)
    with new_bag() as bag:
        for k in range(100):
            t = SECOND + 10 * k * MS
            feet(bag, t, 2.0)
            theirs = [f"J{i}" for i in range(len(names))]
            bag.joints("/joint_states", t, theirs, [90.0] * len(names), [500.0] * len(names))
            bag.imu("/imu", t, (0.0, 0.0, 1.0))
    options: dict[str, Any] = {
        "joint_names": {name: f"J{i}" for i, name in enumerate(names)},
        "units": {
            "force": "kN",
            "moment": "N mm",
            "angle": "deg",
            "current": "mA",
            "acceleration": "g",
        },
    }
    block = whole(log_of(bag, recording, effort="current", **options))
    np.testing.assert_allclose(block.q, np.pi / 2)
    np.testing.assert_allclose(block.wrenches["l_foot"][0], [2e3] * 3 + [2e-3] * 3)
    np.testing.assert_allclose(block.currents, 0.5)
    assert block.torques is None
    assert block.imu is not None
    np.testing.assert_allclose(block.imu[:, 2], 9.80665)
    log = log_of(bag, recording, **options)
    assert whole(log).torques is whole(log).currents is None
    assert any("efforts are not read" in note for note in log.notes)
    torques = whole(log_of(bag, recording, effort="torque", **options)).torques
    np.testing.assert_array_equal(torques, np.full((100, len(names)), 500.0))


def test_what_is_lost_is_counted_once_however_often_the_bag_is_read(
    recording: Any, new_bag: Callable[..., Any]
) -> None:
    names = recording.robot.tree.joint_names
    with new_bag() as bag:
        for k in range(300):
            t = SECOND + 10 * k * MS
            feet(bag, t)
            bag.joints("/joint_states", t, names, [0.0] * len(names))
            if k % 100 == 50:
                bag.wrench("/ft/l_foot", t, [9.0] * 6, logged=t + MS)
                bag.wrench("/ft/r_foot", t - 5 * MS, [9.0] * 6, logged=t + MS)
    log = log_of(bag, recording)
    assert log.lost == {}
    for _ in range(2):
        block = whole(log)
        assert block.t.size == 300
        assert (block.wrenches["r_foot"] == 1.0).all()
        next(log.blocks(2.0))
        assert log.lost == {"l_foot duplicated": 3, "r_foot late": 3}


def test_a_frame_that_is_not_the_sensors_is_mentioned(
    recording: Any, new_bag: Callable[..., Any]
) -> None:
    """The fixture writes every wrench in a frame that no link has; here it is the pelvis."""
    names = recording.robot.tree.joint_names
    with new_bag() as bag:
        bag.frame = recording.robot.tree.links[0].name
        feet(bag, SECOND)
        bag.joints("/joint_states", SECOND, names, [0.0] * len(names))
    notes = log_of(bag, recording).notes
    assert any("/ft/l_foot: its messages are in frame pelvis, robot.yaml says" in n for n in notes)
