# SPDX-License-Identifier: Apache-2.0
"""Forces on links in single poses: a hand on a rail.

There are as many of these causes as links times poses, so only the best is ever written out; its
columns are cut to its pose before anything is whitened. In one pose a force somewhere on a link is
any wrench without a part of its couple along it; where it acts follows from both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from comcal.diagnose.candidates import Candidate
from comcal.diagnose.catalogue import Catalogue, catalogue
from comcal.diagnose.scene import Scene
from comcal.effects.registry import effects
from comcal.predict.parity import placed
from comcal.predict.standing import world_axes
from comcal.robot.changes import Change, Value
from comcal.robot.tree import Array

EFFECT = "external_contact"
_FORCE, _POINT = ("force_x", "force_y", "force_z"), ("point_x", "point_y", "point_z")
KEYS = (*_FORCE, "couple_x", "couple_y", "couple_z")
FAULT = np.array([20.0, 20.0, 20.0, 5.0, 5.0, 5.0])
"""Of a contact [N], [N m]."""


@dataclass(frozen=True)
class WrenchInPose(Candidate):
    """A contact in one pose, by its wrench at the link's origin in axes of P.

    Parameters
    ----------
    R_link_P : array, shape (3, 3)
        In that pose.
    """

    R_link_P: Array = field(default_factory=lambda: np.eye(3))

    @property
    def fault(self) -> Array:
        """Size of a fault along each coordinate [N], [N m], shape (6,)."""
        return FAULT

    def change(self, coordinates: Array) -> Change:
        """Return the force, at the point of its line that is nearest to the link's origin."""
        force, couple = coordinates[:3], coordinates[3:]
        square = float(force @ force)
        point = np.cross(force, couple) / square if square else np.zeros(3)
        names = [*_FORCE, *_POINT]
        numbers = [*force.tolist(), *(self.R_link_P @ point).tolist()]
        parameters: dict[str, Value] = dict(zip(names, numbers, strict=True))
        parameters["poses"] = self.poses or ()
        return Change(self.effect.name, self.target, parameters)


@dataclass(frozen=True)
class Contact:
    """One link in one pose.

    Parameters
    ----------
    link, pose : int
        Numbers of the link and of the row of the table.
    log_odds : float
    """

    link: int
    pose: int
    log_odds: float


def links_that_touch(about: Scene) -> tuple[int, ...]:
    """Return the links that could touch something: those with a mass."""
    return tuple(k for k, link in enumerate(about.at.assumed.robot.tree.links) if link.mass > 0.0)


def contacts(about: Scene, causes: Sequence[int]) -> list[Contact]:
    """Return how likely each link touched something in each pose, best first.

    Parameters
    ----------
    about : Scene
    causes : sequence of int
        What may be there beside it.
    """
    links = links_that_touch(about)
    L = about.by.turned(np.concatenate([_wrenches(about, k) for k in links], axis=1))
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
    name, pose = tree.links[contact.link].name, table.pose[contact.pose]
    candidate = WrenchInPose(effects()[EFFECT], name, KEYS, (pose,), _axes(about, contact))
    here = (about.at.at.pose == contact.pose)[:, None]
    raw = -_wrenches(about, contact.link) * here
    one = catalogue([candidate], about.at.assumed.robot)
    return replace(
        about,
        of=_joined(about.of, one),
        centre=np.concatenate([about.centre, np.zeros(len(KEYS))]),
        fitted=np.concatenate([about.fitted, np.full(len(KEYS), np.nan)]),
        raw=np.concatenate([about.raw, raw], axis=1),
        X=np.concatenate([about.X, about.by.turned(raw)], axis=1),
    )


def _wrenches(about: Scene, link: int) -> Array:
    """Return how residuals move per unit of force and couple on a link, shape (n, 6)."""
    links = about.at.links
    return np.concatenate([links.by_force[:, link], links.by_couple[:, link]], axis=1)


def _axes(about: Scene, contact: Contact) -> Array:
    """Return R_link_P of the contact's link in its pose."""
    assumed, table = about.at.assumed, about.at.table.select([contact.pose])
    balance, _, standing = placed(assumed, table, table.support[0])
    hanging = world_axes(balance.direction)[0]
    R_root_P = hanging if standing is None else standing.R_root_P[0]
    return np.asarray(balance.placements.R[0, contact.link].T @ R_root_P, np.float64)


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
