# SPDX-License-Identifier: Apache-2.0
"""A recording replayed from a bag gives the table of the recording itself."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from comcal.errors import NotStillError
from comcal.measure.recorder import record
from comcal.measure.session import create_session
from comcal.measure.source import SourceRequest
from comcal_drivers.bags import reader
from comcal_drivers.bags.source import open_bag

EPOCH = 1_700_000_000 * 10**9 + 123_456_789
MAPPING = {"topics": {"currents": "/amperes"}, "effort": "torque"}


def table(session: Path) -> list[dict[str, str]]:
    with (session / "poses.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def assert_same(session: Path, direct: Path, shift: float) -> None:
    """Same poses, same means to the last bit; times shifted, and what is computed from times."""
    rows, expected = table(session), table(direct)
    assert len(rows) == len(expected) > 2
    for row, wanted in zip(rows, expected, strict=True):
        assert row.keys() == wanted.keys()
        assert float(row["t"]) == pytest.approx(float(wanted["t"]) - shift, abs=1e-6)
        for column in row.keys() - {"t"}:
            if column.startswith("slope."):
                assert float(row[column]) == pytest.approx(float(wanted[column]), rel=1e-4)
            else:
                assert row[column] == wanted[column], column


def test_our_own_raw_samples_come_back_to_the_last_bit(
    recording: Any, replayed: Callable[..., Path]
) -> None:
    """Written again, the files of raw samples have the same bytes."""
    session = replayed(recording.session / "raw")
    assert_same(session, recording.session, shift=0.0)
    for pose in recording.plan:
        name = f"raw/pose_{pose.pose:03d}.mcap"
        assert (session / name).read_bytes() == (recording.session / name).read_bytes()


def test_one_file_of_our_own_is_one_pose(recording: Any, replayed: Callable[..., Path]) -> None:
    pose = recording.plan[2]
    session = replayed(recording.session / "raw" / f"pose_{pose.pose:03d}.mcap", [pose])
    (row,) = table(session)
    wanted = table(recording.session)[2]
    same = {c for c in row if row[c] == wanted[c]}
    # The first pose of a plan has come from nowhere.
    assert row.keys() - same <= {f"approach.{j}" for j in recording.robot.tree.joint_names}


def test_every_kind_of_bag_gives_the_same_table(
    kind: str, recording: Any, write_recording: Callable[..., Path], replayed: Callable[..., Path]
) -> None:
    session = replayed(write_recording(kind, epoch=EPOCH, delay=3_000_000), **MAPPING)
    assert_same(session, recording.session, shift=float(recording.blocks[0].t[0]))


def test_a_lone_mcap_file_needs_no_folder(
    recording: Any, write_recording: Callable[..., Path], replayed: Callable[..., Path]
) -> None:
    (path,) = write_recording("mcap").glob("*.mcap")
    (path.parent / "metadata.yaml").unlink()
    assert_same(replayed(path, **MAPPING), recording.session, shift=0.0)


def test_poses_in_another_order_than_planned_are_found_when_allowed(
    recording: Any, write_recording: Callable[..., Path], replayed: Callable[..., Path]
) -> None:
    path = write_recording("mcap")
    session = replayed(path, recording.plan[::-1], order="any", **MAPPING)
    direct = {row["pose"]: row for row in table(recording.session)}
    rows = table(session)
    assert [int(row["pose"]) for row in rows] == [p.pose for p in recording.plan[::-1]]
    for row in rows:
        for column in row:
            if column.startswith(("q.", "ft.")):
                assert row[column] == direct[row["pose"]][column]


def test_a_pose_that_never_comes_is_left_out_with_its_reason(
    recording: Any, write_recording: Callable[..., Path], tmp_path: Path
) -> None:
    path = write_recording("sqlite3")
    stranger = replace(recording.plan[0], pose=77, q=recording.plan[0].q + 0.4)
    plan = (*recording.plan[:2], stranger, *recording.plan[2:])
    session = create_session(tmp_path / "s", recording.robot, source="bag", seed=None, details={})
    request = SourceRequest(
        recording.robot, 0, argument=str(path), options={**MAPPING, "arrival": 0.1}, plan=plan
    )
    source = open_bag(request)
    summary = record(recording.robot, source, source, plan, session)
    source.close()
    assert summary.recorded == tuple(p.pose for p in recording.plan)
    (skipped,) = summary.skipped
    assert skipped.pose == 77
    assert "the robot is never in this pose; it is nearest at t = " in skipped.reason
    assert "limit 0.1" in skipped.reason
    alone = create_session(tmp_path / "t", recording.robot, source="bag", seed=None, details={})
    with pytest.raises(NotStillError, match="never in this pose"), open_bag(request) as source:
        record(recording.robot, source, source, (stranger,), alone)


def test_an_interrupted_replay_goes_on_to_the_same_table(
    recording: Any, tmp_path: Path, replayed: Callable[..., Path]
) -> None:
    whole = replayed(recording.session / "raw")
    request = SourceRequest(
        recording.robot, 0, argument=str(recording.session / "raw"), plan=recording.plan
    )
    session = create_session(tmp_path / "two", recording.robot, source="b", seed=None, details={})
    for plan in (recording.plan[:2], recording.plan):
        with open_bag(request) as source:
            record(recording.robot, source, source, plan, session)
    assert session.poses_csv.read_bytes() == (whole / "poses.csv").read_bytes()


def test_a_bag_is_streamed(
    recording: Any, write_recording: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first samples are there before the rest of the file was asked for."""
    taken = 0
    plain = reader.Bag.messages

    def counted(bag: reader.Bag, *args: Any) -> Iterator[reader.Message]:
        nonlocal taken
        for message in plain(bag, *args):
            taken += 1
            yield message

    path = write_recording("mcap")
    monkeypatch.setattr(reader.Bag, "messages", counted)
    request = SourceRequest(recording.robot, 0, argument=str(path), options=MAPPING)
    with open_bag(request) as source:
        taken = 0
        block = source.read(0.1)
        assert block.t.size == 12
        total = sum(b.t.size for b in recording.blocks)
        assert taken < 7 * total / 3
        status = source.status()
    assert json.dumps(dict(status.lost)) == "{}"
    assert "header stamps are used" in status.notes
    assert any("/robot/l_foot/ft" in note for note in status.notes)
    assert np.isfinite(block.q).all()
