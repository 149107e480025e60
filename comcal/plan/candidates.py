# SPDX-License-Identifier: Apache-2.0
"""Random poses that a robot can stand in: the candidates from which a plan is chosen."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from comcal.errors import NotBalancedError
from comcal.plan.rules import REASONS, Rules
from comcal.plan.settle import com_of, settle
from comcal.robot.kinematics import place_links
from comcal.robot.tree import Array

BATCH, LEAST_BATCH = 4000, 1000
"""Random postures worked on together, at most and at least ..."""
TRIES = 100
"""... and about how many it takes to find one that stands."""
MOST_TRIES = 20_000
"""Random postures tried for every pose wanted, before a support is given up; ..."""
HOPELESS = 20_000
"""... and while none at all has been found."""
COLLISION = "collision"
EXTREME = 0.5
"""Share of the candidates whose joints prefer the ends of their ranges: bent joints tell most."""

Progress = Callable[[str, int, int], None]
"""Called with what is being done, how much of it is done, and how much there is to do."""


def silent(what: str, done: int, total: int) -> None:
    """Show nothing."""


@dataclass(frozen=True)
class Pool:
    """Poses by support.

    Parameters
    ----------
    support : tuple of str, length N
    q : array, shape (N, n_joints)
    refused : mapping from reason to int
        How many random postures were refused, and why.
    """

    support: tuple[str, ...]
    q: Array
    refused: Mapping[str, int] = field(default_factory=dict[str, int])

    def __len__(self) -> int:
        return len(self.support)

    def select(self, rows: Sequence[int] | Array) -> Pool:
        """Return some poses, in the order of *rows*."""
        at = [int(i) for i in rows]
        return Pool(tuple(self.support[i] for i in at), self.q[at], self.refused)

    def joined(self, other: Pool) -> Pool:
        """Return these poses, then those of *other*."""
        refused = Counter(self.refused) + Counter(other.refused)
        return Pool(self.support + other.support, np.concatenate([self.q, other.q]), dict(refused))


def random_pool(
    rules: Rules,
    each: int,
    rng: np.random.Generator,
    progress: Progress = silent,
    *,
    uniform: bool = False,
    most_tries: int | None = None,
) -> Pool:
    """Draw balanced poses, *each* of every support.

    Parameters
    ----------
    rules : Rules
    each : int
    rng : Generator
    progress : callable
    uniform : bool
        Draw every joint uniformly and take the poses that happen to be balanced, instead of
        bringing the CoM over the soles. A double support is closed all the same.
    most_tries : int, optional
        Random postures in every support; by default ``MOST_TRIES`` for every pose wanted.

    Raises
    ------
    NotBalancedError
        If no pose was found in some support.
    """
    pool = Pool((), np.zeros((0, len(rules.box.lower))))
    for support in rules.stands:
        found, refused = list[Array](), Counter[str]()
        count = tried = 0
        most = most_tries or MOST_TRIES * each
        while count < each and tried < (most if count else min(most, HOPELESS)):
            size = int(np.clip(TRIES * (each - count), LEAST_BATCH, BATCH))
            q = _random_postures(rules, size, rng, uniform=uniform)
            tried += len(q)
            if not uniform:
                q = _not_touching_yet(rules, support, q, refused)
            good = _standing(rules, support, q, rng, refused, uniform=uniform)
            found.append(good)
            count += len(good)
            progress(f"candidates, {support}", min(count, each), each)
        if not count:
            raise NotBalancedError(
                f"no pose was found that stands in support {support!r}",
                where=f"{tried} random postures",
                measured=", ".join(f"{reason}: {n}" for reason, n in refused.most_common()),
                next_step="give a smaller --margin or a larger --range, or check soles, limits and "
                "efforts with `comcal check`",
            )
        q = np.concatenate(found)[:each]
        pool = pool.joined(Pool((support,) * len(q), q, dict(refused)))
    return pool


def neighbours(
    rules: Rules, poses: Pool, each: int, reach: float, rng: np.random.Generator
) -> Pool:
    """Draw poses around given ones, about *each* around every pose.

    Parameters
    ----------
    rules : Rules
    poses : Pool
    each : int
        Tries; fewer stand.
    reach : float
        Typical move of a joint, as a share of its range.
    rng : Generator
    """
    near = Pool((), np.zeros((0, len(rules.box.lower))))
    for support in rules.stands:
        own = poses.q[[s == support for s in poses.support]]
        if not len(own):
            continue
        start = np.repeat(own, each, axis=0)
        # Few joints at a time: a good pose is good in most of them.
        moved = rng.random(start.shape) < rng.uniform(0.05, 0.7, (len(start), 1))
        q = start + moved * reach * rules.box.range * rng.standard_normal(start.shape)
        refused = Counter[str]()
        good = _standing(rules, support, q, rng, refused)
        near = near.joined(Pool((support,) * len(good), good, dict(refused)))
    return near


def _not_touching_yet(rules: Rules, support: str, q: Array, refused: Counter[str]) -> Array:
    """Return the postures that are worth settling.

    Settling moves little, so what touches before would mostly touch afterwards. The legs of a
    double support are moved a lot: they are not asked.
    """
    stand = rules.stands[support]
    watched = rules.collisions.without(stand.closing_links())
    free = watched.free(place_links(rules.robot.tree, q))
    refused[COLLISION] += int(np.sum(~free))
    return q[free]


def _random_postures(rules: Rules, size: int, rng: np.random.Generator, *, uniform: bool) -> Array:
    shape = (size, len(rules.box.lower))
    share = rng.random(shape)
    if not uniform:
        share = np.where(rng.random((size, 1)) < EXTREME, rng.beta(0.5, 0.5, shape), share)
    return rules.box.lower + share * rules.box.range


def _standing(
    rules: Rules,
    support: str,
    q: Array,
    rng: np.random.Generator,
    refused: Counter[str],
    *,
    uniform: bool = False,
) -> Array:
    """Settle postures and return those that keep every rule."""
    stand = rules.stands[support]
    target = None if uniform else stand.random_points(rng, len(q))
    q, stands = settle(stand, rules.box, q, target)
    q = q[stands]
    if uniform:
        q = q[stand.inside_by(com_of(stand, q)) >= stand.margin]
    refused[REASONS[0]] += len(stands) - len(q)
    broken = rules.broken(support, q)
    refused.update(REASONS[i] for i in broken[broken >= 0])
    return q[broken < 0]
