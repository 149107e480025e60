# SPDX-License-Identifier: Apache-2.0
"""How many samples come per second, lately."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Mapping

SPAN = 2.0
"""Over which rates are taken [s]."""


class Rates:
    """Rates from counts that grow."""

    def __init__(self) -> None:
        self._seen: deque[tuple[float, dict[str, int]]] = deque()

    def of(self, counts: Mapping[str, int]) -> dict[str, float]:
        """Return counts per second since some two seconds ago; empty the first time."""
        now = time.monotonic()
        self._seen.append((now, dict(counts)))
        while len(self._seen) > 2 and self._seen[1][0] < now - SPAN:
            self._seen.popleft()
        then, before = self._seen[0]
        if now <= then:
            return {}
        return {name: (n - before.get(name, 0)) / (now - then) for name, n in counts.items()}
