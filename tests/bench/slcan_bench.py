# SPDX-License-Identifier: Apache-2.0
"""Reading a serial-line CAN adapter: the highest rate without loss, ours against python-can's.

    python tests/bench/slcan_bench.py [--seconds 2] [--rounds 3] [--rates 1000 2000 ...]

The adapter is another process behind a pseudo-terminal, with room for 256 frames: what the reader
does not fetch in time pushes newer frames out, as in the real thing. All readers take turns in one
run. Ours does the whole work: reading, the log on disk, the queue, and the check of every frame;
python-can's only counts, by ``recv`` and by ``Notifier`` with ``BufferedReader``.

Other load on the computer must not decide. The adapter, which stands for a piece of hardware, and
all readers alike run with real-time priority, where that is allowed (root). Two things remain.
Where the adapter's process is kept waiting nevertheless its clock stands still, so only the rate
that was served counts, which is printed beside the one asked for. And a thread of the kernel, which
has no priority, carries what the adapter writes to the reader, 4 KB at a time: where it waits, the
adapter runs over, whoever reads. So a run in which something was lost while other programs took
more than a little of the processors counts for nothing; it is marked with a star, and repeated.

Exit code 5 if frames were lost at the wanted rate, 77 if the computer was too busy to tell.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import argparse
import contextlib
import json
import pty
import select
import subprocess
import sys
import tempfile
import time
import tty
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

FIFO = 256
RATES = (1000, 2000, 3000, 5000, 8000, 10_000, 15_000, 20_000, 30_000, 40_000)
WANTED = 15_000
LATE = 0.98
"""The rate that was served counts as the one asked for, if it is no less than this part of it."""
GIVE_UP = 0.3
"""A reader that loses more than this part is not asked for higher rates."""
QUIET = 0.3
"""Processors that other programs may take while a loss is the reader's own."""
REPEATS = 3
"""So many times the rounds are run at most, until enough of them count."""
READERS, ADAPTER = 1, 2
"""Real-time priorities; every program without one waits for both."""
LONGEST_NAP = 0.002
"""Longer than this the adapter's process is not away on its own account [s]."""
SILENCE = 1.0
"""After this the kernel holds nothing back any more [s]."""
IDENTIFIER = 0x123


def hurry(priority: int = READERS) -> str:
    """Put this process, and those that it starts, before others; say what was allowed."""
    try:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(priority))
    except PermissionError:
        return "no priority (not root)"
    return "real-time priority"


# --- the adapter's process ----------------------------------------------------------------------


def run_adapter(rate: int, seconds: float) -> None:
    """Answer commands; from ``O`` on send frames; say at the end what became of them."""
    hurry(ADAPTER)
    master, slave = pty.openpty()
    tty.setraw(slave)
    os.set_blocking(master, False)
    print(os.ttyname(slave), flush=True)
    heard = b""
    while b"O\r" not in heard:
        if not select.select([master], [], [], 60.0)[0]:
            raise SystemExit("nobody opened the adapter")
        piece = os.read(master, 256)
        heard += piece
        os.write(master, b"\r" * piece.count(b"\r"))
    time.sleep(0.2)

    wanted, made, dropped = int(rate * seconds), 0, 0
    fifo: list[bytes] = []
    unsent = b""
    start = began = last = time.perf_counter()
    while made < wanted:
        time.sleep(0.0003)
        now = time.perf_counter()
        if now - last > LONGEST_NAP:
            began += now - last - LONGEST_NAP
        last = now
        due = min(wanted, int((now - began) * rate))
        room = FIFO - len(fifo)
        fifo += [b"t%03X8%016X\r" % (IDENTIFIER, k) for k in range(made, min(due, made + room))]
        dropped += max(0, due - made - room)
        made = due
        unsent = pour(master, unsent, fifo)
    served = time.perf_counter() - start
    patience = time.perf_counter() + 5.0
    while (unsent or fifo) and time.perf_counter() < patience:
        unsent = pour(master, unsent, fifo)
        time.sleep(0.001)
    print(json.dumps({"made": made, "dropped": dropped, "seconds": served}), flush=True)
    sys.stdin.read()  # the terminal lives until the reader is done


def pour(master: int, unsent: bytes, fifo: list[bytes]) -> bytes:
    """Write what the terminal takes; return what is left of a frame that was cut."""
    with contextlib.suppress(BlockingIOError):
        while unsent or fifo:
            text = unsent + b"".join(fifo[:64])
            n = os.write(master, text)
            gone = n - len(unsent)
            if gone < 0:
                return unsent[n:]
            frames, rest = divmod(gone, len(fifo[0]) if fifo else 1)
            unsent = fifo[frames][rest:] if rest else b""
            del fifo[: frames + (rest > 0)]
    return unsent


# --- the readers --------------------------------------------------------------------------------


def read_ours(path: str, is_over: Callable[[], bool]) -> int:
    """Frames that arrived, each checked to be newer than the one before."""
    import numpy as np

    from comcal_drivers.bus.reader import BusReader
    from comcal_drivers.devices.configuration import BusConfig
    from comcal_drivers.frames.frame_log import FrameLog

    got, newest = 0, -1
    config = BusConfig("can0", "slcan", path, 1_000_000)
    with (
        tempfile.TemporaryDirectory() as folder,
        FrameLog(Path(folder) / "bench.log") as log,
        BusReader(config, log) as reader,
    ):
        while True:
            over = is_over()
            batch = reader.take(SILENCE if over else 0.1)
            if len(batch):
                numbers = np.ascontiguousarray(batch.data).view(">i8").ravel()
                if not (np.diff(numbers, prepend=newest) > 0).all():
                    raise SystemExit("frames out of order")
                newest = int(numbers[-1])
                got += len(batch)
            elif over:
                return got


def read_by_recv(path: str, is_over: Callable[[], bool]) -> int:
    import can

    with can.Bus(interface="slcan", channel=path, bitrate=1_000_000, sleep_after_open=0) as bus:
        got = 0
        while True:
            over = is_over()
            while bus.recv(SILENCE if over else 0.1) is not None:
                got += 1
            if over:
                return got


def read_by_notifier(path: str, is_over: Callable[[], bool]) -> int:
    import can

    buffer, got = can.BufferedReader(), 0
    with can.Bus(interface="slcan", channel=path, bitrate=1_000_000, sleep_after_open=0) as bus:
        notifier = can.Notifier(bus, [buffer], timeout=0.1)
        try:
            while True:
                over = is_over()
                while buffer.get_message(SILENCE if over else 0.1) is not None:
                    got += 1
                if over:
                    return got
        finally:
            notifier.stop()


READERS = {"comcal": read_ours, "Notifier": read_by_notifier, "recv": read_by_recv}


@dataclass(frozen=True)
class Result:
    """What became of the frames of one run."""

    made: int
    got: int
    rate: float
    others: float
    """Processors that other programs took."""

    @property
    def lost(self) -> float:
        return 1.0 - self.got / self.made

    @property
    def counts(self) -> bool:
        """Whether this says something of the reader."""
        return self.lost == 0.0 or self.others <= QUIET


class Busy:
    """How many processors other programs take from now on."""

    def __init__(self) -> None:
        self._start = self._now()

    @property
    def others(self) -> float:
        """Since the start; the readers and adapters that have ended by now are not others."""
        wall, busy, own = (b - a for a, b in zip(self._start, self._now(), strict=True))
        return max(0.0, (busy - own) / wall)

    @staticmethod
    def _now() -> tuple[float, float, float]:
        fields = Path("/proc/stat").read_text("ascii").split("\n", 1)[0].split()[1:9]
        user, nice, system, _idle, _wait, irq, softirq, stolen = map(int, fields)
        busy = (user + nice + system + irq + softirq + stolen) / os.sysconf("SC_CLK_TCK")
        own = os.times()
        return time.monotonic(), busy, sum(own[:4])


def measure(
    reader: str, rate: int, seconds: float, note: Callable[[], None] = lambda: None
) -> Result:
    """Run one adapter and one reader; *note* is called about ten times a second."""
    busy = Busy()
    adapter = subprocess.Popen(
        [
            sys.executable,
            os.path.abspath(__file__),
            "--adapter",
            str(rate),
            "--seconds",
            str(seconds),
        ],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        path = adapter.stdout.readline().strip()
        report: list[dict[str, float]] = []

        def is_over() -> bool:
            note()
            if not report and select.select([adapter.stdout], [], [], 0)[0]:
                report.append(json.loads(adapter.stdout.readline()))
            return bool(report)

        got = READERS[reader](path, is_over)
    finally:
        adapter.stdin.close()
        adapter.wait(10)
        adapter.stdout.close()
    told = report[0]
    if got + told["dropped"] != told["made"]:
        raise SystemExit(f"{reader}: {got} read + {told['dropped']} dropped != {told['made']}")
    return Result(int(told["made"]), got, told["made"] / told["seconds"], busy.others)


def in_rounds(
    reader: str, rate: int, seconds: float, wanted: int
) -> tuple[list[Result], list[Result]]:
    """Return all runs, and those that count; as many as *wanted*, if the computer allows."""
    rounds: list[Result] = []
    judged: list[Result] = []
    while len(judged) < wanted and len(rounds) < REPEATS * wanted:
        rounds.append(measure(reader, rate, seconds))
        judged = [result for result in rounds if result.counts]
    return rounds, judged


def verdict(best: float, lossy: float) -> tuple[str, int]:
    """Return whether the wanted rate was read without loss, and the exit code that says so.

    Parameters
    ----------
    best : float
        Highest rate served without loss [frames/s].
    lossy : float
        Lowest rate asked for at which frames were lost on a quiet computer [frames/s].
    """
    if best >= LATE * WANTED:
        return "reached", 0
    if lossy <= WANTED:
        return "NOT reached", 5
    return "not known, other programs kept the processors busy", 77


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--adapter", type=int, metavar="RATE", help=argparse.SUPPRESS)
    parser.add_argument("--seconds", type=float, default=2.0)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--rates", type=int, nargs="+", default=RATES, metavar="FRAMES/S")
    options = parser.parse_args()
    if options.adapter:
        run_adapter(options.adapter, options.seconds)
        return 0

    print(
        f"{options.seconds:g} s a run, {options.rounds} rounds; a FIFO of {FIFO} frames; "
        f"{hurry()}; load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores; worst loss (lowest "
        "rate served)"
    )
    print(f"{'frames/s':>9}" + "".join(f"{name:>24}" for name in READERS))
    best = dict.fromkeys(READERS, 0.0)
    lossy = dict.fromkeys(READERS, float("inf"))
    given_up: set[str] = set()
    for rate in options.rates:
        line = f"{rate:9}"
        for name in READERS:
            if name in given_up:
                line += f"{'':>24}"
                continue
            rounds, judged = in_rounds(name, rate, options.seconds, options.rounds)
            worst = max(judged or rounds, key=lambda result: result.lost)
            served = min(result.rate for result in judged or rounds)
            if worst.lost == 0.0:
                best[name] = max(best[name], served)
            elif judged:
                lossy[name] = min(lossy[name], rate)
            if judged and worst.lost > GIVE_UP:
                given_up.add(name)
            star = " " if len(judged) == len(rounds) else "*"
            line += f"{100 * worst.lost:11.2f} %{star} ({served:7.0f})"
        print(line, flush=True)
    for name, rate in best.items():
        print(f"{name:10} without loss up to {rate:6.0f} frames/s served")
    words, code = verdict(best["comcal"], lossy["comcal"])
    theirs = max(best["Notifier"], best["recv"])
    ratio = f"; {best['comcal'] / theirs:.1f} times python-can" if theirs else ""
    print(f"wanted: {WANTED} frames/s without loss: {words}{ratio}")
    return code


if __name__ == "__main__":
    sys.exit(main())
