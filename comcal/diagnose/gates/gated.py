# SPDX-License-Identifier: Apache-2.0
"""What has passed the gates so far, and what was found on the way."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from comcal.diagnose.catalogue import Coordinate
from comcal.diagnose.diagnosis import Finding
from comcal.diagnose.gates.channels import Mask
from comcal.measure.table import PoseTable


@dataclass(frozen=True)
class Gated:
    """Readings that may be fitted.

    Parameters
    ----------
    table : PoseTable
        Readings that were refused are NaN; variances are larger where readings are coarse.
    findings : tuple of Finding
    leaves : mapping from (effect, target, key) to float
        Standard deviations of what the findings leave in all poses alike, as the effect that it
        looks like: such errors are not independent, and no fault of the robot either.
    is_fit : bool
        Whether enough is left to name causes in.
    """

    table: PoseTable
    findings: tuple[Finding, ...] = ()
    leaves: Mapping[Coordinate, float] = field(default_factory=dict[Coordinate, float])
    is_fit: bool = True

    def found(
        self,
        table: PoseTable,
        findings: Iterable[Finding],
        leaves: Mapping[Coordinate, float] | None = None,
    ) -> Gated:
        """Return this with another table, further findings and what they leave."""
        return replace(
            self,
            table=table,
            findings=(*self.findings, *findings),
            leaves={**self.leaves, **(leaves or {})},
        )

    def is_coarse(self, target: str, channel: str) -> bool:
        """Return whether a channel was found to lie on a grid: it may repeat itself by chance."""
        return any(
            f.effect == "quantisation"
            and f.target == target
            and channel in f.change.words("channels")
            for f in self.findings
        )


def ids(table: PoseTable, rows: Mask) -> tuple[int, ...]:
    """Return the ids of some poses; empty if it is all of them."""
    return () if rows.all() else tuple(table.pose[i] for i in np.flatnonzero(rows))


def listed(poses: Iterable[int]) -> str:
    """Return pose ids in words, ``all poses`` if there are none."""
    numbers = [str(pose) for pose in poses]
    if not numbers:
        return "all poses"
    more = f" and {len(numbers) - 8} more" if len(numbers) > 8 else ""
    return f"pose{'s' if len(numbers) > 1 else ''} {', '.join(numbers[:8])}{more}"
