# SPDX-License-Identifier: Apache-2.0
"""The folder of a study: one JSON line per trial, appended and synced as they finish."""

from __future__ import annotations

import fcntl
import json
import lzma
import os
import subprocess
from collections.abc import Generator, Iterable
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from hidden_columns import code_hash, generator_hash

from comcal.errors import DataError, UsageError
from comcal.measure.files import write_atomically
from comcal.measure.rows import repair_tail

Record = dict[str, Any]
Key = tuple[str, int, int]
"""Line, master seed and number of a trial."""


def kept_trials(folder: Path) -> list[Record]:
    """Return the trials that are kept with the sources, packed: those of the README's table."""
    with lzma.open(folder / "trials.jsonl.xz", "rt", encoding="utf-8") as lines:
        return [json.loads(line) for line in lines]


def commit() -> str:
    """Return the commit of the working tree, with a plus sign if it differs; else ``unknown``."""
    folder = Path(__file__).parent
    try:
        head = _git(folder, "rev-parse", "--short=12", "HEAD")
        return head + ("+" if _git(folder, "status", "--porcelain") else "")
    except (OSError, subprocess.CalledProcessError):
        return "unknown"


def _git(folder: Path, *arguments: str) -> str:
    run = subprocess.run(
        ["git", *arguments], cwd=folder, check=True, capture_output=True, text=True
    )
    return run.stdout.strip()


class StudyFolder:
    """Where the trials are kept.

    Parameters
    ----------
    directory : Path
    seed : int or None
        Master seed; None: that of the folder, or *fresh*.
    fresh : int
        For a new folder.

    Raises
    ------
    UsageError
        If the folder holds trials of other code, another generator or another seed.
    """

    def __init__(self, directory: Path, seed: int | None, fresh: int) -> None:
        directory.mkdir(parents=True, exist_ok=True)
        self._file = directory / "trials.jsonl"
        self._lock = directory / ".lock"
        path = directory / "study.json"
        kept: dict[str, Any] = json.loads(path.read_text("utf-8")) if path.exists() else {}
        master = kept.get("seed", fresh) if seed is None else seed
        meaning = {
            "format": "comcal-hidden-study/1",
            "seed": master,
            "code": code_hash(),
            "generator": generator_hash(),
        }
        for name, value in meaning.items():
            if kept and kept.get(name) != value:
                raise UsageError(
                    f"the folder holds trials of another {name}",
                    where=str(directory),
                    next_step="give another folder with -o: trials of different code are not mixed",
                )
        self.meaning = kept or {**meaning, "commit": commit()}
        """What all trials have in common."""
        if not kept:
            write_atomically(path, json.dumps(self.meaning, indent=1).encode() + b"\n")

    @property
    def seed(self) -> int:
        """Master seed."""
        return self.meaning["seed"]

    @contextmanager
    def locked(self) -> Generator[None, None, None]:
        """Be the only one to write here.

        Raises
        ------
        UsageError
            If another process does.
        """
        descriptor = os.open(self._lock, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            repair_tail(self._file)
            yield
        except BlockingIOError as busy:
            raise UsageError(
                "another process is running this study", where=str(self._lock.parent)
            ) from busy
        finally:
            os.close(descriptor)

    def finished(self) -> dict[Key, Record]:
        """Return the trials that are done.

        Raises
        ------
        DataError
            If a line is damaged.
        """
        if not self._file.exists():
            return {}
        found: dict[Key, Record] = {}
        for number, line in enumerate(self._file.read_text("utf-8").splitlines(), start=1):
            try:
                record: Record = json.loads(line)
                found[record["line"], record["master"], record["index"]] = record
            except (ValueError, KeyError, TypeError) as problem:
                raise DataError(
                    "the line is damaged",
                    where=f"{self._file}:{number}",
                    next_step="delete it: that trial is then run again",
                ) from problem
        return found

    def append(self, records: Iterable[Record]) -> None:
        """Append trials; when this returns they are on the disk."""
        common = {name: self.meaning[name] for name in ("commit", "code")}
        text = "".join(json.dumps({**record, **common}) + "\n" for record in records)
        with self._file.open("ab") as stream:
            stream.write(text.encode())
            stream.flush()
            os.fsync(stream.fileno())
