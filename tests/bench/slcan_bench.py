# SPDX-License-Identifier: Apache-2.0
"""Reading a serial-line CAN adapter: the highest rate without loss, ours against python-can's.

    python tests/bench/slcan_bench.py [--seconds 2] [--rounds 3] [--rates 1000 2000 ...]

The adapter is another process behind a pseudo-terminal, with room for 256 frames: what the reader
does not fetch in time pushes newer frames out, as in the real thing. Where the computer keeps the
adapter's own process waiting, its clock stands still (a real one does not wait for the host), so
the rate that was served is printed beside the one that was asked for. All readers take turns in
one run. Ours does the whole work: reading, the log on disk, the queue, and the check of every
frame; python-can's only counts, by ``recv`` and by ``Notifier`` with ``BufferedReader``.
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
LONGEST_NAP = 0.002
"""Longer than this the adapter's process is not away on its own account [s]."""
IDENTIFIER = 0x123


# --- the adapter's process ----------------------------------------------------------------------


def run_adapter(rate: int, seconds: float) -> None:
    """Answer commands; from ``O`` on send frames; say at the end what became of them."""
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
            batch = reader.take(0.1)
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
            while bus.recv(0.1) is not None:
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
                while buffer.get_message(0.1) is not None:
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

    @property
    def lost(self) -> float:
        return 1.0 - self.got / self.made


def measure(
    reader: str, rate: int, seconds: float, note: Callable[[], None] = lambda: None
) -> Result:
    """Run one adapter and one reader; *note* is called about ten times a second."""
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
        told = report[0]
        if got + told["dropped"] != told["made"]:
            raise SystemExit(f"{reader}: {got} read + {told['dropped']} dropped != {told['made']}")
        return Result(int(told["made"]), got, told["made"] / told["seconds"])
    finally:
        adapter.stdin.close()
        adapter.wait(10)
        adapter.stdout.close()


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--adapter", type=int, metavar="RATE", help=argparse.SUPPRESS)
    parser.add_argument("--seconds", type=float, default=2.0)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--rates", type=int, nargs="+", default=RATES, metavar="FRAMES/S")
    options = parser.parse_args()
    if options.adapter:
        run_adapter(options.adapter, options.seconds)
        return

    print(
        f"{options.seconds:g} s a run, {options.rounds} rounds; a FIFO of {FIFO} frames; load "
        f"{os.getloadavg()[0]:.1f} on {os.cpu_count()} cores; worst loss (lowest rate served)"
    )
    print(f"{'frames/s':>9}" + "".join(f"{name:>24}" for name in READERS))
    best = dict.fromkeys(READERS, 0.0)
    given_up: set[str] = set()
    for rate in options.rates:
        line = f"{rate:9}"
        for name in READERS:
            if name in given_up:
                line += f"{'':>24}"
                continue
            rounds = [measure(name, rate, options.seconds) for _ in range(options.rounds)]
            worst = max(rounds, key=lambda result: result.lost)
            served = min(result.rate for result in rounds)
            if worst.lost == 0.0:
                best[name] = max(best[name], served)
            elif worst.lost > 0.3:
                given_up.add(name)
            line += f"{100 * worst.lost:12.2f} % ({served:7.0f})"
        print(line, flush=True)
    for name, rate in best.items():
        print(f"{name:10} without loss up to {rate:6.0f} frames/s served")
    ratio = best["comcal"] / max(best["Notifier"], best["recv"], 1)
    verdict = "reached" if best["comcal"] >= WANTED else "NOT reached"
    print(f"wanted: {WANTED} frames/s without loss: {verdict}; {ratio:.1f} times python-can")


if __name__ == "__main__":
    main()
