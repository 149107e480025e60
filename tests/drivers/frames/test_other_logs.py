# SPDX-License-Identifier: Apache-2.0
"""ASC, BLF, TRC, CSV and MF4: written by python-can, read by comcal."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import can
import numpy as np
import pytest

from comcal.errors import DataError, MissingExtraError
from comcal_drivers.frames.batch import FrameBatch
from comcal_drivers.frames.batches import concatenate
from comcal_drivers.frames.logs import read_log
from comcal_drivers.frames.messages import pack

Messages = Callable[..., list[can.Message]]
Same = Callable[[FrameBatch, FrameBatch], None]

RESOLUTION = {".asc": 1e-6, ".blf": 0.0, ".trc": 1e-6, ".csv": 0.0, ".mf4": 1e-6}
"""By how much a stamp may differ after the file; TRC and ASC write few digits of a difference."""


def write(path: Path, messages: list[can.Message]) -> Path:
    with can.Logger(path) as log:
        for message in messages:
            log(message)
    return path


@pytest.mark.parametrize("ending", RESOLUTION)
def test_a_log_of_every_format_gives_the_frames_that_were_written(
    ending: str, messages: Messages, tmp_path: Path, assert_same: Same
) -> None:
    sent = messages(250, classic=True)
    if ending == ".csv":
        for message in sent:
            message.is_rx = True  # not in the file
    elif ending == ".trc":
        for k, message in enumerate(sent):
            message.timestamp = 1.7e9 + 0.001 * k  # the file has milliseconds
    for message in sent:
        message.channel = 1
    log = read_log(write(tmp_path / f"x{ending}", sent), chunk=100)
    batches = list(log)
    assert [len(batch) for batch in batches] == [100, 100, 50]
    assert log.torn == 0
    assert sum(log.channels.values()) == 250
    found, expected = concatenate(batches), pack(sent)
    # Time of the day, not seconds since the first frame.
    np.testing.assert_allclose(found.t, expected.t, rtol=0.0, atol=1e-3 + RESOLUTION[ending])
    np.testing.assert_allclose(
        np.diff(found.t), np.diff(expected.t), rtol=0.0, atol=RESOLUTION[ending] + 3e-7
    )
    expected.t[:] = found.t
    assert_same(found, expected)


def test_frames_of_an_mf4_come_in_the_order_of_their_stamps(
    messages: Messages, tmp_path: Path
) -> None:
    sent = messages(200)
    found = concatenate(read_log(write(tmp_path / "x.mf4", sent)))
    assert len(found) == 200
    assert (np.diff(found.t) >= 0.0).all()
    np.testing.assert_array_equal(found.kinds, pack(sent).kinds)


def test_without_asammdf_the_line_to_type_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "x.mf4").write_bytes(b"")
    monkeypatch.setitem(sys.modules, "asammdf", None)
    with pytest.raises(MissingExtraError, match=r"asammdf.*pip install 'comcal\[mf4\]'"):
        read_log(tmp_path / "x.mf4")


def test_without_python_can_the_line_to_type_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "x.blf").write_bytes(b"")
    monkeypatch.setitem(sys.modules, "can", None)
    with pytest.raises(MissingExtraError, match=r"python-can.*pip install 'comcal\[can\]'"):
        read_log(tmp_path / "x.blf")


@pytest.mark.parametrize(("ending", "line"), [(".asc", 8), (".trc", 20), (".csv", 5)])
def test_a_line_that_holds_no_frame_is_named(
    ending: str, line: int, messages: Messages, tmp_path: Path
) -> None:
    path = write(tmp_path / f"x{ending}", [can.Message(float(k), data=b"1234") for k in range(20)])
    lines = path.read_text("utf-8").splitlines(keepends=True)
    lines[line - 1] = lines[line - 1].replace("3", "Z")
    path.write_text("".join(lines), "utf-8")
    with pytest.raises(DataError, match=rf"x\{ending}:{line}: .*not hold CAN frames"):
        list(read_log(path))


@pytest.mark.parametrize("ending", [".asc", ".trc", ".csv"])
@pytest.mark.parametrize("cut", [1, 4, 9])
def test_a_last_line_without_its_end_is_skipped_and_counted(
    ending: str, cut: int, tmp_path: Path
) -> None:
    path = write(tmp_path / f"x{ending}", [can.Message(float(k), data=b"1234") for k in range(20)])
    text = path.read_bytes().rstrip()
    if ending == ".asc":
        text = text[: text.rindex(b"\n")].rstrip()
    path.write_bytes(text[:-cut])
    log = read_log(path)
    assert sum(map(len, log)) == 19
    assert log.torn == 1


def test_the_last_line_of_an_asc_file_may_lack_its_end(tmp_path: Path) -> None:
    path = write(tmp_path / "x.asc", [can.Message(1.0, data=b"1")])
    path.write_bytes(path.read_bytes().rstrip())
    log = read_log(path)
    assert sum(map(len, log)) == 1
    assert log.torn == 0


@pytest.mark.parametrize("cut", [20, 100, 300])
def test_a_blf_that_was_not_finished_gives_what_it_holds_and_says_so(
    cut: int, messages: Messages, tmp_path: Path
) -> None:
    path = write(tmp_path / "x.blf", messages(500, classic=True))
    path.write_bytes(path.read_bytes()[:-cut])
    log = read_log(path)
    assert 0 < sum(map(len, log)) <= 500
    assert log.torn == 1


@pytest.mark.parametrize("ending", [".blf", ".mf4"])
def test_a_file_of_another_kind_is_refused(ending: str, tmp_path: Path) -> None:
    path = tmp_path / f"x{ending}"
    path.write_bytes(b"hello" * 100)
    with pytest.raises(DataError, match=rf"x\{ending}: "):
        list(read_log(path))


def test_stamps_that_count_from_frame_to_frame_are_refused(tmp_path: Path) -> None:
    path = write(tmp_path / "x.asc", [can.Message(1.0, data=b"1")])
    path.write_text(path.read_text("utf-8").replace("absolute", "relative"), "utf-8")
    with pytest.raises(DataError, match="from one frame to the next"):
        list(read_log(path))


def test_one_interface_is_picked(tmp_path: Path) -> None:
    sent = [can.Message(float(k), data=b"1", channel=k % 3) for k in range(10)]
    path = write(tmp_path / "x.blf", sent)
    log = read_log(path, channel="2")
    assert concatenate(log).t.tolist() == [2.0, 5.0, 8.0]
    assert log.channels == {"0": 4, "1": 3, "2": 3}
