# SPDX-License-Identifier: Apache-2.0
"""Files that are missing, broken, torn or no bags at all: what is read, and what is said."""

from __future__ import annotations

import shutil
import sqlite3
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from comcal.errors import DataError, MissingExtraError, UsageError
from comcal.measure.pose_row import cut, join
from comcal.measure.raw import RawWriter
from comcal.measure.source import SourceRequest
from comcal_drivers.bags import reader
from comcal_drivers.bags.configuration import BagSection
from comcal_drivers.bags.log import BagLog
from comcal_drivers.bags.reader import Bag
from comcal_drivers.bags.source import open_bag

SECOND = 1_000_000_000


def raw_file(recording: Any) -> Path:
    return recording.session / "raw" / f"pose_{recording.plan[0].pose:03d}.mcap"


def log(path: Path, recording: Any) -> BagLog:
    return BagLog(path, recording.robot, BagSection())


def test_without_rosbags_the_line_to_type_is_named(
    recording: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reader, "find_spec", lambda name: None)
    with pytest.raises(MissingExtraError, match=r"pip install 'comcal\[ros\]'"):
        Bag(raw_file(recording))


@pytest.mark.parametrize(
    ("argument", "effects", "words"),
    [
        ("", (), "no bag is given"),
        ("nowhere.bag", (), "no such file"),
        ("notes.txt", (), r"not a bag.*'\.txt'"),
        ("empty", (), "no bag is in this folder"),
        ("nowhere.bag", ("payload@torso:mass=1",), "simulated"),
    ],
)
def test_what_is_no_bag_is_refused(
    argument: str,
    effects: tuple[str, ...],
    words: str,
    recording: Any,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("notes.txt").write_text("hello")
    Path("empty").mkdir()
    with pytest.raises(UsageError, match=words):
        open_bag(SourceRequest(recording.robot, 0, argument=argument, effects=effects))


@pytest.mark.parametrize("name", ["a.bag", "a.mcap", "a.db3"])
@pytest.mark.parametrize("content", [b"", b"x", b"neither one nor the other, but long enough"])
def test_rubbish_under_the_name_of_a_bag_is_data_that_cannot_be_read(
    name: str, content: bytes, tmp_path: Path
) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(DataError, match=r"cannot be read.*mend it"):
        Bag(path)


def test_a_bag_that_breaks_off_names_what_mends_it(
    write_recording: Callable[..., Path], tmp_path: Path
) -> None:
    whole = write_recording("ros1").read_bytes()
    path = tmp_path / "torn.bag"
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(DataError, match="rosbag reindex"):
        Bag(path)


def test_a_folder_without_its_storage_is_refused(write_recording: Callable[..., Path]) -> None:
    folder = write_recording("sqlite3")
    (file,) = folder.glob("*.db3")
    file.unlink()
    with pytest.raises(DataError, match="missing"):
        Bag(folder)


def test_a_database_without_messages_is_refused(write_recording: Callable[..., Path]) -> None:
    folder = write_recording("sqlite3")
    (file,) = folder.glob("*.db3")
    with sqlite3.connect(file) as database:
        database.execute("DELETE FROM messages")
    database.close()
    (folder / "metadata.yaml").unlink()
    with pytest.raises(DataError, match="no messages"):
        Bag(folder)


def test_a_folder_of_files_is_read_in_the_order_of_time(
    recording: Any, new_bag: Callable[..., Any], tmp_path: Path
) -> None:
    names = recording.robot.tree.joint_names
    folder = tmp_path / "split"
    folder.mkdir()
    for name, start in (("a", 20), ("b", 10), ("c", 30)):
        with new_bag("ros1", f"part_{name}") as bag:
            for k in range(50):
                t = start * SECOND + k * SECOND // 100
                for sensor in recording.robot.sensors:
                    bag.wrench(f"/ft/{sensor}", t, [start] * 6)
                bag.joints("/joint_states", t, names, [0.0] * len(names))
        shutil.move(bag.file, folder)
    block = join(list(log(folder, recording).blocks(-np.inf)))
    assert block.t.size == 150
    np.testing.assert_array_equal(block.wrenches["l_foot"][::50, 0], [10.0, 20.0, 30.0])
    shutil.copy(folder / "part_a.bag", folder / "part_d.bag")
    with pytest.raises(DataError, match=r"part_a\.bag and part_d\.bag overlap"):
        Bag(folder)


@pytest.mark.parametrize(("share", "blocks"), [(0.3, 1), (0.75, 3), (0.999, 5)])
def test_raw_samples_of_a_killed_recording_are_read_up_to_the_break(
    share: float, blocks: int, recording: Any, tmp_path: Path
) -> None:
    """As left by ``kill -9``: no index, and perhaps half of the last chunk."""
    block, path = recording.blocks[0], tmp_path / "raw" / "pose_000.mcap"
    with RawWriter(path, recording.robot) as raw:
        for k in range(5):
            raw.write(cut(block, slice(20 * k, 20 * (k + 1))))
        end = path.stat().st_size
    path.write_bytes(path.read_bytes()[: round(share * end)])
    torn = log(path, recording)
    assert "pose_000.mcap breaks off; what is before is read" in torn.notes
    found = join(list(torn.blocks(-np.inf)))
    n = 20 * blocks
    assert n - 20 <= found.t.size <= n
    assert found.t.size % 20 == 0
    n = found.t.size
    np.testing.assert_array_equal(found.q, block.q[:n])
    np.testing.assert_array_equal(found.wrenches["r_foot"], block.wrenches["r_foot"][:n])
    np.testing.assert_array_equal(found.currents, block.currents[:n])
    later = join(list(torn.blocks(float(found.t[-1]))))
    np.testing.assert_array_equal(later.q[-1], found.q[-1])


def test_a_file_torn_before_its_first_sample_has_no_messages(
    recording: Any, tmp_path: Path
) -> None:
    path = tmp_path / "pose_000.mcap"
    path.write_bytes(raw_file(recording).read_bytes()[:60])
    with pytest.raises(DataError, match="no messages"):
        Bag(path)
