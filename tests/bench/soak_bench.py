# SPDX-License-Identifier: Apache-2.0
"""Whether reading a bus for a long time takes more and more memory; prints a table.

    python tests/bench/soak_bench.py [--minutes 10] [--rate 8000]

The adapter of slcan_bench.py sends, the reader logs to disk and hands over, every frame is
checked. The first tenth of the time is for warming up; what the process holds then and at the
end may differ by 2 MB. A loss is no failure where other programs kept the processors busy.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from pathlib import Path

from slcan_bench import hurry, measure

ALLOWED = 2.0
"""Growth that is none [MB]."""
ROWS = 10


def resident() -> float:
    """Memory of this process [MB]."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--rate", type=int, default=8000)
    options = parser.parse_args()

    seconds = 60.0 * options.minutes
    priority = hurry()
    samples: list[tuple[float, float]] = []
    began = time.monotonic()

    def note() -> None:
        t = time.monotonic() - began
        if not samples or t - samples[-1][0] >= seconds / (10 * ROWS):
            samples.append((t, resident()))

    result = measure("comcal", options.rate, seconds, note)
    print(
        f"{options.rate} frames/s asked, {result.rate:.0f} served, {result.made} frames; {priority}"
    )
    for t, held in samples[:: max(1, len(samples) // ROWS)]:
        print(f"{t:8.1f} s {held:8.1f} MB")
    warm = max(held for t, held in samples if t <= seconds / 10 + samples[0][0])
    growth = samples[-1][1] - warm
    why = "" if result.counts else f", while others took {result.others:.1f} processors"
    print(f"lost {100 * result.lost:.3f} %{why}; grown by {growth:.1f} MB, allowed {ALLOWED:g} MB")
    return 5 if growth > ALLOWED or (result.counts and result.lost > 0) else 0


if __name__ == "__main__":
    sys.exit(main())
