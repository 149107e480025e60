# SPDX-License-Identifier: Apache-2.0
"""What is asked of the trials, and how often it was met."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from hidden_judge import acts_there, is_place
from hidden_lines import CLEAR, LARGE, SMALL

from comcal.identify.coverage import wilson_interval
from comcal.robot.changes_text import parse_change

Record = Mapping[str, Any]
EXPLAINED, AMBIGUOUS, UNEXPLAINED = "explained", "ambiguous", "unexplained"
CERTAIN = 15.0
"""Size from which a cause may be stated as certain, not merely as consistent."""
CLASSES = ("engine", "sensor_frame", "actuator", "model")


ROUNDING = 1e-12


@dataclass(frozen=True)
class Criterion:
    """One rate that is asked for.

    Parameters
    ----------
    what : str
    lines : tuple of str
        Whose trials count.
    hits : callable
        Takes a record; returns hits, one for each thing that counts, often one; empty: none does.
    least, most : float
        Between which the rate has to be; it is met if its interval reaches in there.
    """

    what: str
    lines: tuple[str, ...]
    hits: Callable[[Record], Sequence[bool]]
    least: float = 0.0
    most: float = 1.0


@dataclass(frozen=True)
class Rate:
    """What became of a criterion.

    Parameters
    ----------
    criterion : Criterion
    hits, n : int
    """

    criterion: Criterion
    hits: int
    n: int

    @property
    def share(self) -> float:
        """Point estimate."""
        return self.hits / self.n if self.n else float("nan")

    @property
    def interval(self) -> tuple[float, float]:
        """95 % by Wilson."""
        return wilson_interval(self.share, self.n) if self.n else (0.0, 1.0)

    @property
    def is_met(self) -> bool:
        """Whether the interval reaches what is asked for."""
        low, high = self.interval
        # The ends of the interval are rounded: 0 of n is met by `at most 0`.
        return high >= self.criterion.least - ROUNDING and low <= self.criterion.most + ROUNDING

    @property
    def is_asked_for(self) -> bool:
        """Whether there is a figure to meet; else the rate is only told."""
        return self.criterion.least > 0.0 or self.criterion.most < 1.0


def counts(record: Record) -> bool:
    """Whether a trial came to a verdict, or should have."""
    return "refused" not in record


def names(record: Record) -> list[str]:
    """Return the causes that were named and may be trusted."""
    if record.get("verdict") not in (EXPLAINED, AMBIGUOUS):
        return []
    return [cause["name"] for cause in record["named"]]


def right(record: Record, k: int = 0) -> bool:
    """Whether one of the hidden effects was named."""
    return bool(set(names(record)) & set(_found(record, k)))


def _found(record: Record, k: int) -> list[str]:
    return list(record["truth"][k].get("found", ()))


def extra(record: Record) -> list[str]:
    """Return the causes that were named and are not there."""
    true = {name for truth in record["truth"] for name in truth.get("found", ())}
    return [name for name in names(record) if name not in true]


def _blamed(record: Record) -> bool:
    """Whether anything is said to be wrong by name: a cause, or readings that are refused."""
    return bool(names(record)) or bool(record.get("findings"))


def _alone(record: Record) -> bool:
    return right(record) and not extra(record) and record["verdict"] == EXPLAINED


def _in_set(record: Record) -> bool:
    """Whether the truth is in the set, or named alone."""
    if record.get("verdict") == AMBIGUOUS:
        true = record["truth"][0]["name"]
        return right(record) or any(true in group for group in record["groups"])
    return record.get("verdict") == EXPLAINED and right(record)


def set_size(record: Record) -> int:
    """Return the size of the set in which the truth is, of the first one if it is in none."""
    true = record["truth"][0]["name"]
    groups = record.get("groups", [])
    return next((len(g) for g in groups if true in g), len(groups[0]) if groups else 1)


def _sized(low: float, high: float, least_d: float, most_d: float = np.inf) -> Callable[..., bool]:
    """Return whether size and separation, as the engine has them, are in a range."""

    def is_in(record: Record) -> bool:
        truth = record["truth"][0]
        return low <= truth["s"] < high and least_d <= truth["d"] < most_d

    return is_in


_clear, is_close = _sized(LARGE[0], np.inf, CLEAR), _sized(LARGE[0], np.inf, 0.0, CLEAR)
_small = _sized(0.9 * SMALL[0], 1.1 * SMALL[1], CLEAR)


def _if(
    condition: Callable[[Record], bool], hit: Callable[[Record], bool]
) -> Callable[[Record], Sequence[bool]]:
    return lambda record: [hit(record)] if condition(record) else []


def _always(hit: Callable[[Record], bool]) -> Callable[[Record], Sequence[bool]]:
    return lambda record: [hit(record)]


def _unknown_found(record: Record) -> bool:
    change = parse_change(record["truth"][0]["change"])
    if record.get("verdict") == UNEXPLAINED:
        return True
    return acts_there(change.words("function")[0], change.target, names(record))


def _place_found(record: Record) -> Sequence[bool]:
    """Whether the place is the right one, where one is said."""
    change = parse_change(record["truth"][0]["change"])
    place = record.get("place")
    return [] if place is None else [is_place(change.words("function")[0], change.target, place)]


def _certain(record: Record) -> bool:
    named = record.get("named", ())
    return record.get("verdict") == EXPLAINED and any(c["size"] >= CERTAIN for c in named)


def _contact_found(record: Record) -> bool:
    """Whether the poses in which the hand touched were found, these and no others."""
    truth = [parse_change(entry["change"]) for entry in record["truth"]]
    named = [parse_change(cause["change"]) for cause in record.get("named", ())]
    touched = {(c.target, pose) for c in truth for pose in c.poses() or ()}
    said = {(c.target, pose) for c in named for pose in c.poses() or ()}
    return touched == said and all(c.effect == "external_contact" for c in named)


def _discrete_found(record: Record) -> bool:
    return bool(_found(record, 0)) and not extra(record)


def _values(record: Record) -> Iterator[tuple[str, float, float, float, float]]:
    for cause in record.get("named", ()):
        if record["verdict"] == EXPLAINED and not extra(record):
            yield from cause["values"]


def _covered(record: Record) -> list[bool]:
    return [low <= true <= high for _, true, _, low, high in _values(record)]


def _gains(record: Record) -> list[bool]:
    if not right(record) or not _clear(record):
        return []
    return [c["gain"] is not None and c["gain"][0] > 0.0 for c in record["named"] if c["values"]]


def _held_outside(record: Record) -> list[bool]:
    """Whether named causes of the family are reported to be outside the stated tolerance."""
    return [bool(cause["outside"]) for cause in record["named"]] if names(record) else []


def _both_names(*effects: str) -> Callable[[Record], Sequence[bool]]:
    def hits(record: Record) -> Sequence[bool]:
        if record.get("verdict") != AMBIGUOUS:
            return [False]
        said = {*names(record), *(name for group in record["groups"] for name in group)}
        kinds = {name.partition("@")[0] for name in said}
        return [record["truth"][0]["name"] in said and set(effects) <= kinds]

    return hits


def _advised(*words: str) -> Callable[[Record], Sequence[bool]]:
    return lambda r: [all(word in " ".join(r.get("advice", ())).lower() for word in words)]


def _again(record: Record) -> Sequence[bool]:
    return [record.get("again") is not None and record["again"] <= 1.2]


CRITERIA: tuple[Criterion, ...] = (
    Criterion("s >= 15, d >= 8: named", ("single",), _if(_clear, right), 0.97),
    Criterion("s >= 15, d >= 8: alone and explained", ("single",), _if(_clear, _alone), 0.93),
    Criterion("s >= 15, d < 8: in the set, or alone", ("close",), _if(is_close, _in_set), 0.95),
    Criterion("set of at most 4", ("close",), _if(is_close, lambda r: set_size(r) <= 4), 1.0),
    Criterion("s = 8-10, d >= 8: named", ("small",), _if(_small, right), 0.93),
    Criterion("healthy: a cause", ("healthy",), _always(_blamed), most=0.005),
    Criterion(
        "healthy: unexplained",
        ("healthy",),
        _always(lambda r: r.get("verdict") == UNEXPLAINED),
        most=0.02,
    ),
    Criterion(
        "two at s = 20: both named", ("two",), _always(lambda r: right(r) and right(r, 1)), 0.92
    ),
    Criterion("two: an extra name", ("two",), _always(lambda r: bool(extra(r))), most=0.05),
    Criterion(
        "not in the catalogue: unexplained or its place",
        ("unknown",),
        _always(_unknown_found),
        0.95,
    ),
    Criterion("not in the catalogue: the place said is right", ("unknown",), _place_found),
    Criterion(
        "not in the catalogue, small: stated as certain",
        ("unknown_small",),
        _always(_certain),
        most=0.0,
    ),
    Criterion("mistake of wiring: exact", ("discrete",), _always(_discrete_found), 0.98),
    Criterion("hand in single poses: pose by pose", ("contact",), _always(_contact_found), 0.98),
    Criterion("readings not worth fitting: refused", ("gate",), _always(_discrete_found), 0.98),
    Criterion("term of the paper: named", ("published",), _always(_alone), 0.95),
    *(
        criterion
        for line, what in (
            ("half", "tolerances stated half as large"),
            ("double", "tolerances stated twice as large"),
            ("family", "one large family stated 3 x wrong"),
        )
        for criterion in (
            Criterion(f"{what}: named", (line,), _if(_clear, right), 0.85),
            Criterion(
                f"{what}: a false name", (line,), _always(lambda r: bool(extra(r))), most=0.03
            ),
        )
    ),
    Criterion(
        "small family 3 x too small: causes outside it",
        ("small_family",),
        _held_outside,
        0.95,
    ),
    Criterion("5 kg: link", ("five_kg",), _always(right), 0.98),
    Criterion("5 kg, no currents: link", ("five_kg_no_currents",), _always(right)),
    Criterion(
        "intervals hold the truth", ("single", "close", "small", "two"), _covered, 0.92, 0.97
    ),
    Criterion("held-out gain above zero, s >= 15", ("single",), _gains, 0.95),
    Criterion("run again in the engine: within 1.2 x", ("again",), _again, 0.90),
    Criterion(
        "drift or temperature: both", ("drift",), _both_names("ft_drift", "ft_temperature"), 0.95
    ),
    Criterion("drift or temperature: cooled", ("drift_revisited",), _always(_alone), 0.95),
    Criterion(
        "cable or trunk mass: both", ("cable",), _both_names("cable_pull", "link_mass"), 0.95
    ),
    Criterion("cable or trunk mass: trunk moved", ("cable_moved",), _always(_alone), 0.95),
    Criterion(
        "shoulder or arm CoM: both", ("shoulder",), _both_names("joint_offset", "link_com"), 0.95
    ),
    Criterion("shoulder or arm CoM: advice", ("shoulder",), _advised("angle", "arm"), 0.95),
)


def rates(records: Sequence[Record]) -> list[Rate]:
    """Return the rate of every criterion that has trials."""
    found = list[Rate]()
    for criterion in CRITERIA:
        hits = [
            bool(hit)
            for record in records
            if record["line"] in criterion.lines and counts(record)
            for hit in (criterion.hits(record) if "crashed" not in record else [False])
        ]
        if hits:
            found.append(Rate(criterion, sum(hits), len(hits)))
    return found


def classes(records: Sequence[Record]) -> list[Rate]:
    """Return how often large and clear single effects were named, by how they are realised."""
    named = CRITERIA[0]
    found = list[Rate]()
    for kind in CLASSES:
        of_kind = [
            r for r in records if r["line"] == "single" and r["truth"][0]["realisation"] == kind
        ]
        (rate, *_) = [*rates(of_kind), Rate(named, 0, 0)]
        if rate.n:
            what = Criterion(f"s >= 15, d >= 8: named ({kind})", named.lines, named.hits, 0.97)
            found.append(Rate(what, rate.hits, rate.n))
    return found
