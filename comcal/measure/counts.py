# SPDX-License-Identifier: Apache-2.0
"""``counts.csv`` of a session: what its source had counted when each pose was finished.

Columns: ``pose, rate.<name>..., lost.<name>..., notes``. Counts are those since the source was
opened: in a recording that was stopped and went on they begin again.
"""

from __future__ import annotations

import csv
from pathlib import Path

from comcal.measure.rows import append_row, repair_tail
from comcal.measure.source import SourceStatus

COUNTS = "counts.csv"


def append_counts(directory: Path, pose: int, status: SourceStatus) -> None:
    """Append a line about one pose; what has no column yet is told in ``notes``.

    Parameters
    ----------
    directory : Path
        Of the session, which is locked.
    pose : int
    status : SourceStatus
    """
    path = directory / COUNTS
    repair_tail(path)
    cells: dict[str, object] = {"pose": pose}
    cells |= {f"rate.{name}": float(f"{rate:.6g}") for name, rate in status.rates.items()}
    cells |= {f"lost.{name}": count for name, count in status.lost.items()}
    notes = [" ".join(note.split()) for note in status.notes]
    known = _header(path)
    if known:
        notes += [f"{name}={value}" for name, value in cells.items() if name not in known]
        cells = {name: value for name, value in cells.items() if name in known}
    append_row(path, {**cells, "notes": "; ".join(notes)})


def _header(path: Path) -> tuple[str, ...]:
    if not path.exists():
        return ()
    with path.open(encoding="utf-8", newline="") as file:
        return tuple(next(csv.reader(file), ()))
