# SPDX-License-Identifier: Apache-2.0
"""Which causes explain the residuals: forward and backward, with swaps, a few at most."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtrc

from comcal.diagnose.contacts import (
    Contact,
    contacts,
    links_that_touch,
    touches_count,
    with_contact,
)
from comcal.diagnose.diagnosis import Rung
from comcal.diagnose.evidence import Explanation, all_log_odds, explain
from comcal.diagnose.refit import LARGE_BESIDE, refitted
from comcal.diagnose.scene import Scene

MARGIN = 3.0
"""Log odds beyond those that chance gives the best of N causes: 20 to 1."""
MOST_CAUSES = 3
MOST_CONTACTS = 6
SURE = 1000.0
"""Log odds from which a cause is needed, whatever was linearised about what."""
HOPELESS = 1e-6
"""Chance of what is left, below which nothing named can be trusted, needed or not."""
MOST_ROUNDS = 12
"""Adding and dropping may go in circles."""
SHOWN = 8


@dataclass(frozen=True)
class Named:
    """The causes that were found.

    Parameters
    ----------
    causes : tuple of int
        Numbers in the catalogue.
    scene : Scene
        About these causes.
    fit : Explanation
        Of all of them at once.
    ladder : tuple of Rung
    threshold : float
    """

    causes: tuple[int, ...]
    scene: Scene
    fit: Explanation
    ladder: tuple[Rung, ...]
    threshold: float


def threshold_of(n: int) -> float:
    """Return the log odds that the best of *n* causes must reach.

    Every touch of a link in a pose counts as one, though their prior is less: a healthy robot is
    the rule, and what is said of it by mistake costs more than a cause that is too small to name.
    """
    return MARGIN + float(np.log(max(n, 1)))


def name_causes(about: Scene, most: int = MOST_CAUSES) -> Named:
    """Name the causes that the residuals of a scene need.

    Parameters
    ----------
    about : Scene
    most : int
        Number of causes beyond which nothing is explained any more.

    Notes
    -----
    Several hands that touch something are together well imitated by a sensor's crosstalk, which has
    more parameters than each of them. Where causes leave what cannot be chance, contacts are looked
    for before anything else, and the better explanation is kept.
    """
    found = _searched(about, most, touches_first=False)
    if not touches_count(about) or not _hopeless(found.scene, found.causes):
        return found
    other = _searched(about, most, touches_first=True)
    if len(other.scene.r) != len(found.scene.r):  # evidences of other readings do not compare
        return found
    return max((found, other), key=_worth)


def about_causes(named: Named) -> Named:
    """Return the same causes, with what is healthy beside them linearised about them.

    A healthy percent of a motor's torque constant is a percent of a large offset of its current
    too: of what noise alone would let be known well, it is soon the larger error.
    """
    if not named.causes:
        return named
    here, fit = refitted(named.scene, named.causes, LARGE_BESIDE)
    if not np.isfinite(fit.log_odds):
        return named
    kept = _pruned(here, named.causes, named.threshold)
    if kept == named.causes:
        return replace(named, scene=here, fit=fit)
    here, fit = refitted(here, kept, LARGE_BESIDE)
    odds = all_log_odds(here.of, here.against(kept))
    odds[list(kept)] = -np.inf
    last = _rung(here, kept, fit, odds, named.threshold)
    return replace(named, causes=kept, scene=here, fit=fit, ladder=(*named.ladder, last))


def _hopeless(here: Scene, causes: tuple[int, ...]) -> bool:
    """Whether what is left cannot be chance."""
    left = here.against(causes)
    return bool(chdtrc(max(left.rows, 1), left.rr) < HOPELESS)


def _worth(named: Named) -> float:
    """Return the log evidence of the causes, less what each must bring."""
    return named.scene.log_evidence(named.causes) - len(named.causes) * named.threshold


def _searched(about: Scene, most: int, *, touches_first: bool) -> Named:
    """Name causes, forward and backward."""
    threshold = threshold_of(
        len(about.of.candidates) + len(links_that_touch(about)) * len(about.at.table)
    )
    causes: tuple[int, ...] = ()
    here, fit = about, Explanation(0.0, np.zeros(0), np.zeros((0, 0)))
    ladder: list[Rung] = []
    seen: set[frozenset[str]] = set()
    impossible: set[int] = set()
    for _ in range(MOST_ROUNDS):
        odds = all_log_odds(about.of, here.against(causes))
        odds[[*causes, *impossible]] = -np.inf
        ladder.append(_rung(here, causes, fit, odds, threshold))
        best = int(np.argmax(odds)) if len(odds) else -1
        touch = _contact(here, causes)
        least = threshold if touches_first else max(odds.max(initial=-np.inf), threshold)
        if touch is not None and touch.log_odds > least:
            about, here = with_contact(about, touch), with_contact(here, touch)
            best = len(about.of.candidates) - 1
        elif best < 0 or odds[best] <= threshold or _lasting(about, causes) >= most:
            kept = _needed(about, here, causes, threshold)
            if kept == causes or _names(about, kept) in seen:
                break
            seen.add(_names(about, kept))
            here, fit = refitted(about, kept)
            causes = kept
            continue
        grown = _swapped(here, _pruned(here, (*causes, best), threshold))
        about, here, grown = _on_other_links(about, here, grown)
        if _names(about, grown) in seen:
            break
        seen.add(_names(about, grown))
        # What is linear about causes that stayed is better than what is linear about none.
        before = here, fit
        here, fit = refitted(here if set(causes) <= set(grown) else about, grown)
        if not np.isfinite(fit.log_odds):  # together they would need a negative mass or spring
            impossible.add(best)
            here, fit = before
            continue
        causes = _pruned(here, grown, threshold)
        if causes != grown:
            here, fit = refitted(about, causes)
    return Named(causes, here, fit, tuple(ladder), threshold)


def _lasting(about: Scene, causes: tuple[int, ...]) -> int:
    """Return how many causes act in all poses."""
    return sum(about.of.candidates[i].poses is None for i in causes)


def _contact(about: Scene, causes: tuple[int, ...]) -> Contact | None:
    """Return the likeliest contact in a pose that has none yet, if contacts are looked for."""
    if not touches_count(about):
        return None
    taken = {about.of.candidates[i].poses for i in causes} - {None}
    if len(taken) >= MOST_CONTACTS:
        return None
    poses = about.at.table.pose
    free = [c for c in contacts(about, causes) if (poses[c.pose],) not in taken]
    return _of_likelier_link(about, causes, free) if free else None


def _of_likelier_link(about: Scene, causes: tuple[int, ...], found: list[Contact]) -> Contact:
    """Return the best of some contacts, or one as good of a hand that touched elsewhere as well."""
    links, candidates = about.at.assumed.robot.tree.links, about.of.candidates
    before = {candidates[i].target for i in causes if candidates[i].poses}
    again = [c for c in found if c.pose == found[0].pose and links[c.link].name in before]
    close = [c for c in again if c.log_odds > found[0].log_odds - MARGIN]
    return close[0] if close else found[0]


def _on_other_links(
    about: Scene, here: Scene, causes: tuple[int, ...]
) -> tuple[Scene, Scene, tuple[int, ...]]:
    """Let contacts be on other links, now that those in other poses are known.

    Before, what a hand does in another pose was blamed on the springs and motors between the links
    of this one.
    """
    touching = [i for i in causes if about.of.candidates[i].poses is not None]
    if len(touching) < 2:
        return about, here, causes
    for i in touching:
        candidate, others = about.of.candidates[i], _without(causes, i)
        poses = here.at.table.pose
        found = [c for c in contacts(here, others) if (poses[c.pose],) == candidate.poses]
        best = _of_likelier_link(here, others, found)
        if here.at.assumed.robot.tree.links[best.link].name != candidate.target:
            about, here = with_contact(about, best), with_contact(here, best)
            causes = tuple(len(about.of.candidates) - 1 if c == i else c for c in causes)
    return about, here, causes


def _pruned(about: Scene, causes: tuple[int, ...], threshold: float) -> tuple[int, ...]:
    """Drop causes that the others made needless, the least needed first."""
    while len(causes) > 1:
        odds = [explain(about.of, i, about.against(_without(causes, i))).log_odds for i in causes]
        worst = int(np.argmin(odds))
        if odds[worst] > threshold:
            break
        causes = _without(causes, causes[worst])
    return causes


def _needed(
    about: Scene, here: Scene, causes: tuple[int, ...], threshold: float
) -> tuple[int, ...]:
    """Drop the cause without which the others, fitted anew from the beginning, do about as well.

    What was named while larger causes were still unknown may only be needed in a linearisation
    about itself.
    """
    if len(causes) < 2 or _hopeless(here, causes):
        return causes
    with_all, best = here.log_evidence(causes), causes
    least = threshold
    for i in causes:
        others = _without(causes, i)
        if explain(about.of, i, here.against(others)).log_odds > SURE:
            continue
        there, fit = refitted(about, others)
        if len(there.r) == len(here.r) and np.isfinite(fit.log_odds):
            lost = with_all - there.log_evidence(others)
            if lost < least:
                least, best = lost, others
    return best


def _names(about: Scene, causes: tuple[int, ...]) -> frozenset[str]:
    """Return what does not change when a contact is found once more."""
    return frozenset(about.of.candidates[i].name for i in causes)


def _swapped(about: Scene, causes: tuple[int, ...]) -> tuple[int, ...]:
    """Replace causes, one at a time, by better ones in the company of the others."""
    for i in causes:
        others = _without(causes, i)
        odds = all_log_odds(about.of, about.against(others))
        odds[list(others)] = -np.inf
        best = int(np.argmax(odds))
        if odds[best] > odds[i]:
            causes = tuple(best if c == i else c for c in causes)
    return causes


def _without(causes: tuple[int, ...], i: int) -> tuple[int, ...]:
    return tuple(c for c in causes if c != i)


def _rung(
    about: Scene, causes: tuple[int, ...], fit: Explanation, odds: np.ndarray, threshold: float
) -> Rung:
    names = [candidate.name for candidate in about.of.candidates]
    order = [int(i) for i in np.argsort(-odds)[:SHOWN] if np.isfinite(odds[i])]
    against = about.against()
    chi2 = against.rr
    if causes:
        at = np.concatenate(
            [np.arange(about.of.slices[i].start, about.of.slices[i].stop) for i in causes]
        )
        x = fit.coordinates
        chi2 += float(x @ against.K[np.ix_(at, at)] @ x - 2.0 * against.b[at] @ x)
    return Rung(
        tuple(names[i] for i in causes),
        tuple((names[i], float(odds[i])) for i in order),
        threshold,
        chi2,
    )
