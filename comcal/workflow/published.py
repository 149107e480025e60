# SPDX-License-Identifier: Apache-2.0
"""``comcal solve --as-published``: what Muscolo et al. (2017) would have made of a session.

Finds the poses a, b and c of the paper among those of the session, and computes the link CoMs with
each of the paper's faults alone, with all together, and with none.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from comcal.errors import ComcalError, RankError
from comcal.measure.plan import DOUBLE
from comcal.measure.table import PoseTable
from comcal.robot.model import Robot
from comcal.robot.tree import Array
from comcal.statics.published import PlanarPose, PublishedResult, published_route
from comcal.statics.published_chain import LinkComs, PublishedChain
from comcal.statics.published_faults import AS_PUBLISHED, CORRECTED, Fault
from comcal.statics.published_links import force_rows
from comcal.statics.published_session import ANKLE, KNEE, PlanarSession, planar_session
from comcal.statics.support import carrier_of

SAME_ANGLE = np.deg2rad(0.5)
"""Angles that differ by less are one angle [rad]."""
MIN_ANGLE = np.deg2rad(3.0)
"""Smallest tilt or bend that is worth a comparison [rad]."""


@dataclass(frozen=True)
class PublishedVariant:
    """The link CoMs under some of the paper's faults.

    Parameters
    ----------
    faults : Fault
    factor : float
        Sign of M_2 (+1 or -1); +1 where M_2 does not enter.
    result : PublishedResult or None
    reason : str
        Why there is no result; empty if there is one.
    """

    faults: Fault
    factor: float
    result: PublishedResult | None
    reason: str = ""


@dataclass(frozen=True)
class PublishedComparison:
    """A session by the paper's formulas.

    Parameters
    ----------
    poses : tuple of int
        Pose ids of a, b, c and, where the session has it, of c tilted as a whole.
    inputs : tuple of PlanarPose
        What they contribute, in the same order.
    chain : PublishedChain
        Masses and lengths from the URDF, carried part only.
    nominal : LinkComs
        What the URDF says about the links.
    rank : int
        Of the force equations of a, b and c, for 4 unknowns (fault E4).
    variants : tuple of PublishedVariant
        No fault first, then each fault alone, then all printed formulas together.
    notes : tuple of str
        Where the session's poses differ from the paper's, in words.
    """

    poses: tuple[int, ...]
    inputs: tuple[PlanarPose, ...]
    chain: PublishedChain
    nominal: LinkComs
    rank: int
    variants: tuple[PublishedVariant, ...]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class NotComparable:
    """Why the paper's formulas cannot be applied to a session, in words."""

    reason: str


def published_comparison(robot: Robot, table: PoseTable) -> PublishedComparison | NotComparable:
    """Apply the paper's own formulas to a session, if it holds the paper's poses.

    Parameters
    ----------
    robot : Robot
    table : PoseTable

    Returns
    -------
    PublishedComparison or NotComparable
        Never raises for what a session may lack; a comparison is no reason to stop.
    """
    rows = np.flatnonzero([support == DOUBLE for support in table.support])
    if rows.size == 0:
        return NotComparable("no pose in double support, and the paper's robot stands on two feet")
    try:
        carrier = carrier_of(robot, DOUBLE)
        part = table.select(rows)
        session = planar_session(robot, carrier, part)
        chosen = _choose(session, part.q)
    except ComcalError as error:
        return NotComparable(error.what)
    inputs = tuple(session.pose(i) for i in chosen)
    chain, nominal = session.chain(chosen[0])
    a, b, c = inputs[:3]
    rows_of = force_rows(
        [[p.shin, p.thigh] for p in (a, b, c)], [chain.m_b, chain.m_c], [a.beta, b.beta, c.beta]
    )
    return PublishedComparison(
        poses=tuple(part.pose[i] for i in chosen),
        inputs=inputs,
        chain=chain,
        nominal=nominal,
        rank=int(np.linalg.matrix_rank(rows_of)),
        variants=tuple(_variant(inputs, chain, *which) for which in _asked()),
        notes=_notes(inputs),
    )


def _asked() -> list[tuple[Fault, float]]:
    """Return which faults to show, with the sign of M_2 both ways where it enters."""
    return [
        (faults, factor)
        for faults in (CORRECTED, *Fault, AS_PUBLISHED)
        for factor in ((1.0, -1.0) if Fault.INTERNAL_TORQUES in faults else (1.0,))
    ]


def _variant(
    inputs: tuple[PlanarPose, ...], chain: PublishedChain, faults: Fault, factor: float
) -> PublishedVariant:
    a, b, c = inputs[:3]
    if Fault.INTERNAL_TORQUES in faults and not all(np.isfinite(p.internal) for p in inputs):
        return PublishedVariant(
            faults, factor, None, "the session has not the torque of all joints"
        )
    try:
        result = published_route(
            a,
            b,
            c,
            chain,
            c_tilted=inputs[3] if len(inputs) > 3 else None,
            faults=faults,
            factor=factor,
        )
    except RankError as error:
        return PublishedVariant(faults, factor, None, str(error))
    return PublishedVariant(faults, factor, result)


def _choose(session: PlanarSession, q: Array) -> tuple[int, ...]:
    """Return the rows of a, b, c and, if there is one, of the tilted twin of c.

    Among several complete sets, a and the shin of c are the most upright ones, as the paper has
    them, and the tilts are the largest.

    Raises
    ------
    RankError
        Naming which of the poses is missing.
    """
    usable = session.planar & np.isfinite(session.plain.alpha)
    straight = usable & (np.abs(session.thigh - session.shin) < SAME_ANGLE)
    if not straight.any():
        raise RankError("no planar pose with straight legs (the paper's a)")
    sets = [_around(a, session, q, usable) for a in _ranked(straight, np.abs(session.shin))]
    best = max(sets, key=len)
    if len(best) == 1:
        raise RankError(
            "no second pose with straight legs and the same trunk, tilted about the ankles "
            "(the paper's b)"
        )
    if len(best) == 2:
        raise RankError("no pose in which thigh and trunk are bent as one link (the paper's c)")
    return best


def _around(
    a: int, session: PlanarSession, q: Array, usable: npt.NDArray[np.bool_]
) -> tuple[int, ...]:
    """Return the rows of a, b, c and the twin of c as far as the session has them."""
    shin, bend = session.shin, session.thigh - session.shin
    alike = usable & _same_above(session, q, a)
    tilt = np.abs(shin - shin[a])
    found = [a]
    for wanted, keys in (
        ((np.abs(bend) < SAME_ANGLE) & (tilt > MIN_ANGLE), [-tilt]),
        (np.abs(bend) > MIN_ANGLE, [np.abs(shin), -np.abs(bend)]),
    ):
        rows = _ranked(alike & wanted, *keys)
        if not rows:
            return tuple(found)
        found.append(rows[0])
    c = found[-1]
    tilt = np.abs(shin - shin[c])
    twins = alike & (np.abs(bend - bend[c]) < SAME_ANGLE) & (tilt > MIN_ANGLE)
    return (*found, *_ranked(twins, -tilt)[:1])


def _ranked(among: npt.NDArray[np.bool_], *keys: Array) -> list[int]:
    """Return rows with the smallest keys first; equal ones in the order of the session."""
    rows = np.flatnonzero(among)
    # Angles that only noise tells apart are equal.
    rounded = [np.round(key[rows] / SAME_ANGLE) for key in keys]
    return [int(row) for row in rows[np.lexsort(rounded[::-1])]]


def _same_above(session: PlanarSession, q: Array, a: int) -> npt.NDArray[np.bool_]:
    """Return in which poses no joint but ankles and knees differs from pose *a*."""
    tree = session.robot.tree
    free = {
        tree.joints[j].name for leg in session.legs for j in (leg.joints[ANKLE], leg.joints[KNEE])
    }
    others = [k for k, name in enumerate(tree.joint_names) if name not in free]
    return (np.abs(q[:, others] - q[a, others]) < SAME_ANGLE).all(axis=1)


def _notes(inputs: tuple[PlanarPose, ...]) -> tuple[str, ...]:
    a, _, c = inputs[:3]
    notes: list[str] = []
    if max(abs(a.shin), abs(c.shin)) > SAME_ANGLE:
        notes.append(
            "the shins are not upright in poses a and c, as the paper has them: "
            f"its equations are written with their tilts, {np.rad2deg(a.shin):.1f} and "
            f"{np.rad2deg(c.shin):.1f} deg"
        )
    if len(inputs) < 4:
        notes.append("pose c has no tilted twin: without fault E3 its height stays unknown")
    return tuple(notes)
