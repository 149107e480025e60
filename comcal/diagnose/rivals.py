# SPDX-License-Identifier: Apache-2.0
"""Other causes that would explain as much: how likely they are, and what they would leave."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import chdtrc, ndtri

from comcal.diagnose.contacts import EFFECT, Contact, contacts, touches_count, with_contact
from comcal.diagnose.diagnosis import Rival
from comcal.diagnose.evidence import all_log_odds, explained
from comcal.diagnose.metric import Metric
from comcal.diagnose.naming import Named
from comcal.diagnose.scene import Scene
from comcal.robot.changes import Change
from comcal.robot.tree import Array

UNDECIDED = 3.0
"""Log odds below which a rival cannot be excluded: 20 to 1."""
UNSEEN = 3.0
"""What a rival leaves, in sigmas, that noise may hide: then evidence, which counts simplicity, does
not exclude it. Of a cause with several parameters noise hides more, having a part in each."""
DISPROVED = 6.0
"""What chi2 is larger by than that of another place of the same effect: 20 to 1 as well."""
WIDE = 3.0
"""Faults up to which the parameters of a rival may go."""
BY_CHANCE = 0.05
"""Probability of a gain, below which the more general cause is listed beside the special one."""
SHOWN = 5
GENERAL = {
    "payload": {"link_mass", "link_com"},
    "tether": {"cable_pull", "external_contact"},
    "ft_crosstalk": {"ft_mounting", "ft_position", "ft_gain"},
}
"""Effects that hold others as special cases: no rivals of theirs by what they leave: nothing,
by their nature."""


def own_coordinates(named: Named, i: int) -> Array:
    """Return the coordinates of one cause out of the fit of all."""
    first = 0
    for cause in named.causes:
        k = len(named.scene.of.candidates[cause].keys)
        if cause == i:
            return named.fit.coordinates[first : first + k]
        first += k
    raise KeyError(i)


def size_of(named: Named, i: int) -> float:
    """Return the norm of a cause's effect against noise and healthy spread, in sigmas."""
    part = named.scene.of.slices[i]
    x = own_coordinates(named, i)
    return float(np.sqrt(max(x @ named.scene.against().K[part, part] @ x, 0.0)))


def rivals_of(named: Named, i: int) -> tuple[tuple[Rival, ...], float]:
    """Return the strongest other causes in the place of *i*, and the log odds of *i* itself.

    All those that cannot be excluded are listed, and a few more.
    """
    scene = named.scene
    others = tuple(c for c in named.causes if c != i)
    against = scene.against(others)
    odds = all_log_odds(scene.of, against)
    own = float(odds[i])
    x = own_coordinates(named, i)
    size = size_of(named, i)
    mine = scene.of.candidates[i]
    found: list[Rival] = []
    for c in np.argsort(-odds).tolist():
        candidate = scene.of.candidates[c]
        # Contacts in single poses that were tried on the way are weighed with all others below.
        if c in named.causes or candidate.poses is not None or not np.isfinite(odds[c]):
            continue
        left = left_by(scene, against, x, i, c)
        sigmas = in_sigmas(left * size, len(x))
        better = candidate.target == mine.target and _fits_better(scene, against, i, c)
        close = own - odds[c] < UNDECIDED or sigmas < UNSEEN or better
        if len(found) >= SHOWN and not close:
            continue
        rival = Rival(
            candidate.effect.name,
            candidate.target,
            own - float(odds[c]),
            left,
            sigmas,
            better,
            _explained_chi2(scene, against, i) - _explained_chi2(scene, against, c),
        )
        found.append(rival)
    poses = mine.poses
    if poses is not None:
        found += _elsewhere(named, i, others, own, poses)
    else:
        found += _in_one_pose(named, i, others, own)
    return tuple(sorted(found, key=lambda rival: rival.log_odds)), own


def _elsewhere(
    named: Named, i: int, others: tuple[int, ...], own: float, poses: tuple[int, ...]
) -> list[Rival]:
    """Return other links that could have touched something in the same pose."""
    scene = named.scene
    tree = scene.at.assumed.robot.tree
    mine = scene.of.candidates[i]
    same = [
        contact
        for contact in contacts(scene, others)
        if scene.at.table.pose[contact.pose] in poses
        and tree.links[contact.link].name != mine.target
    ]
    near = [c for k, c in enumerate(same) if k < SHOWN or own - c.log_odds < UNDECIDED]
    return [_touch(named, i, others, own, contact) for contact in near]


def _in_one_pose(named: Named, i: int, others: tuple[int, ...], own: float) -> list[Rival]:
    """Return the contact in one pose that could be all there is, if it cannot be excluded.

    Such as where only one pose stretches a spring.
    """
    if not touches_count(named.scene):
        return []
    free = [c for c in contacts(named.scene, others) if own - c.log_odds < UNDECIDED]
    return [_touch(named, i, others, own, contact) for contact in free[:1]]


def _touch(named: Named, i: int, others: tuple[int, ...], own: float, contact: Contact) -> Rival:
    """Return a contact in one pose as a rival of cause *i*."""
    there = with_contact(named.scene, contact)
    against, c = there.against(others), len(there.of.candidates) - 1
    x = own_coordinates(named, i)
    left = left_by(there, against, x, i, c)
    return Rival(
        EFFECT,
        there.at.assumed.robot.tree.links[contact.link].name,
        own - contact.log_odds,
        left,
        in_sigmas(left * size_of(named, i), len(x)),
        chi2_more=_explained_chi2(there, against, i) - _explained_chi2(there, against, c),
        poses=(there.at.table.pose[contact.pose],),
    )


def left_by(scene: Scene, against: Metric, x: Array, i: int, rival: int) -> float:
    """Return what the best fit of a rival leaves of a cause, as a share of its norm."""
    a, b = scene.of.slices[i], scene.of.slices[rival]
    v = against.K[:, a] @ x
    total = float(x @ v[a])
    if total <= 0.0:
        return 0.0
    F = scene.of.fault[b]
    M = F[:, None] * against.K[b, b] * F
    M[np.diag_indices_from(M)] += WIDE**-2
    taken = float((F * v[b]) @ np.linalg.solve(M, F * v[b]))
    return float(np.sqrt(max(total - taken, 0.0) / total))


def in_sigmas(norm: float, k: int) -> float:
    """Return the deviation of one normal number that is as rare as this norm of *k* of them."""
    return float(-ndtri(0.5 * chdtrc(k, norm**2)))


def _fits_better(scene: Scene, against: Metric, i: int, rival: int) -> bool:
    """Whether a cause that holds *i* as a special case lowers chi2 by more than chance would."""
    of = scene.of
    mine, other = of.candidates[i].effect.name, of.candidates[rival].effect.name
    more = len(of.candidates[rival].keys) - len(of.candidates[i].keys)
    if not _is_general(other, mine) or more <= 0:
        return False
    gain = _explained_chi2(scene, against, rival) - _explained_chi2(scene, against, i)
    return float(chdtrc(more, max(gain, 0.0))) < BY_CHANCE


def _explained_chi2(scene: Scene, against: Metric, i: int) -> float:
    """Return by how much a cause lowers chi2, with parameters as far as rivals may go."""
    of, part = scene.of, scene.of.slices[i]
    K, b = against.K[part, part], against.b[part]
    x = explained(K, b, WIDE * of.fault[part], of.positive[part], of.required[part]).coordinates
    return float(2.0 * b @ x - x @ K @ x)


def _is_general(other: str, effect: str) -> bool:
    """Whether an effect holds another one as a special case."""
    return effect in GENERAL.get(other, set())


def undecided(change: Change, rivals: Sequence[Rival]) -> tuple[Rival, ...]:
    """Return the rivals of a cause that cannot be excluded, the likeliest of each other kind first.

    Where noise can hide what a rival leaves, evidence speaks for the simpler effect more than for
    the likelier, so it excludes no effect. Among such places of one effect the fit decides.

    Parameters
    ----------
    change : Change
        The cause named.
    rivals : sequence of Rival
        Strongest first.
    """
    mine = change.effect, bool(change.poses())
    unseen = [
        rival
        for rival in rivals
        if rival.left_sigmas < UNSEEN and not _is_general(rival.effect, change.effect)
    ]
    least = {mine: 0.0}
    for rival in unseen:
        least[_kind(rival)] = min(rival.chi2_more, least.get(_kind(rival), rival.chi2_more))
    close = [
        rival
        for rival in rivals
        if rival.log_odds < UNDECIDED
        or rival.fits_better
        or (rival in unseen and rival.chi2_more - least[_kind(rival)] < DISPROVED)
    ]
    best = {_kind(rival): rival for rival in reversed(close)}
    first = [rival for kind, rival in best.items() if kind != mine]
    others = [rival for rival in close if rival not in first]
    return (*(rival for rival in close if rival in first), *others)


def _kind(rival: Rival) -> tuple[str, bool]:
    """Return what has as many parameters everywhere: a touch in one pose is no lasting force."""
    return rival.effect, bool(rival.poses)
