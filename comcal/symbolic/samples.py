# SPDX-License-Identifier: Apache-2.0
"""One example for every program: numbers that are neither special nor random."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from comcal.robot.tree import Array
from comcal.symbolic.program import Quantity

GOLDEN = (np.sqrt(5.0) - 1.0) / 2.0
"""Its multiples by squares, modulo 1, fall evenly and follow no line."""
RANGES = {
    "rad": (0.3, 2.8),
    "rad|m": (0.3, 1.4),
    "kg": (1.0, 5.0),
    "N": (50.0, 200.0),
    "": (0.05, 0.45),
}
"""Where the numbers lie, by unit; the last for all others. Angles so wide that shapes differ."""


def sample_inputs(inputs: Sequence[Quantity]) -> dict[str, Array]:
    """Return a value for every input, by name, in its shape."""
    values: dict[str, Array] = {}
    count = 0
    for q in inputs:
        size = len(q.symbols)
        even = np.mod((count + 1.0 + np.arange(size)) ** 2 * GOLDEN, 1.0)
        low, high = RANGES.get(q.unit, RANGES[""])
        values[q.name] = (low + (high - low) * even).reshape(q.shape)
        count += size
    return values
