# SPDX-License-Identifier: Apache-2.0
"""The results file of a study: one JSON line per calibration, appended as they finish.

A line that a kill cut off is moved aside by the next run. When all are there the file is written
once more in the order of the keys, so the same study gives the same bytes however it was run.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
from collections.abc import Generator, Iterable, Mapping
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

from comcal.errors import DataError, UsageError
from comcal.measure.files import write_atomically
from comcal.measure.rows import repair_tail
from comcal.workflow.study_trial import Trial, TrialKey

STUDY_JSON = "study.json"
RESULTS = "results.jsonl"


class StudyFolder:
    """The output folder of a study.

    Parameters
    ----------
    directory : Path
    """

    def __init__(self, directory: Path) -> None:
        self.directory = directory

    @property
    def results(self) -> Path:
        """The file with one line per calibration."""
        return self.directory / RESULTS

    @contextmanager
    def locked(self) -> Generator[None, None, None]:
        """Be the only one to write here while the context lasts.

        Raises
        ------
        UsageError
            If another process runs this study.
        """
        descriptor = os.open(self.directory / ".lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            yield
        except BlockingIOError as busy:
            raise UsageError(
                "another process is running this study",
                where=str(self.directory),
                next_step="wait until it is done, or give another folder with --output",
            ) from busy
        finally:
            os.close(descriptor)

    def begin(self, meaning: Mapping[str, Any]) -> None:
        """Note what the numbers of this folder mean, or check that they mean the same.

        Parameters
        ----------
        meaning : mapping
            Everything on which results depend, but seeds and their number.

        Raises
        ------
        UsageError
            If the folder holds results of another study.
        """
        text = json.dumps(meaning, sort_keys=True, indent=1) + "\n"
        path = self.directory / STUDY_JSON
        if not path.exists():
            write_atomically(path, text.encode())
        elif path.read_text("utf-8") != text:
            raise UsageError(
                "the folder holds results of another study, robot or version",
                where=str(self.directory),
                next_step="give another folder with --output, or delete this one",
            )
        repair_tail(self.results)

    def finished(self) -> dict[TrialKey, Trial]:
        """Return all calibrations that are done.

        Raises
        ------
        DataError
            If a line is damaged.
        """
        if not self.results.exists():
            return {}
        found: dict[TrialKey, Trial] = {}
        for number, line in enumerate(self.results.read_text("utf-8").splitlines(), start=1):
            try:
                trial = _trial_from(json.loads(line))
            except (ValueError, TypeError, KeyError, AttributeError) as problem:
                raise DataError(
                    "the line is damaged",
                    where=f"{self.results}:{number}",
                    next_step="delete it: that calibration is then run again",
                ) from problem
            found[trial.key] = trial
        return found

    def append(self, trials: Iterable[Trial]) -> None:
        """Append finished calibrations; when this returns, they are on the disk."""
        with self.results.open("ab") as file:
            file.write(b"".join(map(_line, trials)))
            file.flush()
            os.fsync(file.fileno())

    def sort(self, trials: Mapping[TrialKey, Trial]) -> None:
        """Write all calibrations in the order of their keys."""
        data = b"".join(_line(trials[key]) for key in sorted(trials))
        if self.results.read_bytes() != data:
            write_atomically(self.results, data)


def digest_of(*paths: Path | None) -> str:
    """Return one SHA-256 over the content of some files; None stands for no file."""
    whole = hashlib.sha256()
    for path in paths:
        if path is not None:
            whole.update(hashlib.sha256(path.read_bytes()).digest())
    return whole.hexdigest()


def _line(trial: Trial) -> bytes:
    fields = asdict(trial)
    return json.dumps({**fields.pop("key"), **fields}).encode() + b"\n"


def _trial_from(fields: dict[str, Any]) -> Trial:
    key = TrialKey(**{name: fields.pop(name) for name in TrialKey.__dataclass_fields__})
    error, sigma = (tuple(map(float, fields.pop(name))) for name in ("error", "sigma"))
    withheld = tuple(map(int, fields.pop("withheld")))
    if len(error) != len(sigma) or bool(error) == bool(fields["failed"]):
        raise ValueError("an estimate without its sigma")
    return Trial(key, error, sigma, withheld, **fields)
