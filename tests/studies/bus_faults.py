# SPDX-License-Identifier: Apache-2.0
"""What goes wrong on a bus, injected on every path: nothing wrong is accepted, nothing is lost.

    python tests/studies/bus_faults.py --sample
    python tests/studies/bus_faults.py --full -o FOLDER [--minutes 60] [--kinds drop,dlc]

A small robot is recorded with ``comcal record``'s own workflow over slcan on a pseudo-terminal,
socketcand on the loopback, python-can's virtual bus and from a log, while its emulator drops,
doubles, delays and damages frames, jumps with counters and clocks, falls silent, is unplugged or
leaves the bus; while the disk is full, or the program is killed. The emulated robot says the same
samples whenever it is in a pose, so every sample behind an accepted pose must be one of those, to
the last bit. Recording goes on with the same command until every pose is there.

Each scenario has its own control: the frames that the reader logged differ from what the robot
said. Scenarios whose fault did not reach the reader do not count, and another one is drawn.

They are appended to FOLDER/scenarios.jsonl; the same command goes on where it was stopped. Exit
code 5: a wrong pose, a lost pose, a loss that nobody was told of, a hang, or no scenario at all.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # small matrices: threads only wait for one another

import argparse
import contextlib
import json
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent))

from bus_fault_draw import KINDS, PATHS, Scenario, draw
from bus_fault_judge import judge
from bus_fault_robot import SmallRobot
from bus_fault_run import run_scenario
from bus_fault_table import failures, table

from comcal.measure.rows import repair_tail
from comcal.workflow.study_pool import run_in_processes

MASTER = 20261122
SAMPLE: Sequence[tuple[str, str]] = tuple(
    (kind, PATHS[k % len(PATHS)]) for k, kind in enumerate(KINDS)
)
"""Each kind on one of the paths."""
REDRAWN = 8
"""Scenarios per one wanted, at most: faults of some do not reach the reader."""

Record = dict[str, Any]
_robots: dict[tuple[str, bool], SmallRobot] = {}


def robot_of(scenario: Scenario, home: Path) -> SmallRobot:
    """Return the robot of a scenario, made once in a process."""
    key = scenario.variant, scenario.asked
    if key not in _robots:
        folder = Path(tempfile.mkdtemp(dir=home))
        name = scenario.variant.replace("+", "_")
        _robots[key] = SmallRobot(folder / name, scenario.variant, asked=scenario.asked)
    return _robots[key]


def run_one(kind: str, path: str, index: int, master: int, home: str) -> Record:
    """Run and judge one scenario.

    Parameters
    ----------
    kind, path : str
    index, master : int
    home : str
        Folder for what it writes; a scenario in which something is wrong stays there.

    Returns
    -------
    dict
        As JSON takes it.
    """
    scenario = draw(kind, path, index, master)
    robot = robot_of(scenario, Path(home))
    folder = Path(tempfile.mkdtemp(prefix=f"{kind}-{path}-{index}-", dir=home))
    began = time.monotonic()
    watched = run_scenario(scenario, robot, folder)
    judgement = judge(scenario, robot, watched)
    if not judgement.is_bad:
        shutil.rmtree(folder, ignore_errors=True)
    return {
        "kind": kind,
        "path": path,
        "index": index,
        "master": master,
        "variant": scenario.variant,
        "device": scenario.device_kind,
        "faults": list(scenario.faults),
        "seconds": round(time.monotonic() - began, 2),
        "runs": watched.runs,
        "errors": [error[:300] for error in watched.errors],
        **judgement.as_record(),
    }


class Store:
    """The scenarios that are done, one JSON line each.

    Parameters
    ----------
    file : Path
        Appended to.
    """

    def __init__(self, file: Path) -> None:
        self._file = file
        self.records: list[Record] = []
        if file.exists():
            repair_tail(file)
            self.records = [json.loads(line) for line in file.read_text("utf-8").splitlines()]

    def append(self, record: Record) -> None:
        """Keep a scenario."""
        self.records.append(record)
        with self._file.open("a", encoding="utf-8") as stream:
            stream.write(json.dumps(record) + "\n")

    def missing(
        self, cells: Sequence[tuple[str, str]], count: int, master: int
    ) -> list[tuple[str, str, int]]:
        """Return what is to be run next, so that each cell gets as many that reached the reader."""
        found = list[tuple[int, str, str, int]]()
        for kind, path in cells:
            mine = [
                r
                for r in self.records
                if (r["kind"], r["path"], r["master"]) == (kind, path, master)
            ]
            reached = sum(r["reached"] for r in mine)
            done = {r["index"] for r in mine}
            fresh = (i for i in range(REDRAWN * count) if i not in done)
            for turn, index in zip(range(reached, count), fresh, strict=False):
                found.append((turn, kind, path, index))
        return [(kind, path, index) for _, kind, path, index in sorted(found)]


def run(
    store: Store,
    cells: Sequence[tuple[str, str]],
    count: int,
    workers: int,
    seconds: float,
    master: int,
    home: Path,
) -> None:
    """Run what is missing, for at most so many seconds."""
    ends = time.monotonic() + seconds
    while time.monotonic() < ends and (wanted := store.missing(cells, count, master)):
        calls = [(kind, path, index, master, str(home)) for kind, path, index in wanted]
        results = run_in_processes(run_one, calls, workers) if workers else _here(calls)
        with contextlib.closing(results):
            for record in results:
                store.append(record)
                bad = record["wrong"] or record["lost"] or record["uncounted"] or record["hung"]
                if bad or len(store.records) % 50 == 0:
                    what = f"{record['kind']} {record['path']} {record['index']}"
                    told = "; ".join(record["details"]) if bad else "well"
                    print(f"{len(store.records)}: {what}: {told}", file=sys.stderr, flush=True)
                if time.monotonic() > ends:
                    return


def _here(calls: Sequence[tuple[str, str, int, int, str]]) -> Iterator[Record]:
    """Run in this process."""
    for call in calls:
        yield run_one(*call)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the study and print its table; return the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    size = parser.add_mutually_exclusive_group(required=True)
    size.add_argument("--sample", action="store_true", help="one of every kind")
    size.add_argument("--full", action="store_true", help="all kinds on all paths; needs -o")
    parser.add_argument("-o", "--output", type=Path, help="folder of the scenarios")
    parser.add_argument("--seed", type=int, default=MASTER, help="master seed")
    parser.add_argument("--kinds", help=f"only these of {', '.join(KINDS)}")
    parser.add_argument("--paths", help=f"only these of {', '.join(PATHS)}")
    parser.add_argument("--count", type=int, help="scenarios of every kind and path [50]")
    parser.add_argument("--workers", type=int, default=1, help="processes; 0: this one")
    parser.add_argument("--minutes", type=float, default=float("inf"), help="then stop")
    given = parser.parse_args(arguments)
    if given.full and given.output is None:
        parser.error("--full needs -o FOLDER: it takes long, and goes on where it was stopped")
    kinds = _chosen(parser, given.kinds, KINDS)
    paths = _chosen(parser, given.paths, PATHS)
    everything = [(kind, path) for kind in kinds for path in paths]
    cells = [c for c in everything if c in SAMPLE] if given.sample else everything
    count = given.count or (1 if given.sample else 50)
    with tempfile.TemporaryDirectory(prefix="comcal-bus-faults-") as scratch:
        folder: Path = given.output or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        home = folder / "failed"
        home.mkdir(exist_ok=True)
        store = Store(folder / "scenarios.jsonl")
        run(store, cells, count, given.workers, 60.0 * given.minutes, given.seed, home)
        text = "\n".join(table(store.records, KINDS, PATHS))
    wrong = list(failures(store.records))
    print(text, *wrong, sep="\n")
    missing = [
        cell for cell in cells if not any((r["kind"], r["path"]) == cell for r in store.records)
    ]
    print(f"\n{'FAILED' if wrong or missing else 'PASSED'}")
    return 5 if wrong or missing else 0


def _chosen(
    parser: argparse.ArgumentParser, text: str | None, known: Sequence[str]
) -> Sequence[str]:
    names = text.split(",") if text else list(known)
    unknown = sorted(set(names) - set(known))
    if unknown:
        parser.error(f"there is no {', '.join(unknown)}; there are {', '.join(known)}")
    return names


if __name__ == "__main__":
    sys.exit(main())
