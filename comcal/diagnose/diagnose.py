# SPDX-License-Identifier: Apache-2.0
"""From readings to a verdict: gates, mistakes, causes, rivals, what is left, what it is worth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.special import chdtrc
from threadpoolctl import threadpool_limits

from comcal.diagnose.advice import missing_channels, what_would_decide
from comcal.diagnose.candidates import candidates
from comcal.diagnose.catalogue import Catalogue, Coordinate, catalogue
from comcal.diagnose.causes import cause_of, groups_of, outright
from comcal.diagnose.channels import (
    RowFit,
    chance,
    channels_of,
    coordinates_of,
    row_fits,
    traces_of,
)
from comcal.diagnose.contacts import WHERE_ON_ITS_LINE
from comcal.diagnose.diagnosis import Diagnosis, Misfit, Verdict
from comcal.diagnose.gain import gains
from comcal.diagnose.gates.run import gates
from comcal.diagnose.mistakes import screen_mistakes
from comcal.diagnose.naming import Named, about_causes, name_causes
from comcal.diagnose.places import place_of
from comcal.diagnose.scales import learnt_scales, penalty
from comcal.diagnose.scene import Scene, scene
from comcal.diagnose.sentence import sentence
from comcal.measure.table import PoseTable
from comcal.predict.assumed import Assumed
from comcal.robot.changes_table import CHANNELS

HEALTHY_P = 1e-3
"""With no cause named, a smaller p is not healthy."""
MISFIT_P = 1e-4
"""After causes were named, a smaller p means that they are not all."""
UNFIT = "causes were not looked for: what is left of the readings is not fit for it; record again"
VISIBLE = 3.0
"""A fault of fewer sigmas cannot be seen by these poses."""


def diagnose(
    assumed: Assumed,
    table: PoseTable,
    *,
    causes: Sequence[str] | None = None,
    learn: bool = True,
) -> Diagnosis:
    """Say what a model gets wrong, by the readings of one session.

    Parameters
    ----------
    assumed : Assumed
        The model as given.
    table : PoseTable
        Readings as that model understands them.
    causes : sequence of str, optional
        Effects to look for; default: all of the catalogue.
    learn : bool
        Whether the factors of healthy tolerances may be learnt from the readings.

    Returns
    -------
    Diagnosis
        Parameters are *true minus assumed*. What no reading can show is listed as blind.
    """
    # Threads that wait for one another cost small matrices more than they gain: seconds, where
    # other work runs beside it.
    with threadpool_limits(limits=1):
        return _diagnosed(assumed, table, causes, learn)


def _diagnosed(
    assumed: Assumed, table: PoseTable, causes: Sequence[str] | None, learn: bool
) -> Diagnosis:
    gated = gates(assumed, table)
    undone = screen_mistakes(assumed, gated.table) if causes is None else ()
    table = undone[-1].table if undone else gated.table
    looked_for = causes if gated.is_fit else ()
    about = scene(_catalogue(assumed, table, looked_for, gated.leaves), (assumed, table))
    searched = _named(about, learn)
    named = about_causes(searched)
    about = replace(about, scales=named.scene.scales)
    fits = row_fits(about, named)
    misfit = _misfit(about, named, fits)
    worth = gains(named)
    found = tuple(
        cause_of(named, i, None if worth is None else worth.of_cause[k], searched)
        for k, i in enumerate(named.causes)
    )
    groups = groups_of(found)
    verdict = _verdict(bool(found or undone or gated.findings), bool(groups), misfit)
    if worth is not None:
        misfit = replace(misfit, held_out_before=worth.before, held_out_after=worth.after)
    every = (*(outright(step) for step in undone), *found)
    place = place_of(named) if verdict is Verdict.UNEXPLAINED else None
    channels = channels_of(about, fits)
    return Diagnosis(
        verdict=verdict,
        sentence=sentence(
            verdict, every, groups, gated.findings, place, channels, is_all=looked_for is None
        ),
        causes=every,
        groups=groups,
        findings=gated.findings,
        place=place,
        misfit=misfit,
        would_decide=what_would_decide(groups, about),
        channels=channels,
        traces=traces_of(about, fits),
        ladder=named.ladder,
        scales=dict(named.scene.scales),
        blind=_blind(about),
        notes=(
            *(() if gated.is_fit else (UNFIT,)),
            *((WHERE_ON_ITS_LINE,) if _touched(named) else ()),
            *missing_channels(assumed.robot, table),
        ),
        poses=len(table),
        used_rows=about.products.rows,
        held_out=() if worth is None else worth.quantities,
        signatures=_signatures(about, named),
    )


def _catalogue(
    assumed: Assumed,
    table: PoseTable,
    causes: Sequence[str] | None,
    leaves: Mapping[Coordinate, float],
) -> Catalogue:
    known = candidates(assumed.robot, table)
    looked_for = None if causes is None else set(causes)
    return catalogue(known, assumed.robot, looked_for, _also(table, leaves))


def _also(table: PoseTable, leaves: Mapping[Coordinate, float]) -> Mapping[Coordinate, float]:
    """Add what the offsets that were subtracted may leave to what gates do."""
    found = dict(leaves)
    for sensor, cov in table.tare_cov.items():
        for channel, variance in zip(CHANNELS, np.diag(cov).tolist(), strict=True):
            place = "ft_bias", sensor, channel
            found[place] = float(np.hypot(np.sqrt(variance), found.get(place, 0.0)))
    return found


def _named(about: Scene, learn: bool) -> Named:
    """Name causes with the tolerances stated, or with those learnt, if they are likelier.

    Tolerances are learnt about the causes named with those stated: what a large cause does to
    everything else is then taken into account, and one cause is still allowed for.
    """
    stated = name_causes(about)
    if not learn:
        return stated
    scales = learnt_scales(stated.scene)
    if not scales:
        return stated
    learnt = name_causes(replace(stated.scene, scales=scales))
    if not learnt.causes and not stated.causes:
        # Nothing is wrong either way: then what was stated is not doubted without need.
        return stated if _fits(stated) else learnt
    if len(learnt.scene.r) != len(stated.scene.r):  # evidences of other readings do not compare
        return stated
    better = _log_evidence(learnt) + penalty(scales) > _log_evidence(stated)
    return learnt if better else stated


def _fits(named: Named) -> bool:
    against = named.scene.against()
    return float(chdtrc(max(against.rows, 1), against.rr)) > HEALTHY_P


def _log_evidence(named: Named) -> float:
    """Return ln p(residuals, causes) with the causes as large as faults, each one out of N."""
    scene = named.scene
    price = len(named.causes) * float(np.log(max(len(scene.of.candidates), 1)))
    return scene.log_evidence(named.causes) - price


def _misfit(about: Scene, named: Named, fits: tuple[RowFit, ...]) -> Misfit:
    before = about.against()
    after = named.scene.against()
    x = coordinates_of(named)
    chi2 = after.rr + float(x @ after.K @ x - 2.0 * after.b @ x)
    dof = after.rows - int(np.count_nonzero(x))
    p_row, row = chance(fits)
    return Misfit(
        chi2,
        dof,
        float(chdtrc(max(dof, 1), chi2)),
        before.rr,
        float(chdtrc(max(before.rows, 1), before.rr)),
        p_row=p_row,
        row=row,
    )


def _verdict(is_wrong: bool, is_ambiguous: bool, misfit: Misfit) -> Verdict:
    if misfit.chance < (MISFIT_P if is_wrong else HEALTHY_P):
        return Verdict.UNEXPLAINED
    if not is_wrong:
        return Verdict.NOTHING_WRONG
    return Verdict.AMBIGUOUS if is_ambiguous else Verdict.EXPLAINED


def _touched(named: Named) -> bool:
    """Whether contacts in single poses were named."""
    return any(named.scene.of.candidates[i].poses for i in named.causes)


def _blind(about: Scene) -> tuple[str, ...]:
    """Return the candidates of which no coordinate shows at the size of a fault."""
    sizes = about.of.fault * np.sqrt(np.clip(np.diag(about.against().K), 0.0, None))
    return tuple(
        candidate.name
        for candidate, part, is_open in zip(
            about.of.candidates, about.of.slices, about.of.open, strict=True
        )
        if is_open and sizes[part].max() < VISIBLE
    )


def _signatures(about: Scene, named: Named) -> dict[str, dict[str, float]]:
    """Return how the squared norm of causes and rivals is shared out among rows."""
    found: dict[str, dict[str, float]] = {}
    names = [row.name for row in about.at.at.row]
    used = named.scene.by.used
    labels = [names[n] for n in used]
    shown = {*named.causes, *_best(named)}
    for i in sorted(shown):
        part = named.scene.of.slices[i]
        x = coordinates_of(named)[part]
        x = x if x.any() else named.scene.of.fault[part]
        squares = (named.scene.X[:, part] @ x) ** 2
        total = float(squares.sum()) or 1.0
        shares: dict[str, float] = {}
        for label, value in zip(labels, squares, strict=True):
            shares[label] = shares.get(label, 0.0) + float(value) / total
        found[named.scene.of.candidates[i].name] = shares
    return found


def _best(named: Named) -> list[int]:
    index = named.scene.of.index
    return [index[name] for rung in named.ladder for name, _ in rung.best[:4] if name in index]
