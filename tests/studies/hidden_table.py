# SPDX-License-Identifier: Apache-2.0
"""The table of rates, the confusion matrix, and what else the trials showed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from hidden_rates import Rate, classes, counts, extra, names, rates, right, set_size
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
    return lines


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
    """Yield medians, costs, and pairs that nothing was asked of."""
    said = [r for r in records if "verdict" in r]
    cpu = [r["cpu"] for r in said]
    if cpu:
        yield f"one diagnosis: median {np.median(cpu):.2f} s, largest {max(cpu):.2f} s of CPU"
    sets = [set_size(r) for r in said if r["line"] == "close"]
    if sets:
        yield f"sets of close effects: median {np.median(sets):g}, largest {max(sets)}"
    for line, what in (("five_kg", "with currents"), ("five_kg_no_currents", "without")):
        errors = [e for r in said if r["line"] == line for e in _payload_errors(r)]
        if errors:
            mass, place = np.median(np.array(errors), axis=0)
            yield f"5 kg {what}: median error {mass:.2f} kg, {1e3 * place:.0f} mm, n {len(errors)}"
    again = [r["again"] for r in said if r.get("again") is not None]
    if again:
        yield f"run again in the engine: median {np.median(again):.2f} of noise and healthy spread"
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


def _payload_errors(record: Record) -> list[tuple[float, float]]:
    found = list[tuple[float, float]]()
    for cause in record["named"]:
        values = {key: (true, value) for key, true, value, _, _ in cause["values"]}
        if "mass" in values and "com_x" in values:
            off = {key: value - true for key, (true, value) in values.items()}
            place = np.linalg.norm([off[key] for key in ("com_x", "com_y", "com_z")])
            found.append((abs(off["mass"]), float(place)))
    return found


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
