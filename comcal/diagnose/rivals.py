# SPDX-License-Identifier: Apache-2.0
"""Other causes that would explain as much: how likely they are, and what they would leave."""

from __future__ import annotations

import numpy as np

from comcal.diagnose.contacts import contacts
from comcal.diagnose.diagnosis import Rival
from comcal.diagnose.evidence import all_log_odds
from comcal.diagnose.metric import Metric
from comcal.diagnose.naming import Named
from comcal.diagnose.scene import Scene
from comcal.robot.tree import Array

UNDECIDED = 3.0
"""Log odds below which a rival cannot be excluded: 20 to 1."""
SHOWN = 5


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
    found: list[Rival] = []
    poses = scene.of.candidates[i].poses
    for c in np.argsort(-odds):
        # A contact of one pose has no rivals among causes of other single poses.
        if int(c) in named.causes or not np.isfinite(odds[c]):
            continue
        if len(found) >= SHOWN and own - odds[c] >= UNDECIDED:
            break
        candidate = scene.of.candidates[int(c)]
        left = left_by(scene, against, own_coordinates(named, i), i, int(c))
        found.append(Rival(candidate.effect.name, candidate.target, own - float(odds[c]), left))
    if poses is not None:
        found += _elsewhere(named, i, others, own, poses)
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
    return [
        Rival(mine.effect.name, tree.links[c.link].name, own - c.log_odds, 1.0)
        for c in same[:SHOWN]
    ]


def left_by(scene: Scene, against: Metric, x: Array, i: int, rival: int) -> float:
    """Return what the best fit of a rival leaves of a cause, as a share of its norm."""
    a, b = scene.of.slices[i], scene.of.slices[rival]
    v = against.K[:, a] @ x
    total = float(x @ v[a])
    if total <= 0.0:
        return 0.0
    F = scene.of.fault[b]
    M = F[:, None] * against.K[b, b] * F
    # A weak prior, ten faults wide, keeps directions that no reading shows out of it.
    M[np.diag_indices_from(M)] += 0.01
    taken = float((F * v[b]) @ np.linalg.solve(M, F * v[b]))
    return float(np.sqrt(max(total - taken, 0.0) / total))


def undecided(rivals: tuple[Rival, ...]) -> tuple[Rival, ...]:
    """Return those that cannot be excluded."""
    return tuple(rival for rival in rivals if rival.log_odds < UNDECIDED)
