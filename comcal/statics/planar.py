# SPDX-License-Identifier: Apache-2.0
r"""The planar chain behind a set of configurations: which links turn together, and about what.

In complex form, z + j x with j^2 = -1, a segment v that turns by phi about +y contributes
:math:`H_v e^{j\varphi}` to the first moment, H_v being the sum of m_k c_k over its links. Links
that turn alike in all configurations (both shins of a biped whose legs move in parallel) are one
segment: the data show only their sum.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from comcal.errors import RankError
from comcal.robot.kinematics import Placements
from comcal.robot.model import Robot
from comcal.robot.tree import Array
from comcal.statics.configurations import Configuration, pitch_between, placed_in_stance

ComplexArray = npt.NDArray[np.complex128]

SAME_ANGLE = np.deg2rad(1.0)
"""Links whose turns differ by less in every configuration belong to one segment [rad]."""
OUT_OF_PLANE = np.deg2rad(1.0)
"""Largest turn out of the x-z plane of P that still counts as planar [rad]."""


@dataclass(frozen=True)
class Segment:
    """Links that turn together.

    Parameters
    ----------
    links : tuple of int
        Lead link first: the one nearest to the feet.
    anchor : int
        Link whose origin is the joint between the segment and what lies nearer to the feet.
    mass : float
        [kg]
    """

    links: tuple[int, ...]
    anchor: int
    mass: float

    def name(self, robot: Robot) -> str:
        """Return the links' names joined by ``+``; a left and right pair counts as one name."""
        names = [robot.tree.links[k].name for k in self.links]
        short: list[str] = []
        for name in names:
            pair = name.startswith(("l_", "r_")) and {f"l{name[1:]}", f"r{name[1:]}"} <= {*names}
            label = f"l/r{name[1:]}" if pair else name
            if label not in short:
                short.append(label)
        return "+".join(short)


@dataclass(frozen=True)
class PlanarChain:
    """Segments of a robot in the configurations of one session.

    Parameters
    ----------
    counted : array of bool, shape (n_links,)
        What the total CoM speaks of: the carried links, or all links for given CoMs.
    known : array of bool, shape (n_links,)
        Counted links whose CoM comes from CAD: those that do not turn against P.
    straight : array, shape (n_links, 3, 3)
        Link axes in P when all joints are zero.
    """

    robot: Robot
    segments: tuple[Segment, ...]
    counted: npt.NDArray[np.bool_]
    known: npt.NDArray[np.bool_]
    straight: Array


def planar_chain(
    robot: Robot,
    configurations: Sequence[Configuration],
    at: Placements,
    counted: npt.NDArray[np.bool_],
) -> PlanarChain:
    """Find the segments that *configurations* distinguish.

    Parameters
    ----------
    at : Placements, shape (n_configurations, n_links, ...)
        Reference postures in P.
    counted : array of bool, shape (n_links,)
        What the total CoM speaks of.

    Raises
    ------
    RankError
        If a link turns out of the plane, or there are fewer than n + 1 configurations for n
        segments.
    """
    known = counted & configurations[0].foot_side
    body = [int(k) for k in np.flatnonzero(counted & ~known & (robot.tree.masses != 0.0))]
    _refuse_out_of_plane(robot, configurations, at, body)
    pitch = pitch_between(at.R[:1], at.R)
    order, anchor = _walk(robot, configurations[0])
    members: list[list[int]] = []
    for k in (k for k in order if k in body):
        alike = (s for s in members if _turn_apart(pitch[:, k], pitch[:, s[0]]) < SAME_ANGLE)
        segment = next(alike, None)
        if segment is None:
            members.append([k])
        else:
            segment.append(k)
    n = len(members)
    if len(configurations) < n + 1:
        raise RankError(
            f"{len(configurations)} configuration(s) for {n} segment(s): Cramer's rule needs n + 1 "
            "distinct shapes, each with its tilted twin",
            where="configurations " + ", ".join(c.name for c in configurations),
            measured=f"{len(configurations)} shapes",
            limit=f"{n + 1}",
            next_step="record another shape: bend one joint by 30 deg or more, and its twin",
        )
    zero = np.zeros((1, len(robot.tree.joint_names)))
    straight = placed_in_stance(robot, configurations[0].carrier, zero).R[0]
    masses = robot.tree.masses
    segments = tuple(Segment(tuple(s), anchor[s[0]], float(masses[s].sum())) for s in members)
    return PlanarChain(robot, segments, counted, known, straight)


def placed_configurations(
    robot: Robot, configurations: Sequence[Configuration], q: Array
) -> Placements:
    """Return reference postures seen from P, each in its own support.

    Parameters
    ----------
    q : array, shape (..., n_configurations, n_joints)

    Returns
    -------
    Placements, shape (..., n_configurations, n_links, ...)
    """
    shape, n_links = q.shape[:-1], len(robot.tree.links)
    R, p = np.empty((*shape, n_links, 3, 3)), np.empty((*shape, n_links, 3))
    supports = [c.carrier.support for c in configurations]
    for support in set(supports):
        rows = [i for i, s in enumerate(supports) if s == support]
        flat = q[..., rows, :].reshape(-1, q.shape[-1])
        at = placed_in_stance(robot, configurations[rows[0]].carrier, flat)
        R[..., rows, :, :, :] = at.R.reshape(*shape[:-1], len(rows), n_links, 3, 3)
        p[..., rows, :, :] = at.p.reshape(*shape[:-1], len(rows), n_links, 3)
    return Placements(robot.tree, R, p)


def segment_turns(chain: PlanarChain, at: Placements) -> Array:
    """Return each segment's turn against the first configuration, (..., n_conf, n_segments) [rad].

    The mean over the links of a segment, whose encoders are read independently.
    """
    pitch = pitch_between(at.R[..., :1, :, :, :], at.R)
    turns: list[Array] = []
    for segment in chain.segments:
        lead, links = pitch[..., segment.links[0]], pitch[..., list(segment.links)]
        turns.append(lead + np.mean(np.angle(np.exp(1j * (links - lead[..., None]))), axis=-1))
    return np.stack(turns, axis=-1)


def moment_of_coms(
    first_moment: ComplexArray, foot: ComplexArray, masses: Array, origins: ComplexArray
) -> ComplexArray:
    """Return what the CoMs of the segments add to the first moment, z + j x in P, (...) [kg m].

    It only adds and multiplies, so it takes symbols as well.

    Parameters
    ----------
    first_moment : complex array, shape (...)
        Mass times CoM of the counted links [kg m].
    foot : complex array, shape (...)
        First moment of what does not turn [kg m].
    masses : array, shape (n,)
        Of all that turns [kg].
    origins : complex array, shape (..., n)
        Where each of them begins: what its CoM is counted from [m].

    Notes
    -----
    The balance (26) of Muscolo 2017 for any chain, less what is known: the right-hand side of
    E H = K, equation (39) for n = 2.
    """
    return first_moment - foot - np.sum(masses * origins, axis=-1)


def right_hand_side(chain: PlanarChain, at: Placements, first_moment: ComplexArray) -> ComplexArray:
    """Return K of E H = K: the first moment less what CAD knows of it, (..., n_conf) [kg m].

    Parameters
    ----------
    at : Placements, shape (..., n_conf, n_links, ...)
        In P.
    first_moment : complex array, shape (..., n_conf)
        Mass times CoM of the counted links, z + j x in P [kg m].
    """
    masses = chain.robot.tree.masses
    known, turning = np.flatnonzero(chain.known), np.flatnonzero(chain.counted & ~chain.known)
    foot = np.einsum("k,...ki->...i", masses[known], at.coms[..., known, :])
    origins = at.p[..., turning, :]
    return moment_of_coms(
        first_moment,
        foot[..., 2] + 1j * foot[..., 0],
        masses[turning],
        origins[..., 2] + 1j * origins[..., 0],
    )


def segment_com(chain: PlanarChain, at: Placements, H: ComplexArray) -> ComplexArray:
    """Return the CoM of each segment relative to its anchor joint, l + j r [m].

    Parameters
    ----------
    at : Placements, shape (..., n_configurations, n_links, ...)
        In P; the first is the first configuration's reference posture.
    H : complex array, shape (..., n_segments)
        First moments of the segments about their links' origins, in the first configuration.

    Returns
    -------
    w : complex array, shape (..., n_segments)
        l along the axis that is vertical when all joints are zero, r toes-ward.
    """
    masses = chain.robot.tree.masses
    out = np.empty(H.shape, dtype=np.complex128)
    for v, segment in enumerate(chain.segments):
        links = list(segment.links)
        arm = at.p[..., 0, links, :] - at.p[..., 0, segment.anchor, :][..., None, :]
        G = np.einsum("k,...ki->...i", masses[links], arm)
        phi = pitch_between(chain.straight[links[0]], at.R[..., 0, links[0], :, :])
        out[..., v] = (H[..., v] + G[..., 2] + 1j * G[..., 0]) / segment.mass * np.exp(-1j * phi)
    return out


def _turn_apart(a: Array, b: Array) -> float:
    return float(np.max(np.abs(np.angle(np.exp(1j * (a - b))))))


def _walk(robot: Robot, configuration: Configuration) -> tuple[list[int], dict[int, int]]:
    """Walk the tree from the standing feet; return the order of links and each one's anchor."""
    parents = robot.tree.parents
    order: list[int] = []
    anchor: dict[int, int] = {}
    queue = deque(robot.tree.link_index[robot.feet[f].link] for f in configuration.carrier.feet)
    for start in queue:
        anchor[start] = start
    while queue:
        k = queue.popleft()
        order.append(k)
        below = [int(c) for c in np.flatnonzero(parents == k)]
        above = [int(parents[k])] if parents[k] >= 0 else []
        for other in above + below:
            if other not in anchor:
                # A link's origin is the joint to its parent.
                anchor[other] = k if other in above else other
                queue.append(other)
    return order, anchor


def _refuse_out_of_plane(
    robot: Robot, configurations: Sequence[Configuration], at: Placements, body: list[int]
) -> None:
    turn = at.R @ np.swapaxes(at.R[:1], -1, -2)
    tipped = np.hypot(turn[..., 0, 1], turn[..., 2, 1])[:, body]
    if tipped.size and float(tipped.max()) > OUT_OF_PLANE:
        i, k = np.unravel_index(int(np.argmax(tipped)), tipped.shape)
        raise RankError(
            f"link {robot.tree.links[body[int(k)]].name} turns out of the sagittal plane; "
            "Cramer's rule is for planar sets",
            where=f"configuration {configurations[int(i)].name!r}",
            measured=f"{np.rad2deg(float(tipped.max())):.1f} deg",
            limit=f"{np.rad2deg(OUT_OF_PLANE):.1f} deg",
            next_step="use --method lstsq, or leave these poses out of column 'configuration'",
        )
