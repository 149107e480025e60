# SPDX-License-Identifier: Apache-2.0
"""The table of the faults on a bus, and what went wrong in words."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

Record = Mapping[str, Any]

BAD = ("wrong", "lost", "uncounted", "hung")
"""What must not happen."""
_HEADER = (
    f"{'kind':13}{'path':11}{'scenarios':>10}{'seen':>6}{'wrong':>7}{'lost':>6}{'untold':>8}"
    f"{'hung':>6}{'refused':>9}{'retried':>9}{'longest quiet':>15}"
)


def table(records: Sequence[Record], kinds: Sequence[str], paths: Sequence[str]) -> Iterator[str]:
    """Yield the lines of the table, kind by kind and path by path.

    ``seen``: scenarios whose fault the reader got, as its own log shows. ``wrong``: poses accepted
    with samples that never were; ``lost``: finished poses gone, or planned ones never recorded;
    ``untold``: losses of which nobody was told; ``hung``: time-outs exceeded. ``refused``: runs
    that ended with an error, and poses left out; ``retried``: poses that were tried once more.
    """
    yield _HEADER
    for kind in kinds:
        for path in paths:
            mine = [r for r in records if (r["kind"], r["path"]) == (kind, path)]
            if mine:
                yield f"{kind:13}{path:11}{_numbers(mine)}"
    if records:
        yield f"{'all':24}{_numbers(records)}"


def _numbers(records: Sequence[Record]) -> str:
    seen = sum(r["reached"] for r in records)
    wrong, lost, untold, hung = (sum(r[name] for r in records) for name in BAD)
    refused, retried = (sum(r[name] for r in records) for name in ("refused", "retried"))
    quiet = max(r["quiet"] for r in records)
    return (
        f"{len(records):>10}{seen:>6}{wrong:>7}{lost:>6}{untold:>8}{hung:>6}{refused:>9}"
        f"{retried:>9}{quiet:>13.1f} s"
    )


def failures(records: Sequence[Record]) -> Iterator[str]:
    """Yield a line for every scenario in which something happened that must not."""
    for r in records:
        if any(r[name] for name in BAD):
            what = "; ".join(r["details"])
            yield f"{r['kind']} {r['path']} {r['index']} {r['variant']} {r['faults']}: {what}"
