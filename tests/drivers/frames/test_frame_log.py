# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import errno
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import can
import pytest

from comcal.errors import ConfigError, HardwareError
from comcal_drivers.frames import frame_log
from comcal_drivers.frames.batch import FrameBatch
from comcal_drivers.frames.batches import concatenate
from comcal_drivers.frames.frame_log import FrameLog, to_text
from comcal_drivers.frames.logs import read_log
from comcal_drivers.frames.messages import pack

Messages = Callable[..., list[can.Message]]
Same = Callable[[FrameBatch, FrameBatch], None]


def test_what_was_written_is_read_back_whatever_its_kind(
    messages: Messages, tmp_path: Path, assert_same: Same
) -> None:
    with FrameLog(tmp_path / "x.log") as log:
        log.write(pack(messages(100)), "can0")
        log.write(pack([]), "can0")
        log.write(pack(messages(30)), "can0")
    found = concatenate(read_log(tmp_path / "x.log"))
    assert_same(found, concatenate([pack(messages(100)), pack(messages(30))]))


def test_the_text_is_that_of_candump(messages: Messages) -> None:
    line = re.compile(
        r"\(\d{10}\.\d{6}\) can0 ([0-7][0-9A-F]{2}|[0-3][0-9A-F]{7})"
        r"#(R\d?|(#0)?([0-9A-F]{2})*)( T)?"
    )
    for written in to_text(pack(messages(200)), "can0").decode().splitlines():
        assert line.fullmatch(written), written


def test_python_can_reads_the_log(messages: Messages, tmp_path: Path) -> None:
    sent = messages(100)
    with FrameLog(tmp_path / "x.log") as log:
        log.write(pack(sent), "can0")
    for found, expected in zip(can.LogReader(tmp_path / "x.log"), sent, strict=True):
        assert found.is_error_frame == expected.is_error_frame
        if not expected.is_error_frame:  # of which it keeps no more
            assert found.equals(expected, timestamp_delta=0.0)


CHILD = """
import sys
from comcal_drivers.frames.batches import empty_batch
from comcal_drivers.frames.frame_log import FrameLog
log = FrameLog(sys.argv[1])
batch = empty_batch(int(sys.argv[2]))
batch.lengths[:] = 8
while True:
    log.write(batch, "can0")
    print(len(batch), flush=True)
"""


@pytest.mark.parametrize("frames", [1, 7000])
def test_nothing_that_was_written_is_lost_by_kill_9(tmp_path: Path, frames: int) -> None:
    path = tmp_path / "x.log"
    child = subprocess.Popen(
        [sys.executable, "-c", CHILD, str(path), str(frames)], stdout=subprocess.PIPE, text=True
    )
    try:
        assert child.stdout is not None
        told = sum(int(child.stdout.readline()) for _ in range(20))
        child.send_signal(signal.SIGKILL)
        told += sum(int(line) for line in child.stdout)
    finally:
        child.kill()
        child.wait(10)
        if child.stdout is not None:
            child.stdout.close()
    log = read_log(path)
    assert sum(map(len, log)) >= told
    assert log.torn <= 1
    # And the next writer goes on where a whole line ends.
    before = sum(map(len, read_log(path)))
    with FrameLog(path) as resumed:
        assert bool(resumed.cut) == bool(log.torn)
        resumed.write(pack([can.Message(9.0, 5, data=b"\x01")]), "can0")
    log = read_log(path)
    assert sum(map(len, log)) == before + 1
    assert log.torn == 0


LINE = b"(0000000001.000000) can0 123#1122\n"


@pytest.mark.parametrize("cut", range(1, len(LINE)))
def test_a_line_without_its_end_is_cut_off_before_more_is_appended(
    tmp_path: Path, cut: int
) -> None:
    path = tmp_path / "x.log"
    path.write_bytes(LINE + LINE[:cut])
    with FrameLog(path) as log:
        assert log.cut == LINE[:cut]
        log.write(pack([can.Message(1.0, 0x123, is_extended_id=False, data=b"\x11\x22")]), "can0")
    assert path.read_bytes() == LINE + LINE


def test_zeros_that_a_power_cut_left_are_cut_off(tmp_path: Path) -> None:
    path = tmp_path / "x.log"
    path.write_bytes(LINE + b"(00" + bytes(9000))
    FrameLog(path).close()
    assert path.read_bytes() == LINE


@pytest.mark.parametrize("content", [b"precious\n", b"a,b\n1,2", b"\x89PNG" * 2000])
def test_a_file_that_is_no_log_is_left_alone(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "x.log"
    path.write_bytes(content)
    with pytest.raises(ConfigError, match=r"x\.log: .*nothing is appended"):
        FrameLog(path)
    assert path.read_bytes() == content


def test_a_folder_that_is_missing_is_a_hardware_error(tmp_path: Path) -> None:
    with pytest.raises(HardwareError, match="No such file"):
        FrameLog(tmp_path / "none" / "x.log")


def test_a_full_disk_leaves_whole_lines_and_room_makes_it_go_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, messages: Messages, assert_same: Same
) -> None:
    write, room = os.write, [100]

    def write_what_fits(file: int, text: memoryview) -> int:
        if room[0] <= 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        room[0] -= (done := write(file, text[: room[0]]))
        return done

    batches = [pack(messages(n)) for n in (1, 50, 2)]
    with FrameLog(tmp_path / "x.log") as log:
        monkeypatch.setattr(frame_log.os, "write", write_what_fits)
        log.write(batches[0], "can0")
        with pytest.raises(HardwareError, match=r"x\.log: .*No space left.*make room"):
            log.write(batches[1], "can0")
        room[0] = 10**6
        log.write(batches[2], "can0")
    reader = read_log(tmp_path / "x.log")
    assert_same(concatenate(reader), concatenate([batches[0], batches[2]]))
    assert reader.torn == 0


def test_the_disk_is_asked_soon_and_not_too_often(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, messages: Messages
) -> None:
    fsync, asked = os.fsync, list[float]()

    def noted(file: int) -> None:
        asked.append(time.monotonic())
        fsync(file)

    batch = pack(messages(5))
    with FrameLog(tmp_path / "x.log") as log:
        monkeypatch.setattr(frame_log.os, "fsync", noted)
        began = time.monotonic()
        while time.monotonic() < began + 1.3:
            log.write(batch, "can0")
            time.sleep(0.01)
        while_writing = list(asked)
    assert 2 <= len(while_writing) <= 3
    assert len(asked) > len(while_writing)


def test_a_disk_that_does_not_keep_what_was_written_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, messages: Messages
) -> None:
    def broken(_: int) -> None:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    log = FrameLog(tmp_path / "x.log")
    monkeypatch.setattr(frame_log.os, "fsync", broken)

    def write_for_a_second() -> None:
        for _ in range(100):
            log.write(pack(messages(5)), "can0")
            time.sleep(0.01)

    with pytest.raises(HardwareError, match="kept by the disk"):
        write_for_a_second()
    with pytest.raises(HardwareError, match="kept by the disk"):
        log.close()
    log.close()


def test_threads_do_not_mix_their_batches(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, messages: Messages
) -> None:
    write = os.write

    def write_a_piece(file: int, text: memoryview) -> int:
        time.sleep(1e-4)  # the others' turn
        return write(file, text[:300])

    batch = pack(messages(40))
    with FrameLog(tmp_path / "x.log") as log:
        monkeypatch.setattr(frame_log.os, "write", write_a_piece)
        threads = [
            threading.Thread(target=lambda name=f"can{k}": [log.write(batch, name) for _ in "123"])
            for k in range(4)
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(20)
    reader = read_log(tmp_path / "x.log")
    assert sum(map(len, reader)) == 4 * 3 * 40
    assert set(reader.channels.values()) == {3 * 40}
    names = [line.split()[1] for line in (tmp_path / "x.log").read_text().splitlines()]
    assert all(len(set(names[k : k + 40])) == 1 for k in range(0, len(names), 40))


def test_a_closed_log_takes_no_more(tmp_path: Path, messages: Messages) -> None:
    log = FrameLog(tmp_path / "x.log")
    log.close()
    with pytest.raises(ValueError, match="closed"):
        log.write(pack(messages(1)), "can0")


@pytest.mark.parametrize("name", ["", "left leg", " can0"])
def test_the_name_of_a_bus_must_be_one_word(name: str, messages: Messages) -> None:
    with pytest.raises(ConfigError, match="one word"):
        to_text(pack(messages(1)), name)
