# SPDX-License-Identifier: Apache-2.0
"""What a session measured, in the quantities of Muscolo et al. (2017): planar poses of two legs.

Both legs move as one, so that shins are link b and thighs with all above them are link c. All
lengths are in the stance frame P, with x counted from the ankle axle: the paper puts the axle
above P, a real sensor may sit elsewhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from comcal.errors import RankError
from comcal.measure.table import PoseTable
from comcal.robot.kinematics import Placements
from comcal.robot.model import Robot
from comcal.robot.tree import Array, JointType
from comcal.statics.configurations import placed_in_stance
from comcal.statics.published import PlanarPose
from comcal.statics.published_chain import FootCad, LinkComs, PublishedChain
from comcal.statics.published_coefficients import (
    PublishedCoefficients,
    coefficients_as_published,
    internal_torques,
)
from comcal.statics.published_faults import CORRECTED, Fault
from comcal.statics.support import Carrier, loaded_wrenches
from comcal.statics.wrenches import wrench_transform

PARALLEL = np.cos(np.deg2rad(1.0))
"""Cosine above which a joint axis counts as parallel to P's y axis."""
IN_PLANE = 0.005
"""How far the two legs may be from lying over one another, seen from the side [m]."""


ANKLE, KNEE, HIP = 0, 1, 2
"""Position of the joints in :attr:`Leg.joints`."""


@dataclass(frozen=True)
class Leg:
    """The three pitch joints of one leg: ankle, knee, hip (in ``tree.joints``); its highest link.

    Everything from *top_link* down belongs to this leg alone.
    """

    joints: tuple[int, int, int]
    top_link: int


@dataclass(frozen=True)
class PlanarSession:
    """Double-support poses of a session, reduced to the paper's quantities.

    Parameters
    ----------
    legs : tuple of Leg
        Left, right.
    at : Placements
        In P, for N poses.
    shin, thigh : array, shape (N,)
        Absolute pitch, mean of both legs [rad].
    planar : array of bool, shape (N,)
        Whether the legs lie over one another in that pose.
    plain, with_torques : PublishedCoefficients
        Equations (10)-(13) without M_2, and with factor +1; the latter is NaN where a torque is
        missing.
    """

    robot: Robot
    carrier: Carrier
    legs: tuple[Leg, ...]
    at: Placements
    shin: Array
    thigh: Array
    planar: npt.NDArray[np.bool_]
    plain: PublishedCoefficients
    with_torques: PublishedCoefficients

    def pose(self, i: int) -> PlanarPose:
        """Return pose *i* with x counted from the ankle axle."""
        alpha = float(self.plain.alpha[i])
        return PlanarPose(
            shin=float(self.shin[i]),
            thigh=float(self.thigh[i]),
            alpha=alpha - float(self._axle()[i, 0]),
            beta=float(self.plain.beta[i]),
            internal=alpha - float(self.with_torques.alpha[i]),
        )

    def chain(self, i: int) -> tuple[PublishedChain, LinkComs]:
        """Return the three links in pose *i* and the CoMs of b and c according to the URDF."""
        tree, carried = self.robot.tree, self.carrier.carried
        none = np.zeros(len(tree.links), dtype=np.bool_)
        feet, below_knee, legs = none.copy(), none.copy(), none.copy()
        for leg in self.legs:
            feet |= tree.descendants[leg.joints[ANKLE] + 1]
            below_knee |= tree.descendants[leg.joints[KNEE] + 1]
            legs |= tree.descendants[leg.top_link]
        axle, knee = self._axle()[i], self._mean_origin(KNEE)[i]
        m_a, com_a = self._lump(i, carried & feet)
        m_b, com_b = self._lump(i, carried & below_knee & ~feet)
        m_c, com_c = self._lump(i, carried & ~below_knee)
        foot = FootCad(m_a, float(com_a[0] - axle[0]), float(com_a[2]), float(axle[2]))
        waist_mass = float(tree.masses[carried & ~legs].sum())
        length = float(np.hypot(*(knee - axle)[[0, 2]]))
        r_b, l_b = _in_link(com_b - axle, float(self.shin[i]))
        r_c, l_c = _in_link(com_c - knee, float(self.thigh[i]))
        return PublishedChain(foot, m_b, m_c, length, waist_mass), LinkComs(r_b, l_b, r_c, l_c)

    def _axle(self) -> Array:
        return self._mean_origin(ANKLE)

    def _mean_origin(self, joint: int) -> Array:
        """Return the mean of both legs' joint origins in P, shape (N, 3) [m]."""
        return np.mean([self.at.p[:, leg.joints[joint] + 1] for leg in self.legs], axis=0)

    def _lump(self, i: int, links: npt.NDArray[np.bool_]) -> tuple[float, Array]:
        """Return mass [kg] and CoM in P [m] of some links; zero if none weighs."""
        masses = self.robot.tree.masses * links
        mass = float(masses.sum())
        com = masses @ self.at.coms[i] / mass if mass > 0.0 else np.zeros(3)
        return mass, com


def planar_session(robot: Robot, carrier: Carrier, table: PoseTable) -> PlanarSession:
    """Reduce double-support poses to the paper's quantities.

    Parameters
    ----------
    robot : Robot
    carrier : Carrier
        Of double support.
    table : PoseTable
        Poses in double support only.

    Raises
    ------
    RankError
        If the robot is no biped with a sensor in each foot and ankle, knee and hip pitch joints.
    MissingColumnError
        If the table lacks the wrench of a foot.
    """
    if len(carrier.feet) != 2 or any(robot.feet[f].sensor is None for f in carrier.feet):
        raise RankError(
            "the paper's formulas are for two feet with a force-torque sensor in each",
            where=robot.name,
        )
    w, _ = loaded_wrenches(carrier, table)
    at = placed_in_stance(robot, carrier, table.q)
    left, right = (_leg(robot, carrier, foot, at) for foot in (0, 1))
    plain, with_torques = (
        _coefficients(robot, carrier, table, at, w, faults)
        for faults in (CORRECTED, Fault.INTERNAL_TORQUES)
    )
    return PlanarSession(
        robot=robot,
        carrier=carrier,
        legs=(left, right),
        at=at,
        shin=_pitch(at, (left, right), ANKLE, KNEE),
        thigh=_pitch(at, (left, right), KNEE, HIP),
        planar=_planar(at, left, right),
        plain=plain,
        with_torques=with_torques,
    )


def _in_link(offset: Array, pitch: float) -> tuple[float, float]:
    """Return (r, l) of an offset in P, in the axes of a link pitched by *pitch* [rad]."""
    s, c = float(np.sin(pitch)), float(np.cos(pitch))
    x, z = float(offset[0]), float(offset[2])
    return c * x - s * z, s * x + c * z


def _leg(robot: Robot, carrier: Carrier, which: int, at: Placements) -> Leg:
    """Return the pitch joints of a leg, walking from the ankle towards the root."""
    tree = robot.tree
    foot, other = (robot.feet[carrier.feet[k]] for k in (which, 1 - which))
    joints: list[int] = []
    link = tree.link_index[foot.link]
    top_link = link
    while link > 0 and not tree.descendants[link, tree.link_index[other.link]]:
        top_link = link
        joints.append(link - 1)
        link = int(tree.parents[link])
    if foot.ankle is None or tree.joint_index[foot.ankle] not in joints:
        raise RankError(f"foot {foot.name!r} has no ankle pitch joint above it", where=robot.name)
    joints = joints[joints.index(tree.joint_index[foot.ankle]) :]
    # A roll joint may have turned the pitch axes away in some poses, never in all planar ones.
    along_y = np.abs(at.axes()[..., 1]).max(axis=0) > PARALLEL
    pitch_joints = [j for j in joints if along_y[j]]
    if len(pitch_joints) < 3 or pitch_joints[0] != joints[0]:
        raise RankError(
            f"the leg above foot {foot.name!r} has not the pitch joints ankle, knee and hip",
            where=robot.name,
        )
    ankle, knee, hip = pitch_joints[:3]
    return Leg((ankle, knee, hip), top_link)


def _pitch(at: Placements, legs: Sequence[Leg], lower: int, upper: int) -> Array:
    """Return the pitch of the line between two joints, mean of the legs, shape (N,) [rad]."""
    lines = [at.p[:, leg.joints[upper] + 1] - at.p[:, leg.joints[lower] + 1] for leg in legs]
    x, _, z = np.sum(lines, axis=0).T
    return np.arctan2(x, z)


def _planar(at: Placements, left: Leg, right: Leg) -> npt.NDArray[np.bool_]:
    """Return in which poses all pitch axes are parallel and the legs lie over one another."""
    joints = np.array([left.joints, right.joints])
    parallel = (np.abs(at.axes()[:, joints.ravel(), 1]) > PARALLEL).all(axis=1)
    apart = at.p[:, joints[0] + 1] - at.p[:, joints[1] + 1]
    aligned = (np.hypot(apart[..., 0], apart[..., 2]) < IN_PLANE).all(axis=1)
    return parallel & aligned


def _coefficients(
    robot: Robot, carrier: Carrier, table: PoseTable, at: Placements, w: Array, faults: Fault
) -> PublishedCoefficients:
    """Return (10)-(13), each wrench taken about the point of P's y axis beside its sensor."""
    points: list[Array] = []
    across: list[Array] = []
    for k, sensor in enumerate(carrier.sensors):
        frame = robot.tree.joint_index[robot.sensors[sensor].joint] + 1
        p = at.p[:, frame]
        across.append(p[:, 1])
        X = wrench_transform(at.R[:, frame], p * [1.0, 0.0, 1.0])
        points.append(np.einsum("nij,nj->ni", X, w[:, k]))
    left, right = points
    return coefficients_as_published(
        right,
        left,
        half_stance=(across[0] - across[1]) / 2,
        M_2=_internal_torques(robot, table, at),
        faults=faults,
    )


def _internal_torques(robot: Robot, table: PoseTable, at: Placements) -> Array:
    """Return M_2 of (3) in P, shape (N, 3) [N m]: measured torques, else those of the currents."""
    tree = robot.tree
    constant = {m.joint: m.torque_constant * m.gear * m.sign for m in robot.motors.values()}
    per_ampere = np.array([constant.get(name, np.nan) for name in tree.joint_names])
    torques = np.where(np.isfinite(table.torque), table.torque, table.current * per_ampere)
    joints = [tree.joint_index[name] for name in tree.joint_names]
    turning = [k for k, j in enumerate(joints) if tree.joints[j].kind is not JointType.PRISMATIC]
    axes = at.axes()[:, [joints[k] for k in turning]]
    return np.stack(
        [internal_torques(t, a) for t, a in zip(torques[:, turning], axes, strict=True)]
    )
