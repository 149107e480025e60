# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from pathlib import Path

import can
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from comcal.errors import DataError, UsageError
from comcal_drivers.frames import candump
from comcal_drivers.frames.batch import ERROR, EXTENDED, FD, REMOTE, SENT, FrameBatch
from comcal_drivers.frames.batches import concatenate
from comcal_drivers.frames.frame_log import to_text
from comcal_drivers.frames.logs import read_log
from comcal_drivers.frames.messages import pack

Messages = Callable[..., list[can.Message]]
Same = Callable[[FrameBatch, FrameBatch], None]


@pytest.fixture(scope="module")
def read(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., FrameBatch]:
    """Read a text as a log."""
    path = tmp_path_factory.mktemp("logs") / "text.log"

    def read_text(text: str | bytes, *, torn: int = 0, **options: object) -> FrameBatch:
        path.write_bytes(text.encode() if isinstance(text, str) else text)
        log = read_log(path, **options)  # pyright: ignore[reportArgumentType]
        batch = concatenate(log)
        assert log.torn == torn
        return batch

    return read_text


@pytest.fixture
def _tiny_blocks() -> Iterator[None]:
    """Cut the text where it hurts: every line comes in several blocks."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(candump, "BLOCK", 7)
        yield


Read = Callable[..., FrameBatch]


def written_by_python_can(messages: list[can.Message]) -> str:
    text = io.StringIO()
    writer = can.CanutilsLogWriter(text)
    for message in messages:
        writer(message)
    return text.getvalue()


def test_frames_are_those_that_python_can_finds(
    read: Read, messages: Messages, assert_same: Same
) -> None:
    # python-can keeps neither class nor payload of an error frame.
    text = written_by_python_can([m for m in messages(1000) if not m.is_error_frame])
    assert_same(read(text), pack(can.CanutilsLogReader(io.StringIO(text))))


@given(
    st.lists(st.sampled_from(["can0", "vcan10", "1"]), min_size=1, max_size=30),
    st.integers(0, 2**32),
)
def test_frames_are_those_that_python_can_finds_in_any_mixture(
    read: Read, assert_same: Same, channels: list[str], seed: int
) -> None:
    rng = np.random.default_rng(seed)
    lines: list[str] = []
    for channel in channels:
        number = rng.choice([f"{rng.integers(0, 2**11):03x}", f"{rng.integers(0, 2**29):08X}"])
        way = rng.choice(["", " R", " T"])
        data = rng.bytes(int(rng.integers(0, 9))).hex()
        fd = f"#{rng.integers(0, 4):X}" + rng.bytes(int(rng.choice([0, 12, 48]))).hex()
        payload = rng.choice([data, data.upper(), fd, "R"])
        stamp = f"{rng.integers(0, 10 ** int(rng.integers(1, 11)))}.{rng.integers(0, 10**6):06d}"
        end = rng.choice(["\n", "\r\n", "\n\n"])
        lines.append(f"({stamp}) {channel} {number}#{payload}{way}{end}")
    text = "".join(lines)
    assert_same(read(text), pack(can.CanutilsLogReader(io.StringIO(text))))


@pytest.mark.usefixtures("_tiny_blocks")
def test_the_size_of_blocks_changes_nothing(
    read: Read, messages: Messages, assert_same: Same
) -> None:
    assert_same(read(to_text(pack(messages(60)), "can0")), pack(messages(60)))


@given(st.integers(1, 70))
def test_the_size_of_batches_changes_nothing_but_their_size(
    messages: Messages, assert_same: Same, tmp_path_factory: pytest.TempPathFactory, chunk: int
) -> None:
    path = tmp_path_factory.mktemp("chunks") / "x.log"
    path.write_bytes(to_text(pack(messages(60)), "can0"))
    batches = list(read_log(path, chunk))
    assert [len(batch) for batch in batches[:-1]] == [chunk] * (60 // chunk - (60 % chunk == 0))
    assert 0 < len(batches[-1]) <= chunk
    assert_same(concatenate(batches), pack(messages(60)))


def test_what_was_logged_is_read_back_to_the_last_bit(
    read: Read, messages: Messages, assert_same: Same
) -> None:
    batch = pack(messages(500))
    batch.ids[batch.kinds & ERROR != 0] = 0x40  # bus off
    batch.t[::7] = np.nan
    assert_same(read(to_text(batch, "can0")), batch)


def test_every_form_of_a_line_is_understood(read: Read) -> None:
    batch = read(
        "(1345212884.318850) can0 044#2A366C2B\n"
        "(1345212884.318851) can0 00000044#\n"
        "(1345212884.318852) can0 20000040#0000000000000000\n"
        "(1345212884.318853) can0 7FF#R\n"
        "(1345212884.318854) can0 7FF#R5 T\n"
        "(1345212884.318855) can0 123##1112233445566778899AABBCC\n"
        "(1345212884.318856) can0 123#1122334455667788_E\n"
        "(1345212884.318857123) can0 123#\n"
    )
    assert batch.ids.tolist() == [0x44, 0x44 | int(EXTENDED), 0x40, 0x7FF, 0x7FF, *[0x123] * 3]
    assert batch.lengths.tolist() == [4, 0, 8, 0, 5, 12, 8, 0]
    assert batch.kinds.tolist() == [0, 0, ERROR, REMOTE, REMOTE | SENT, FD, 0, 0]
    assert batch.t.tolist() == [round(1345212884.31885 + 1e-6 * k, 6) for k in range(8)]
    assert batch.data[5, :12].tobytes().hex() == "112233445566778899aabbcc"


CONSOLE = """  can1  7F6   [1]  00
  can1  7F7   [0]{blank}
  can1  7F7   [8]  00 0F 42 40 00 0F 42 4a

  can1  00000181   [3]  11 22 33   '.".'
  can1  123   [0]  remote request
  can1  123   [4]  remote request
  can1  20000040   [8]  00 00 00 00 00 00 00 00   ERRORFRAME
\tbus-off
  can1  123  [12]  00 01 02 03 04 05 06 07 08 09 0A 0B
"""


def assert_is_console_example(batch: FrameBatch) -> None:
    assert batch.ids.tolist() == [
        *(0x7F6, 0x7F7, 0x7F7, 0x181 | int(EXTENDED), 0x123, 0x123, 0x40, 0x123)
    ]
    assert batch.lengths.tolist() == [1, 0, 8, 3, 0, 4, 8, 12]
    assert batch.kinds.tolist() == [0, 0, 0, 0, REMOTE, REMOTE, ERROR, FD]
    assert batch.data[2, :8].tobytes().hex() == "000f4240000f424a"
    assert batch.data[3, :3].tobytes().hex() == "112233"
    assert batch.data[7, :12].tolist() == list(range(12))


@pytest.mark.parametrize("blank", ["", " ", "\r"])
def test_console_text_without_stamps_is_read(read: Read, blank: str) -> None:
    batch = read(CONSOLE.format(blank=blank))
    assert_is_console_example(batch)
    assert np.isnan(batch.t).all()


def test_console_text_with_stamps_is_read(read: Read) -> None:
    lines = CONSOLE.format(blank="").splitlines(keepends=True)
    stamped = "".join(
        f" ({k:03d}.{k:06d}){line}" if line.startswith("  can") else line
        for k, line in enumerate(lines)
    )
    batch = read(stamped)
    assert_is_console_example(batch)
    assert batch.t.tolist() == [k + k / 1e6 for k in (0, 1, 2, 4, 5, 6, 7, 9)]


def test_console_text_tells_what_was_sent(read: Read) -> None:
    batch = read(
        " (1345212884.318850)  can0  RX - -  123   [2]  11 22\n"
        " (1345212884.318851)  can0  TX - -  123   [2]  11 22\n"
        " (1345212884.318852)  can0  TX B E  123  [02]  11 22\n"
    )
    assert batch.kinds.tolist() == [0, SENT, SENT | FD]


GOOD = "(1.000000) can0 123#1122334455667788\n"


@pytest.mark.parametrize("cut", range(len(GOOD) - 1))
def test_a_last_line_without_its_end_is_skipped_and_counted(read: Read, cut: int) -> None:
    """Cut after a pair of digits, it would read as a shorter frame."""
    batch = read(GOOD * 2 + GOOD[:cut], torn=int(cut > 0))
    assert len(batch) == 2
    assert len(read(GOOD[:cut], torn=int(cut > 0))) == 0


def test_zeros_that_a_power_cut_left_are_a_torn_line(read: Read) -> None:
    assert len(read(GOOD.encode() + b"\0" * 10_000)) == 1
    assert len(read(GOOD.encode() + b"(1.0" + b"\0" * 10_000, torn=1)) == 1


@pytest.mark.parametrize(
    "line",
    [
        "(1.000000) can0 123#112233445566778\n",
        "(1.000000) can0 123#11223344556677G8\n",
        "(1.000000) can0 12G#1122334455667788\n",
        "(1.000000) can0 FFF#1122334455667788\n",
        "(1.0000x0) can0 123#1122334455667788\n",
        "(1.00000:) can0 123#1122334455667788\n",
        "(1.000000) can0 123#112233445566778899\n",
        "(1.000000) can0 F0000123#1122334455667788\n",
        "(1.000000 can0 123#1122334455667788\n",
        "hello\n",
        "\0" * 20 + "\n",
    ],
)
@pytest.mark.parametrize("before", [0, 1, 20_000])
def test_a_line_that_holds_no_frame_is_named(read: Read, line: str, before: int) -> None:
    if before == 0 and not line.startswith("(1.000000) can0 123#11"):
        line = "\n" + GOOD + line
        before = 2
    with pytest.raises(DataError, match=rf"text\.log:{before + 1}: .*not hold a CAN frame"):
        read(GOOD * (before if not line.startswith("\n") else 0) + line + GOOD)


def test_console_text_whose_length_is_not_the_payloads_is_refused(read: Read) -> None:
    with pytest.raises(DataError, match=r"text\.log:2"):
        read("  can1  7F6   [1]  00\n  can1  7F6   [2]  00\n")


@pytest.mark.parametrize("text", ["hello\nworld\n", "\x89PNG\r\n\x1a\n" + "\0" * 9000, "1,2,3\n"])
def test_a_file_that_is_no_log_is_refused(read: Read, text: str) -> None:
    with pytest.raises(DataError, match=r"text\.log"):
        read(text)


def test_an_empty_log_holds_no_frames(read: Read) -> None:
    assert len(read("")) == 0
    assert len(read("\n\n")) == 0


def test_one_interface_is_picked_and_all_are_counted(tmp_path: Path) -> None:
    path = tmp_path / "two.log"
    path.write_text(GOOD * 3 + GOOD.replace("can0", "can1") * 2 + GOOD, "ascii")
    log = read_log(path, channel="can1")
    assert sum(map(len, log)) == 2
    assert log.channels == {"can0": 4, "can1": 2}
    assert sum(map(len, read_log(path))) == 6
    assert list(read_log(path, channel="can7")) == []


def test_a_missing_file_and_an_unknown_ending_are_usage(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"none\.log: .*No such file"):
        read_log(tmp_path / "none.log")
    (tmp_path / "x.pcap").write_bytes(b"")
    with pytest.raises(UsageError, match=r"known are: \.log"):
        read_log(tmp_path / "x.pcap")


@pytest.mark.parametrize("digits", [3, 6, 9, 12])
@given(whole=st.integers(0, 10**10 - 1), fraction=st.integers(0, 10**12 - 1))
def test_stamps_are_the_nearest_doubles(read: Read, digits: int, whole: int, fraction: int) -> None:
    stamp = f"{whole}.{fraction // 10 ** (12 - digits):0{digits}d}"
    found = read(f"({stamp}) can0 123#\n").t[0]
    if digits <= 6:
        assert found == float(stamp)
    else:
        assert abs(found - float(stamp)) <= 5.1e-7 + 2.4e-7 * (whole > 10**8)


def test_the_real_log_is_read_to_its_last_frame(shared_dir: Path, assert_same: Same) -> None:
    path = shared_dir / "data" / "ati_epos_canlog" / "sensor-log.txt"
    if not path.is_file():
        pytest.skip(f"no real CAN log at {path}")
    log = read_log(path)
    batch = concatenate(log)
    assert len(batch) == 44_154
    assert log.torn == 0
    assert dict(log.channels) == {"can1": 44_154}
    lines = [line.split() for line in path.read_text("ascii").splitlines()]
    assert batch.ids.tolist() == [int(line[1], 16) for line in lines]
    assert batch.lengths.tolist() == [int(line[2][1:-1]) for line in lines]
    payloads = [bytes.fromhex("".join(line[3:])) for line in lines]
    assert [row[:n].tobytes() for row, n in zip(batch.data, batch.lengths, strict=True)] == payloads
