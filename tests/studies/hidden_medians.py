# SPDX-License-Identifier: Apache-2.0
"""Medians that are asked for of the trials: sizes of sets, errors of a body, cost."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from hidden_rates import is_close, set_size

Record = Mapping[str, Any]


@dataclass(frozen=True)
class Median:
    """A median that is asked for.

    Parameters
    ----------
    what, unit : str
    values : tuple of float
    most : float
        What it may be; infinite: it is only told.
    """

    what: str
    unit: str
    values: tuple[float, ...]
    most: float = np.inf

    @property
    def value(self) -> float:
        """The median itself."""
        return float(np.median(self.values))

    @property
    def is_met(self) -> bool:
        """Whether it is no larger than asked for."""
        return self.value <= self.most


def medians(records: Sequence[Record]) -> list[Median]:
    """Return every median that has trials."""
    said = [r for r in records if "verdict" in r]
    sets = [float(set_size(r)) for r in said if r["line"] == "close" and is_close(r)]
    found = [Median("s >= 15, d < 8: size of a set", "", tuple(sets), 2.0)]
    for line, what, most in (
        ("five_kg", "5 kg", (0.2, 15.0)),
        ("five_kg_no_currents", "5 kg, no currents", (np.inf, np.inf)),
    ):
        off = [errors for r in said if r["line"] == line for errors in _payload_errors(r)]
        mass, place = zip(*off, strict=True) if off else ((), ())
        found.append(Median(f"{what}: error of the mass", "kg", mass, most[0]))
        found.append(Median(f"{what}: error of the position", "mm", place, most[1]))
    again = [r["again"] for r in said if r.get("again") is not None]
    found.append(Median("run again in the engine: of noise", "", tuple(again), 1.2))
    found.append(Median("one diagnosis", "s of CPU", tuple(r["cpu"] for r in said)))
    return [median for median in found if median.values]


def _payload_errors(record: Record) -> Iterator[tuple[float, float]]:
    """Yield how far mass [kg] and position [mm] of payloads are from the true ones."""
    for cause in record["named"]:
        off = {key: value - true for key, true, value, _, _ in cause["values"]}
        if "mass" in off and "com_x" in off:
            place = np.linalg.norm([off[key] for key in ("com_x", "com_y", "com_z")])
            yield abs(off["mass"]), 1e3 * float(place)
