# SPDX-License-Identifier: Apache-2.0
"""The table of rates, the confusion matrix, and what else the trials showed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from hidden_medians import Median, medians
from hidden_rates import Rate, classes, counts, extra, names, rates, right
from hidden_scenario import Pair

Record = Mapping[str, Any]
SHOWN = 30
"""Failures that are listed."""


def table(records: Sequence[Record]) -> list[str]:
    """Return one line for every rate that is asked for."""
    lines = [f"{'':48} {'rate':>7}  {'95 % interval':>15} {'n':>5}  asked for"]
    for rate in (*rates(records), *classes(records)):
        low, high = rate.interval
        lines.append(
            f"{rate.criterion.what:48} {100 * rate.share:6.1f} %  "
            f"{100 * low:5.1f} to {100 * high:5.1f} {rate.n:5d}  {_asked(rate):15} "
            f"{_verdict(rate)}"
        )
    lines.append(f"{'':48} {'median':>10}  {'largest':>13} {'n':>5}  asked for")
    for median in medians(records):
        lines.append(
            f"{median.what:48} {_number(median.value, median):>10}  "
            f"{_number(max(median.values), median):>13} {len(median.values):5d}  "
            f"{_at_most(median):15} {_median_verdict(median)}"
        )
    return lines


def markdown(records: Sequence[Record]) -> list[str]:
    """Return the table as it stands in the README."""
    lines = ["| | rate | 95 % interval | n | asked for | |", "|---|---:|---|---:|---|---|"]
    for rate in (*rates(records), *classes(records)):
        low, high = rate.interval
        lines.append(
            f"| {rate.criterion.what} | {100 * rate.share:.1f} % | {100 * low:.1f} to "
            f"{100 * high:.1f} | {rate.n} | {_asked(rate)} | {_verdict(rate)} |"
        )
    lines += ["", "| | median | largest | n | asked for | |", "|---|---:|---:|---:|---|---|"]
    for median in medians(records):
        lines.append(
            f"| {median.what} | {_number(median.value, median)} | "
            f"{_number(max(median.values), median)} | {len(median.values)} | {_at_most(median)} | "
            f"{_median_verdict(median)} |"
        )
    return lines


def _number(value: float, median: Median) -> str:
    return f"{value:.3g} {median.unit}".strip()


def _at_most(median: Median) -> str:
    return f"<= {_number(median.most, median)}" if np.isfinite(median.most) else "-"


def _median_verdict(median: Median) -> str:
    if not np.isfinite(median.most):
        return ""
    return "met" if median.is_met else "missed"


def _asked(rate: Rate) -> str:
    least, most = rate.criterion.least, rate.criterion.most
    if least > 0.0 and most < 1.0:
        return f"{100 * least:g} to {100 * most:g} %"
    if least > 0.0:
        return f">= {100 * least:g} %"
    return f"<= {100 * most:g} %" if most < 1.0 else "-"


def _verdict(rate: Rate) -> str:
    if not rate.is_asked_for:
        return ""
    return "met" if rate.is_met else "missed"


def confusion(records: Sequence[Record]) -> list[str]:
    """Return what single effects were taken for: every effect against every name given."""
    seen: dict[str, Counter[str]] = {}
    for record in records:
        if record["line"] not in ("single", "close", "small") or not counts(record):
            continue
        true = record["truth"][0]["name"].partition("@")[0]
        row = seen.setdefault(true, Counter())
        row[_taken_for(record)] += 1
    lines = [f"{'truth':18} right  other target  taken for"]
    for true, row in sorted(seen.items()):
        rest = ", ".join(
            f"{name} {n}" for name, n in row.most_common() if name not in ("right", true)
        )
        lines.append(f"{true:18} {row['right']:5d}  {row[true]:12d}  {rest}")
    return lines


def _taken_for(record: Record) -> str:
    if "crashed" in record:
        return "crashed"
    if right(record):
        more = extra(record)
        return f"right and {more[0].partition('@')[0]}" if more else "right"
    said = names(record)
    return said[0].partition("@")[0] if said else record["verdict"]


def remarks(records: Sequence[Record], blind: Sequence[Pair]) -> Iterator[str]:
    """Yield what could not be tried, and pairs that nothing was asked of."""
    said = [r for r in records if "verdict" in r]
    refused = sum("refused" in r for r in records)
    if refused:
        yield f"robots that could not be recorded: {refused}"
    fell = sum(r.get("fell", 0) for r in said)
    yield f"poses left out because the robot fell: {fell}"
    crashed = [r["crashed"] for r in records if "crashed" in r]
    if crashed:
        yield f"diagnoses that failed: {len(crashed)}, the first with {crashed[0]}"
    shown = ", ".join("@".join(pair) for pair in blind)
    yield f"blind, below s = 15 at the size of a fault ({len(blind)}): {shown}"


def failures(records: Sequence[Record]) -> Iterator[str]:
    """Yield what went wrong, one line for each trial."""
    judged = [rate.criterion for rate in rates(records) if rate.is_asked_for]
    for record in records:
        if not counts(record):
            continue
        wrong = [
            c.what
            for c in judged
            if record["line"] in c.lines
            and c.what != "intervals hold the truth"
            and _is_wrong(c.least > 0.0, c.hits(record) if "crashed" not in record else [])
        ]
        if wrong or "crashed" in record:
            yield f"{record['line']} {record['index']} ({record['engine']}): {_story(record)}"


def _is_wrong(is_wanted: bool, hits: Sequence[bool]) -> bool:
    return any(bool(hit) is not is_wanted for hit in hits)


def _story(record: Record) -> str:
    truth = "; ".join(
        f"{t['change']}" + (f" [s {t['s']:.1f}, d {t['d']:.1f}, {t['rival']}]" if "s" in t else "")
        for t in record["truth"]
    )
    note = f" ({record['note']})" if record.get("note") else ""
    if "crashed" in record:
        return f"{truth or 'healthy'}{note} -> crashed: {record['crashed']}"
    named = ", ".join(f"{c['name']} (size {c['size']:.1f})" for c in record["named"]) or "nothing"
    sets = f" sets {record['groups']}" if record["groups"] else ""
    gates = ", ".join(f"{f['effect']}@{f['target']}" for f in record["findings"])
    gates = f" findings {gates}" if gates else ""
    place = f" place {record['place']}" if record["place"] else ""
    again = f" again {record['again']}" if "again" in record else ""
    p = record["p"]
    return (
        f"{truth or 'healthy'}{note} -> {record['verdict']}: {named}{sets}{gates}{place}{again} "
        f"(p {p[0]:.1e} -> {p[1]:.1e})"
    )
