# SPDX-License-Identifier: Apache-2.0
"""What the sensors of a robot at rest read: a forward model that shares nothing with the solver.

It reads the URDF itself and has its own kinematics, analytic throughout, so that complex steps
differentiate it exactly.
"""

from __future__ import annotations

import csv
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from ruamel.yaml import YAML

Complex = npt.NDArray[np.complex128]
Real = npt.NDArray[np.float64]
Frames = dict[str, tuple[Complex, Complex]]

NEGLIGIBLE = 1e-4
"""Share of the robot's mass below which a link's CoM is an input from CAD."""
RULER = 0.1
"""Makes first moments of links comparable with masses [m]."""
AXES = "xyz"


@dataclass(frozen=True)
class Joint:
    """A URDF joint: origin in the parent, axis (zero: fixed), number of its angle (-1: none)."""

    parent: str
    child: str
    R: Real
    p: Real
    axis: Real
    angle: int


@dataclass(frozen=True)
class Machine:
    """What the bound needs of a robot, read plainly from its files.

    ``below`` names the links below the cut of each foot; ``joint_of`` the joint of its sensor.
    """

    name: str
    gravity: float
    masses: dict[str, float]
    coms: dict[str, Real]
    joints: list[Joint]
    joint_names: list[str]
    sensor_link: dict[str, str]
    below: dict[str, set[str]]
    sole: dict[str, tuple[str, Real]]
    sigma_com: float
    sigma_mass: float

    @property
    def free(self) -> list[str]:
        """Links whose first moment is to be found."""
        hidden = set[str]().union(*self.below.values())
        light = NEGLIGIBLE * sum(self.masses.values())
        return [k for k, m in self.masses.items() if m > light and k not in hidden]

    @property
    def given(self) -> list[str]:
        """Links whose CoM comes from CAD."""
        return [k for k in self.masses if k not in self.free]

    @property
    def hidden(self) -> list[str]:
        """Links below a cut, whose mass comes from CAD too."""
        return [k for k in self.masses if any(k in links for links in self.below.values())]


@dataclass(frozen=True)
class Pose:
    """True angles [rad], standing feet (left first) and slope of the floor [rad]."""

    pose: int
    q: Real
    feet: tuple[str, ...]
    floor: tuple[float, float]


def read_machine(folder: Path) -> Machine:
    """Read ``robot.yaml`` and its URDF; every value that a generated robot writes is in SI."""
    text = YAML(typ="safe", pure=True).load((folder / "robot.yaml").read_text("utf-8"))
    root = ET.parse(folder / text["urdf"]).getroot()
    masses, coms = dict[str, float](), dict[str, Real]()
    for link in root.iter("link"):
        masses[link.attrib["name"]] = float(link.find("inertial/mass").attrib["value"])
        coms[link.attrib["name"]] = _vector(link.find("inertial/origin"), "xyz")
    joints, names, child_of = list[Joint](), list[str](), dict[str, str]()
    for element in root.iter("joint"):
        moves = element.attrib["type"] != "fixed"
        origin = element.find("origin")
        child = element.find("child").attrib["link"]
        joint = Joint(
            element.find("parent").attrib["link"],
            child,
            _rpy(_vector(origin, "rpy")).real,
            _vector(origin, "xyz"),
            _vector(element.find("axis"), "xyz") if moves else np.zeros(3),
            len(names) if moves else -1,
        )
        joints.append(joint)
        names += [element.attrib["name"]] if moves else []
        child_of[element.attrib["name"]] = child
    sensor_link = {
        f: child_of[text["sensors"][v["sensor"]]["joint"]] for f, v in text["feet"].items()
    }
    below = {f: _beyond(joints, link) for f, link in sensor_link.items()}
    soles = {
        f: (v["link"], _rpy(np.array(v["sole_frame"]["rpy"])).real) for f, v in text["feet"].items()
    }
    tolerances = text.get("tolerances") or {}
    return Machine(
        text["name"],
        text["gravity"],
        masses,
        coms,
        joints,
        names,
        sensor_link,
        below,
        soles,
        tolerances.get("link_com", 0.001),
        tolerances.get("link_mass", 0.005),
    )


def read_plan(folder: Path, machine: Machine) -> list[Pose]:
    """Read the standing poses of ``plan.csv``."""
    with (folder / "plan.csv").open(encoding="utf-8", newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["support"] != "none"]
    both = tuple(machine.below)
    return [
        Pose(
            int(row["pose"]),
            np.array([float(row[f"q.{name}"]) for name in machine.joint_names]),
            both if row["support"] == "double" else (row["support"],),
            (float(row.get("floor.roll") or 0), float(row.get("floor.pitch") or 0)),
        )
        for row in rows
    ]


def place(machine: Machine, q: Complex) -> Frames:
    """Return rotation (B, 3, 3) and origin (B, 3) of every link in the root frame."""
    root = next(k for k in machine.masses if all(j.child != k for j in machine.joints))
    n = len(q)
    frames: Frames = {
        root: (np.tile(np.eye(3, dtype=complex), (n, 1, 1)), np.zeros((n, 3), complex))
    }
    waiting = list(machine.joints)
    while waiting:
        joint = next(j for j in waiting if j.parent in frames)
        waiting.remove(joint)
        R, p = frames[joint.parent]
        turned = R @ joint.R
        if joint.angle >= 0:
            turned = turned @ _turn(joint.axis, q[:, joint.angle])
        frames[joint.child] = (turned, p + R @ joint.p)
    return frames


def stance(machine: Machine, frames: Frames, feet: Sequence[str]) -> tuple[Complex, Complex]:
    """Return axes and origin of the frame attached to the standing soles, in the root frame."""
    soles = [frames[machine.sole[f][0]][0] @ machine.sole[f][1] for f in feet]
    origins = [frames[machine.sensor_link[f]][1] for f in feet]
    if len(feet) == 1:
        return soles[0], origins[0]
    z = _unit(sum(R[:, :, 2] for R in soles))
    across = origins[0] - origins[1]
    y = _unit(across - _dot(across, z)[:, None] * z)
    return np.stack([np.cross(y, z), y, z], axis=2), sum(origins) / len(origins)


@dataclass(frozen=True)
class Globals:
    """Positions of the unknowns that all poses share, in one vector."""

    machine: Machine

    @property
    def names(self) -> list[str]:
        """``free_mass``, ``h LINK x`` ..., ``m LINK`` below cuts, ``c LINK x`` from CAD."""
        m = self.machine
        return [
            "free_mass",
            *(f"h {k} {a}" for k in m.free for a in AXES),
            *(f"m {k}" for k in m.hidden),
            *(f"c {k} {a}" for k in m.given for a in AXES),
        ]

    @property
    def n_free(self) -> int:
        """Number of unknowns that have no CAD value to lean on."""
        return 1 + 3 * len(self.machine.free)

    @property
    def truth(self) -> Real:
        """The values of the files."""
        m = self.machine
        free_mass = sum(m.masses.values()) - sum(m.masses[k] for k in m.hidden)
        parts = [np.array([free_mass]), *(m.masses[k] * m.coms[k] for k in m.free)]
        parts += [np.array([m.masses[k]]) for k in m.hidden] + [m.coms[k] for k in m.given]
        return np.concatenate(parts)

    @property
    def scale(self) -> Real:
        """Size of each unknown, for ranks: mass, mass times ruler; for CAD inputs their sigma."""
        m = self.machine
        free = [RULER * m.masses[k] for k in m.free for _ in AXES]
        return np.array([sum(m.masses.values()), *free, *self.cad_sigma])

    @property
    def cad_sigma(self) -> Real:
        """Stated sigma of the CAD inputs."""
        m = self.machine
        masses = [m.sigma_mass * m.masses[k] for k in m.hidden]
        return np.array(masses + [m.sigma_com] * 3 * len(m.given))

    @property
    def free_sigma(self) -> Real:
        """Spread of CAD of the free unknowns; the mass is always seen."""
        m = self.machine
        return np.array([0.0] + [m.sigma_com * m.masses[k] for k in m.free for _ in AXES])

    def masses_and_moments(
        self, x: Complex, frames: Frames, skipped: set[str]
    ) -> tuple[Complex, Complex]:
        """Return the mass (B,) and first moment about the root origin (B, 3) of what is counted."""
        m, at = self.machine, {name: i for i, name in enumerate(self.names)}
        mass = x[:, 0].copy()
        moment = np.zeros((len(x), 3), complex)
        for k in m.masses:
            if k in skipped:
                continue
            R, p = frames[k]
            m_k = x[:, at[f"m {k}"]] if k in m.hidden else np.full(len(x), m.masses[k], complex)
            if k in m.hidden:
                mass = mass + m_k
            if k in m.free:
                column = at[f"h {k} x"]
                h = x[:, column : column + 3]
            else:
                column = at[f"c {k} x"]
                h = m_k[:, None] * x[:, column : column + 3]
            moment = moment + m_k[:, None] * p + _apply(R, h)
        return mass, moment


def predict(machine: Machine, pose: Pose, first: Real, local: Complex, shared: Complex) -> Complex:
    """Return the measurements of a pose, (B, n): angles, then each loaded sensor's wrench.

    ``local`` holds the true angles, two tilts of gravity about its nominal direction, and on two
    feet what is added to the wrench *first* of the first sensor; ``shared`` the global unknowns.
    """
    n_q = len(pose.q)
    q = local[:, :n_q]
    frames = place(machine, q)
    up = nominal_up(machine, pose)
    e1 = np.cross(up, np.eye(3)[np.argmin(np.abs(up))])
    e2 = np.cross(up, e1)
    u = _unit(up + local[:, n_q, None] * e1 + local[:, n_q + 1, None] * e2)
    skipped = set[str]().union(*(machine.below[f] for f in pose.feet))
    mass, moment = Globals(machine).masses_and_moments(shared, frames, skipped)
    F = machine.gravity * mass[:, None] * u
    M = machine.gravity * np.cross(moment, u)
    wrenches = list[Complex]()
    if len(pose.feet) == 2:
        w = first + local[:, n_q + 2 :]
        R, p = frames[machine.sensor_link[pose.feet[0]]]
        F_1 = _apply(R, w[:, :3])
        F, M = F - F_1, M - _apply(R, w[:, 3:]) - np.cross(p, F_1)
        wrenches.append(w)
    R, p = frames[machine.sensor_link[pose.feet[-1]]]
    M = M - np.cross(p, F)
    back = np.swapaxes(R, 1, 2)
    wrenches.append(np.concatenate([_apply(back, F), _apply(back, M)], axis=1))
    return np.concatenate([q, *wrenches], axis=1)


def nominal_up(machine: Machine, pose: Pose) -> Real:
    """Return the vertical in the root frame at the true angles, from the slope of the floor."""
    roll, pitch = pose.floor
    R_root_P, _ = stance(machine, place(machine, pose.q[None].astype(complex)), pose.feet)
    R_world_P = _turn(np.eye(3)[1], np.array([pitch])) @ _turn(np.eye(3)[0], np.array([roll]))
    return (R_root_P[0] @ R_world_P[0].T @ np.eye(3)[2]).real


def _beyond(joints: Sequence[Joint], link: str) -> set[str]:
    found = {link}
    for _ in joints:
        found |= {j.child for j in joints if j.parent in found}
    return found


def _vector(element: Any, name: str) -> Real:
    return np.array([float(v) for v in element.attrib.get(name, "0 0 0").split()])


def _rpy(rpy: Real) -> Complex:
    Rx, Ry, Rz = (_turn(axis, rpy[i : i + 1])[0] for i, axis in enumerate(np.eye(3)))
    return Rz @ Ry @ Rx


def _turn(axis: Real, angle: npt.ArrayLike) -> Complex:
    x, y, z = axis
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    s, c = np.sin(angle)[..., None, None], np.cos(angle)[..., None, None]
    return np.eye(3) + s * K + (1 - c) * (K @ K) + 0j


def _apply(R: Complex, v: Complex) -> Complex:
    return (R @ v[..., None])[..., 0]


def _dot(a: Complex, b: Complex) -> Complex:
    return np.sum(a * b, axis=-1)  # no conjugate: it would not be analytic


def _unit(v: Complex) -> Complex:
    return v / np.sqrt(_dot(v, v))[..., None]
