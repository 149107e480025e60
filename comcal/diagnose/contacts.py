# SPDX-License-Identifier: Apache-2.0
"""Forces on links in single poses: a hand on a rail.

There are as many of these causes as links times poses, so only the best is ever written out; its
columns are cut to its pose before anything is whitened. In one pose a force somewhere on a link is
any wrench without a part of its couple along it; where it acts follows from both. A touch of one
link is as likely beforehand as anything else there, and that it was in this pose one of all.

Wrenches count about the link's CoM, which a hand is about as far from as from anything else on the
link. Of a robot that hangs, only torques tell of a touch: about a joint's own axis that would be
a couple without any force, which no hand makes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from comcal.diagnose.candidates import Candidate
from comcal.diagnose.catalogue import Catalogue, catalogue
from comcal.diagnose.linear import Linear
from comcal.diagnose.scene import Scene
from comcal.effects.registry import effects
from comcal.robot.changes import Change, Value
from comcal.robot.frames import cross
from comcal.robot.tree import Array

EFFECT = "external_contact"
_FORCE, _POINT = ("force_x", "force_y", "force_z"), ("point_x", "point_y", "point_z")
KEYS = (*_FORCE, "couple_x", "couple_y", "couple_z")
FAULT = np.array([20.0, 20.0, 20.0, 5.0, 5.0, 5.0])
"""Of a contact [N], [N m]."""
WHERE_ON_ITS_LINE = (
    "of a contact in one pose the force and the line along which it acts are known: its point is "
    "the one of that line nearest to the link's CoM; where on the line it touched, no reading tells"
)


@dataclass(frozen=True)
class WrenchInPose(Candidate):
    """A contact in one pose, by its wrench at the link's CoM in axes of P.

    Parameters
    ----------
    R_link_P : array, shape (3, 3)
        In that pose.
    com : array, shape (3,)
        Of the link [m], in its frame.
    """

    R_link_P: Array = field(default_factory=lambda: np.eye(3))
    com: Array = field(default_factory=lambda: np.zeros(3))

    @property
    def fault(self) -> Array:
        """Size of a fault along each coordinate [N], [N m], shape (6,)."""
        return FAULT

    def change(self, coordinates: Array) -> Change:
        """Return the force, at the point of its line that is nearest to the link's CoM."""
        force, couple = coordinates[:3], coordinates[3:]
        square = float(force @ force)
        point = np.cross(force, couple) / square if square else np.zeros(3)
        names = [*_FORCE, *_POINT]
        numbers = [*force.tolist(), *(self.com + self.R_link_P @ point).tolist()]
        parameters: dict[str, Value] = dict(zip(names, numbers, strict=True))
        parameters["poses"] = self.poses or ()
        return Change(self.effect.name, self.target, parameters)

    def columns(self, at: Linear) -> Array:
        """Return what force and couple add to the residuals, shape (n, 6).

        A couple alone is no contact, so no small step of one would show what it does.
        """
        here = np.isin(at.at.pose, [at.table.pose.index(pose) for pose in self.poses or ()])
        return -_wrenches(at, at.assumed.robot.tree.link_index[self.target]) * here[:, None]


@dataclass(frozen=True)
class Contact:
    """One link in one pose.

    Parameters
    ----------
    link, pose : int
        Numbers of the link and of the row of the table.
    log_odds : float
        With its prior.
    """

    link: int
    pose: int
    log_odds: float


def links_that_touch(about: Scene) -> tuple[int, ...]:
    """Return the links that could touch something: those with a mass."""
    return tuple(k for k, link in enumerate(about.at.assumed.robot.tree.links) if link.mass > 0.0)


def touches_count(about: Scene) -> bool:
    """Return whether contacts are looked for."""
    of = about.of
    return any(
        may_be and candidate.effect.name == EFFECT
        for candidate, may_be in zip(of.candidates, of.open, strict=True)
    )


def contacts(about: Scene, causes: Sequence[int]) -> list[Contact]:
    """Return how likely each link touched something in each pose, best first.

    Parameters
    ----------
    about : Scene
    causes : sequence of int
        What may be there beside it.
    """
    links = links_that_touch(about)
    L = about.by.turned(np.concatenate([_wrenches(about.at, k) for k in links], axis=1))
    spread = about.of.spread(about.scales, causes)
    at = np.flatnonzero(spread)
    T = about.X[:, at] * spread[at]
    M = cho_factor(T.T @ T + np.eye(len(at)), lower=True)
    r = about.r - T @ cho_solve(M, T.T @ about.r)
    found: list[Contact] = []
    of_pose = about.by.pose
    at_links = np.arange(6 * len(links)).reshape(-1, 6)
    for pose in range(len(about.at.table)):
        rows = of_pose == pose
        x, t = L[rows], T[rows]
        tx = t.T @ x
        K = x.T @ x - tx.T @ cho_solve(M, tx)
        odds = log_odds_of(K[at_links[:, :, None], at_links[:, None]], (x.T @ r[rows])[at_links])
        odds += _log_prior(about)
        found += [Contact(k, pose, float(o)) for k, o in zip(links, odds, strict=True)]
    return sorted(found, key=lambda contact: -contact.log_odds)


def log_odds_of(K: Array, b: Array) -> Array:
    """Return the log odds of wrenches, shape (n,), from inner products (n, 6, 6) and (n, 6)."""
    M = FAULT[:, None] * K * FAULT + np.eye(6)
    scaled = FAULT * b
    fit = np.linalg.solve(M, scaled[..., None])[..., 0]
    return np.asarray(0.5 * (np.sum(scaled * fit, axis=1) - np.linalg.slogdet(M)[1]), np.float64)


def with_contact(about: Scene, contact: Contact) -> Scene:
    """Return the scene with a contact as one more candidate, the last one."""
    tree, table = about.at.assumed.robot.tree, about.at.table
    link, pose = tree.links[contact.link], table.pose[contact.pose]
    R_link_P = about.at.links.R_link_P[contact.pose, contact.link]
    candidate = WrenchInPose(
        effects()[EFFECT], link.name, KEYS, (pose,), _log_prior(about), R_link_P, link.com
    )
    raw = candidate.columns(about.at)
    one = catalogue([candidate], about.at.assumed.robot)
    return replace(
        about,
        of=_joined(about.of, one),
        centre=np.concatenate([about.centre, np.zeros(len(KEYS))]),
        fitted=np.concatenate([about.fitted, np.full(len(KEYS), np.nan)]),
        raw=np.concatenate([about.raw, raw], axis=1),
        X=np.concatenate([about.X, about.by.turned(raw)], axis=1),
    )


def _log_prior(about: Scene) -> float:
    return -float(np.log(len(about.at.table)))


def _wrenches(at: Linear, link: int) -> Array:
    """Return how residuals move per unit of force and couple at a link's CoM, shape (n, 6)."""
    links, com = at.links, at.assumed.robot.tree.links[link].com
    by_couple = links.by_couple[:, link]
    lever = np.swapaxes(links.R_link_P[:, link], 1, 2) @ com
    # A force there is one at the origin together with a couple, lever x force.
    by_force = links.by_force[:, link] - cross(lever[at.at.pose], by_couple)
    return np.concatenate([by_force, by_couple], axis=1)


def _joined(a: Catalogue, b: Catalogue) -> Catalogue:
    return Catalogue(
        (*a.candidates, *b.candidates),
        np.concatenate([a.fault, b.fault]),
        np.concatenate([a.healthy, b.healthy]),
        (*a.family, *b.family),
        np.concatenate([a.positive, b.positive]),
        np.concatenate([a.required, b.required]),
        np.concatenate([a.open, b.open]),
    )
