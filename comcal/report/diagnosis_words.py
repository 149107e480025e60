# SPDX-License-Identifier: Apache-2.0
"""What the terminal report and the page of a diagnosis say alike: odds, gains, verdict."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from comcal.diagnose.diagnose import HEALTHY_P, MISFIT_P
from comcal.diagnose.diagnosis import Cause, Channel, Diagnosis, Place, Rival, Verdict
from comcal.diagnose.sentence import choices
from comcal.report.display_units import shown_unit
from comcal.robot.effect_specs import effect_specs

FORCED_WRONG_GAINED = 54
"""Per cent of trials in which a wrong cause, forced in, gained on held-out poses nevertheless."""
NO_PROOF = (
    f"a gain alone does not prove a cause: wrong causes that were forced in gained too, in "
    f"{FORCED_WRONG_GAINED} % of trials; what speaks for a cause are its odds against its rivals, "
    "and that only noise is left"
)
_NAMES_SHOWN = 4


@dataclass(frozen=True)
class ParameterText:
    """One parameter as it is printed.

    Parameters
    ----------
    value, interval, note : str
    """

    key: str
    value: str
    interval: str
    note: str


def parameter_texts(cause: Cause) -> tuple[ParameterText, ...]:
    """Return the parameters of a cause, numbers with their 95 % interval, in printed units."""
    found: list[ParameterText] = []
    for key, value in cause.change.parameters.items():
        estimate = cause.estimates.get(key)
        if isinstance(value, tuple):
            found.append(ParameterText(key, ", ".join(map(str, value)), "", ""))
        elif estimate is None:
            found.append(ParameterText(key, f"{value:.4g}", "", ""))
        else:
            factor, unit = shown_unit(estimate.unit, key)
            low, high = (bound * factor for bound in estimate.interval)
            digits = _decimals(estimate.sigma * factor)
            number = f"{_fixed(estimate.value * factor, digits)} {unit}".rstrip()
            interval = f"{_fixed(low, digits)} to {_fixed(high, digits)}"
            note = "outside the healthy tolerance" if key in cause.outside else ""
            found.append(ParameterText(key, number, interval, note))
    return tuple(found)


def _decimals(sigma: float) -> int:
    """Return how many decimals two digits of sigma need."""
    if not math.isfinite(sigma) or sigma <= 0.0:
        return 3
    return min(max(1 - math.floor(math.log10(sigma)), 0), 6)


def _fixed(value: float, decimals: int) -> str:
    if not math.isfinite(value):
        return "-" if math.isnan(value) else "unbounded"
    return f"{round(value, decimals) + 0.0:.{decimals}f}"


def odds(log_odds: float) -> str:
    """Return the odds of a rival: ``1:400``, ``1:10^9``, or ``3:1`` where it is ahead.

    Parameters
    ----------
    log_odds : float
        ln evidence of the cause named - ln evidence of the rival.
    """
    if math.isnan(log_odds):
        return "-"
    ratio = _ratio(abs(log_odds))
    return f"1:{ratio}" if log_odds >= 0.0 or ratio == "1" else f"{ratio}:1"


def _ratio(log: float) -> str:
    if log >= 99.0 * math.log(10.0):
        return "10^99"
    if log >= math.log(1e6):
        return f"10^{log / math.log(10.0):.0f}"
    ratio = math.exp(log)
    if ratio < 9.95:
        return f"{ratio:.1f}".removesuffix(".0")
    return f"{float(f'{ratio:.2g}'):.0f}"


def in_favour(log_odds: float) -> str:
    """Return the odds of a cause against doing without it: ``400:1``.

    Parameters
    ----------
    log_odds : float
        ln evidence with it - ln evidence without it.
    """
    return odds(-log_odds)


def summary_of(effect: str) -> str:
    """Return the line of the catalogue about an effect; empty for one that is not in it."""
    spec = effect_specs().get(effect)
    return spec.summary if spec is not None else ""


def rival_texts(rivals: Iterable[Rival]) -> list[tuple[str, str, str]]:
    """Return name, odds, and how much of the cause a rival cannot imitate."""
    return [
        (
            rival.name,
            odds(rival.log_odds),
            "the same in every reading" if rival.left < 0.005 else f"{100 * rival.left:.0f} %",
        )
        for rival in rivals
    ]


def group_rows(diagnosis: Diagnosis) -> list[tuple[str, str, str]]:
    """Return name, odds and summary of every cause that is not told from others."""
    return [
        (rival.name, chance, summary_of(rival.effect))
        for group in diagnosis.groups
        for rival, (_, chance, _) in zip(group, rival_texts(group), strict=True)
    ]


CHANNEL_HEADER = ("residual", "before -> after", "sigmas", "follows", "worst pose")


def channel_rows(channels: Iterable[Channel]) -> list[tuple[str, ...]]:
    """Return every residual's name, size before and after, what it follows, and its worst pose."""
    return [
        (
            channel.name,
            channel_text(channel),
            f"{channel.sigmas_before:.1f} -> {channel.sigmas_after:.1f}",
            channel.follows or "-",
            str(channel.worst) if channel.worst >= 0 else "-",
        )
        for channel in channels
    ]


def channel_text(channel: Channel) -> str:
    """Return ``12.1 -> 0.8 N``, in the unit that people read."""
    factor, unit = shown_unit(channel.unit)
    return f"{channel.before * factor:.3g} -> {channel.after * factor:.3g} {unit}"


def gain_text(cause: Cause) -> str:
    """Return what one cause gains on held-out poses, with its interval."""
    gain = cause.gain
    if gain is None:
        return "too few poses to hold some out"
    low, high = (100 * bound for bound in gain.interval)
    words = (
        f"removes {100 * gain.fraction:.0f} % of their squared residuals "
        f"(95 %: {low:.0f} to {high:.0f} %)"
    )
    return words if gain.is_real else f"{words}: nothing is gained beyond noise"


def has_gain(diagnosis: Diagnosis) -> bool:
    """Whether a named cause predicts held-out poses better, beyond noise."""
    return any(cause.gain is not None and cause.gain.is_real for cause in diagnosis.causes)


def gain_summary(diagnosis: Diagnosis) -> list[str]:
    """Return what the extended model gains over the nominal one, and what that does not prove."""
    misfit, lines = diagnosis.misfit, list[str]()
    if misfit.held_out_before is not None and misfit.held_out_after is not None:
        lines.append(
            f"nominal -> extended: whitened mean square {misfit.held_out_before:.2f} -> "
            f"{misfit.held_out_after:.2f} (1 is noise and healthy spread)"
        )
    if not diagnosis.causes:
        return [*lines, "nothing is gained: no cause was named"]
    judged = [cause for cause in diagnosis.causes if cause.gain is not None]
    if not judged:
        return [*lines, "too few poses to hold some out: whether anything is gained is not known"]
    if not has_gain(diagnosis):
        lines.append("nothing is gained beyond noise: do not change the model for this")
    return [*lines, NO_PROOF]


def held_out_rows(diagnosis: Diagnosis) -> list[tuple[str, str, str]]:
    """Return every held-out quantity: name, ``2.65 -> 2.08 mm``, and what was gained (95 %)."""
    rows: list[tuple[str, str, str]] = []
    for quantity in diagnosis.held_out:
        factor, unit = shown_unit(quantity.unit)
        before, after = quantity.before * factor, quantity.after * factor
        low, high = (bound * factor for bound in quantity.gained)
        gained = "-" if math.isnan(low) else f"{low:.2g} to {high:.2g}"
        rows.append((quantity.name, f"{before:.3g} -> {after:.3g} {unit}", gained))
    return rows


HELD_OUT_HEADER = ("root mean square", "nominal -> extended", "gained per pose, 95 %")


def place_text(place: Place) -> str:
    """Return where something acts that the catalogue has no name for."""
    at = f"{place.place} {place.target}".rstrip()
    follows = f", as a function of {place.function}" if place.function else ""
    return f"{at}{follows} ({in_favour(place.log_odds)} against no such place)"


def verdict_words(diagnosis: Diagnosis) -> str:
    """Return the verdict in one line."""
    names = [cause.name for cause in diagnosis.causes]
    if diagnosis.verdict is Verdict.EXPLAINED:
        return f"EXPLAINED by {' and '.join(names) or 'the readings that were refused'}"
    if diagnosis.verdict is Verdict.AMBIGUOUS:
        return f"AMBIGUOUS: {choices(diagnosis.groups)}"
    if diagnosis.verdict is Verdict.UNEXPLAINED:
        place = diagnosis.place
        where = f": it acts at {place.place} {place.target}".rstrip() if place else ""
        partial = f"; partial, not to be trusted: {', '.join(names)}" if names else ""
        return f"UNEXPLAINED{where}{partial}"
    return "NOTHING WRONG beyond noise and healthy tolerances"


def limit_words(diagnosis: Diagnosis) -> str:
    """Return what is left, beside its limit: the chance of all rows together or of the worst."""
    misfit = diagnosis.misfit
    limit = MISFIT_P if diagnosis.causes or diagnosis.findings else HEALTHY_P
    sign = ">=" if misfit.chance >= limit else "<"
    what = "left" if diagnosis.causes else "misfit"
    row = f" (worst: {misfit.row})" if misfit.row else ""
    return (
        f"{what}: chi2 {misfit.chi2:.1f} for {misfit.dof} degrees of freedom{row}, "
        f"p = {misfit.chance:.2g} {sign} {limit:g}"
    )


def scale_texts(diagnosis: Diagnosis) -> list[str]:
    """Return which stated tolerances or noise the readings contradict, equal factors together."""
    families: dict[str, list[str]] = {}
    for family, factor in diagnosis.scales.items():
        families.setdefault(f"{factor:.3g}", []).append(family)
    return [
        f"spread looks {factor} times as large as stated: {_some(names)}"
        for factor, names in families.items()
    ]


def _some(names: list[str]) -> str:
    more = f" and {len(names) - _NAMES_SHOWN} more" if len(names) > _NAMES_SHOWN else ""
    return ", ".join(names[:_NAMES_SHOWN]) + more


def blind_texts(blind: Iterable[str]) -> list[str]:
    """Join ``effect@target`` by effect: ``joint_offset (l_elbow, r_elbow and 3 more)``."""
    targets: dict[str, list[str]] = {}
    for name in blind:
        effect, _, target = name.partition("@")
        targets.setdefault(effect, [])
        if target:
            targets[effect].append(target)
    found: list[str] = []
    for effect, at in targets.items():
        found.append(f"{effect} ({_some(at)})" if at else effect)
    return found
