# SPDX-License-Identifier: Apache-2.0
"""Robots that hide something, diagnosed: how often the cause is named, and how often wrongly.

    python tests/studies/hidden.py --sample
    python tests/studies/hidden.py --full -o FOLDER [--minutes 60] [--lines single,two]
    python tests/studies/hidden.py --full -o FOLDER --readme

Every robot is off by the tolerances of a healthy one in everything, hides something on top in
pybullet or MuJoCo, is recorded with noise through the same sources as ``comcal record --effect``,
and its table of poses goes to the diagnosis, nothing else. Sizes are measured against errors that
tests/hidden/scenario.yaml states, with differences of simulated robots. A rate is met if its 95 %
Wilson interval reaches the figure asked for.

Trials are appended to FOLDER/trials.jsonl with seed, commit and a hash of the code under test; the
same command goes on where it was stopped, and refuses if the code has changed. Exit code 5: a rate
or median is missed. The trials of the README's table are kept in tests/studies/rates, packed by xz;
unpacked beside their study.json they go on from the commit that stands there.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # small matrices: threads only wait for one another

import argparse
import secrets
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))

from hidden_columns import MUJOCO, cached_columns
from hidden_lines import LARGE, LINES
from hidden_medians import medians
from hidden_rates import classes, rates
from hidden_ruler import ruler
from hidden_store import Record, StudyFolder
from hidden_table import confusion, failures, markdown, remarks, table
from hidden_trial import run_trial

from comcal.errors import ComcalError
from comcal.workflow.study_pool import run_in_processes

ENGINES = ("pybullet", MUJOCO)
SAMPLE_SEED = 20261122
SAMPLE: Mapping[str, int] = {
    "single": 4,
    "small": 1,
    "healthy": 5,
    "two": 1,
    "unknown": 1,
    "discrete": 2,
    "contact": 1,
    "five_kg": 1,
}
FULL: Mapping[str, int] = {**dict.fromkeys(LINES, 300), "healthy": 1000}


def in_turn(counts: Mapping[str, int]) -> Iterator[tuple[str, int]]:
    """Yield line and number of every trial, so that what was run in any time has all lines."""
    wanted = [((i + 0.5) / n, line, i) for line, n in counts.items() for i in range(n)]
    for _, line, i in sorted(wanted):
        yield line, i


def run(
    folder: StudyFolder, counts: Mapping[str, int], workers: int, seconds: float, engine: str
) -> None:
    """Run what is missing, for at most so many seconds."""
    ends = time.monotonic() + seconds
    with folder.locked():
        done = folder.finished()
        missing = [
            (line, folder.seed, i, engine)
            for line, i in in_turn(counts)
            if (line, folder.seed, i) not in done
        ]
        if not missing:
            return
        for name in sorted({"mixed", *_more_pose_sets(counts)}):
            print(f"poses {name!r}: columns", file=sys.stderr, flush=True)
            cached_columns(name)
            if not engine and name == "mixed":
                cached_columns(name, MUJOCO)
        results = run_in_processes(run_trial, missing, workers) if workers else _here(missing)
        for n, record in enumerate(results, start=1):
            folder.append([record])
            if n % 20 == 0 or n == len(missing):
                print(f"{n} of {len(missing)} trials", file=sys.stderr, flush=True)
            if time.monotonic() > ends:
                break


def _here(missing: Sequence[tuple[str, int, int, str]]) -> Iterator[Record]:
    """Run in this process."""
    for call in missing:
        yield run_trial(*call)


def _more_pose_sets(counts: Mapping[str, int]) -> set[str]:
    by_line = {"drift": "warming", "drift_revisited": "warming", "cable": "upright"}
    by_line |= {"cable_moved": "upright", "again": "other"}
    return {name for line, name in by_line.items() if line in counts}


def report(records: Sequence[Record], title: str) -> str:
    """Return all that is said of the trials."""
    parts = [
        [title],
        table(records),
        ["Single effects, by what they were taken for:", *confusion(records)],
        list(remarks(records, ruler("mixed").blind(LARGE[0]))),
    ]
    wrong = list(failures(records))
    if wrong:
        parts.append(["What went wrong:", *wrong])
    return "\n\n".join("\n".join(part) for part in parts)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the study and print its table; return the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    size = parser.add_mutually_exclusive_group(required=True)
    size.add_argument("--sample", action="store_true", help="a few trials of the main lines")
    size.add_argument("--full", action="store_true", help="all of them; needs -o")
    parser.add_argument("-o", "--output", type=Path, help="folder of the trials")
    parser.add_argument("--seed", type=int, help="master seed; default a fresh one")
    parser.add_argument("--lines", help="only these, joined by commas")
    parser.add_argument("--count", type=int, help="so many trials of every line")
    parser.add_argument("--workers", type=int, default=1, help="processes; 0: this one")
    parser.add_argument("--minutes", type=float, default=float("inf"), help="then stop")
    parser.add_argument("--engine", choices=ENGINES, help="only this one; default: both")
    parser.add_argument("--readme", action="store_true", help="run nothing, print the table")
    given = parser.parse_args(arguments)
    if given.full and given.output is None:
        parser.error("--full needs -o FOLDER: it takes long, and goes on where it was stopped")
    counts: dict[str, int] = dict(FULL if given.full else SAMPLE)
    if given.lines:
        unknown = set(given.lines.split(",")) - set(LINES)
        if unknown:
            parser.error(f"no line {', '.join(unknown)}; there are {', '.join(LINES)}")
        counts = {line: FULL[line] for line in given.lines.split(",")}
    if given.count is not None:
        counts = dict.fromkeys(counts, int(given.count))
    if given.engine is None:
        given.engine = next(e for e in ENGINES if find_spec(e)) if given.sample else ""
    seed = SAMPLE_SEED if given.sample and given.seed is None else given.seed
    with tempfile.TemporaryDirectory() as scratch:
        try:
            directory = given.output or Path(scratch)
            folder = StudyFolder(directory, seed, secrets.randbits(32))
            print(f"master seed {folder.seed}", file=sys.stderr, flush=True)
            if not given.readme:
                run(folder, counts, given.workers, 60.0 * given.minutes, given.engine)
            records = list(folder.finished().values())
        except ComcalError as refusal:
            print(refusal, file=sys.stderr)
            return refusal.exit_code
        title = (
            f"{len(records)} trials, master seed {folder.seed}, commit "
            f"{folder.meaning['commit']}, code {folder.meaning['code'][:12]}"
        )
        if given.readme:
            print("\n".join([title, "", *markdown(records)]))
            return 0
        text = report(records, title)
        (directory / "table.txt").write_text(text + "\n", encoding="utf-8")
        print(text)
    missed = [rate for rate in (*rates(records), *classes(records)) if not rate.is_met]
    missed += [median for median in medians(records) if not median.is_met]
    print(f"\n{'PASSED' if not missed else f'FAILED: {len(missed)} figures are missed'}")
    return 5 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
