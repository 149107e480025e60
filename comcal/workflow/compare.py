# SPDX-License-Identifier: Apache-2.0
"""``comcal compare``: what changed between two calibrations of a robot."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from comcal.errors import RankError, UsageError
from comcal.identify.adjust import Adjustment, adjust
from comcal.identify.differences import Change, changes_between, comparable
from comcal.identify.scope import scoped
from comcal.identify.unknowns import AXES
from comcal.measure.plan import NONE
from comcal.report.compare import Comparison
from comcal.robot.tree_differences import placement_differences, structure_differences
from comcal.workflow.latest_result import LatestResult, latest_result, read_result

COMMON = (
    "readings of the two are independent, what comes from CAD is the same in both: what it does to "
    "both alike cancels"
)
ADDED = (
    "only the numbers of the two results are known, so their variances are added; what comes from "
    "CAD is counted twice although both share it, so changes are rather missed than invented"
)


def compare_results(a: Path, b: Path) -> Comparison:
    """Compare two calibrations, each a session folder or a ``result.json``.

    Two session folders with the same robot description are compared in full: mass, link CoMs,
    sums of first moments, and the total CoM in the first standing posture of *a*. Otherwise, mass
    and link CoMs are compared by the numbers of the two results.

    Parameters
    ----------
    a, b : Path
        Before and after.

    Raises
    ------
    UsageError
        If one has no result, or they are of robots with other links.
    RankError
        If they have no measured number in common.
    ConfigError, DataError
        If a file is damaged or has changed since it was solved.
    """
    if a.is_dir() and b.is_dir():
        one, other = latest_result(a), latest_result(b)
        _expect_same_links(one.content, other.content, b)
        fits = (_fit(one), _fit(other))
        trees = one.robot.tree, other.robot.tree
        same = not structure_differences(*trees) and not placement_differences(*trees)
        if same and comparable(*fits):
            row = next(i for i, support in enumerate(one.table.support) if support != NONE)
            support, q = one.table.support[row], one.table.q[row]
            changes = changes_between(*fits, support, q)
            posture = f"that of pose {one.table.pose[row]} of {a}, support {support}"
            return _comparison(a, b, one.content, other.content, changes, COMMON, posture)
        contents = one.content, other.content
    else:
        contents = _content(a), _content(b)
        _expect_same_links(*contents, b)
    return _comparison(a, b, *contents, _changes_of_numbers(*contents), ADDED, "")


def _content(path: Path) -> dict[str, Any]:
    return latest_result(path).content if path.is_dir() else read_result(path)


def _fit(result: LatestResult) -> Adjustment:
    unknowns, groups = scoped(result.robot, result.table, result.scope)
    return adjust(result.robot, unknowns, groups)


def _comparison(
    a: Path,
    b: Path,
    one: dict[str, Any],
    other: dict[str, Any],
    changes: tuple[Change, ...],
    how: str,
    posture: str,
) -> Comparison:
    if not changes:
        raise RankError(
            "the two calibrations have no measured number in common",
            where=f"{a} and {b}",
            next_step="record the same kinds of poses in both sessions",
        )
    notes = [how]
    if one.get("robot") != other.get("robot"):
        notes.append(f"the robots are called {one.get('robot')!r} and {other.get('robot')!r}")
    models = [_effects(content) for content in (one, other)]
    if models[0] != models[1]:
        notes.append(
            "they were solved with different models (solve --model): a change may be one of the "
            "model, not of the robot"
        )
    if one.get("sha256", {}).get("poses.csv") == other.get("sha256", {}).get("poses.csv"):
        notes.append("both are of the same poses.csv, so their readings are not independent")
    return Comparison(str(a), str(b), changes, posture, tuple(notes))


def _effects(content: dict[str, Any]) -> object:
    """Return the effects that a result takes as known."""
    return (content.get("model") or {}).get("effects") or []


def _expect_same_links(one: dict[str, Any], other: dict[str, Any], where: Path) -> None:
    names = [[str(link["link"]) for link in content["links"]] for content in (one, other)]
    differing = sorted(set(names[0]) ^ set(names[1]))
    if differing and names[0] and names[1]:
        raise UsageError(
            f"the two robots have other links: {', '.join(differing[:5])}",
            where=str(where),
            next_step="compare calibrations of one robot",
        )


def _changes_of_numbers(one: dict[str, Any], other: dict[str, Any]) -> tuple[Change, ...]:
    """Compare what stands in two ``result.json``."""
    found: list[Change] = []
    if one["mass"] and other["mass"]:
        a, b = one["mass"], other["mass"]
        sigma = float(np.hypot(a["sigma"], b["sigma"]))
        found.append(Change("mass", "mass", a["value"], b["value"], sigma, "kg"))
    links = {link["link"]: link for link in other["links"]}
    for a in one["links"]:
        b = links.get(a["link"])
        for i, letter in enumerate(AXES):
            if b is not None and a["identifiable"][i] and b["identifiable"][i]:
                sigma = float(np.sqrt(a["cov"][i][i] + b["cov"][i][i]))
                name = f"{a['link']} {letter}"
                found.append(Change(name, "link", a["com"][i], b["com"][i], sigma, "m"))
    return tuple(found)
