# SPDX-License-Identifier: Apache-2.0
"""The Cramer-Rao bound of a calibration, from a forward model of its own.

No unbiased estimate from the same poses can have a smaller standard deviation. To be an oracle for
the solver, this script shares nothing with ``comcal.statics`` and ``comcal.identify``: it reads
the URDF itself, has its own kinematics, predicts *measurements* (the solver has rows of a balance)
and differentiates them by complex steps.

Everything unknown is explicit. Of each pose: the true joint angles, the direction of gravity in
the root frame (two angles, no level floor assumed) and, on two feet, the wrench of the first sensor
(how the feet share the load is free). Of all poses: the mass and the first moment of every free
link; masses and CoMs of links below a sensor cut and CoMs of negligible links are inputs from CAD,
known with the spread of ``tolerances``. Directions that no pose shows keep the value of CAD: the
bound adds the spread that CAD has along them. What counts as orthogonal to them needs a metric: the
distance of all CoMs from CAD, every link with one ruler.

Run it on a study file, it writes the bounds that the study compares with::

    python tests/oracles/cramer_rao.py tests/studies/full.yaml --output tests/studies/crb.json
"""

from __future__ import annotations

import argparse
import csv
import json
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import entry_points
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
SEEN = 1e-9
"""Singular values below this part of the largest are rounding."""
STEP = 1e-30
"""Imaginary step of the derivatives, exact to rounding."""
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


@dataclass(frozen=True)
class NoiseOfMeans:
    """Standard errors of a pose mean [N], [N m], [rad]."""

    ft_force: float = 0.1
    ft_moment: float = 0.01
    encoder: float = 3.4907e-4


@dataclass(frozen=True)
class Bound:
    """Bounds by name of quantity; ``seen`` and ``unseen`` count directions of the unknowns."""

    sigma: dict[str, float]
    gradients: dict[str, Real]
    noise_cov: Real
    names: list[str]
    seen: int
    unseen: int
    weakest: float


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


def jacobian(function: Callable[[Complex], Complex], x: Real) -> Real:
    """Return the derivatives (n_out, n_in) of a batched analytic function by complex steps."""
    stepped = x + 1j * STEP * np.eye(len(x))
    return function(stepped).imag.T / STEP


def bound(
    machine: Machine,
    poses: Sequence[Pose],
    first: Mapping[int, Real],
    noise: NoiseOfMeans,
    com_poses: Mapping[str, Pose],
    *,
    cad_is_exact: bool = False,
) -> Bound:
    """Return the bound of every quantity.

    Parameters
    ----------
    machine : Machine
    poses : sequence of Pose
    first : mapping from pose id to array, shape (6,)
        True wrench of the first sensor of poses on two feet.
    noise : NoiseOfMeans
    com_poses : mapping from name to Pose
        Postures whose total CoM is wanted, at exactly these angles.
    cad_is_exact : bool
        Take what lies below the cuts, and negligible links, as exactly known.
    """
    shared = Globals(machine)
    x = shared.truth
    rows = [_reduced_rows(machine, pose, first, noise, x) for pose in poses]
    n_cad = len(x) - shared.n_free
    prior = np.hstack([np.zeros((n_cad, shared.n_free)), np.diag(1 / shared.cad_sigma)])
    A = np.vstack([*rows, prior]) * shared.scale
    kept = shared.n_free if cad_is_exact else len(x)
    _, s, Vt = np.linalg.svd(A[:, :kept], full_matrices=False)
    is_seen = s > SEEN * s[0]
    seen, unseen = Vt[is_seen].T, Vt[~is_seen].T
    scale = shared.scale[:kept, None]
    root = scale * seen / s[is_seen]
    hidden = scale * unseen
    free_sigma = np.zeros(kept)
    free_sigma[: shared.n_free] = shared.free_sigma
    spread = hidden @ (unseen.T / scale.T * free_sigma)
    gradients = {n: g[:kept] for n, g in _gradients(machine, com_poses, x).items()}
    sigma = {
        name: float(np.sqrt(np.sum((g @ root) ** 2) + np.sum((g @ spread) ** 2)))
        for name, g in gradients.items()
    }
    return Bound(
        sigma,
        gradients,
        root @ root.T,
        shared.names[:kept],
        int(is_seen.sum()) - (kept - shared.n_free),
        int((~is_seen).sum()),
        float(s[is_seen][-1] / s[0]),
    )


def _reduced_rows(
    machine: Machine, pose: Pose, first: Mapping[int, Real], noise: NoiseOfMeans, x: Real
) -> Real:
    """Return what a pose tells of the global unknowns once its own unknowns are fitted away."""
    n_local = len(pose.q) + 2 + 6 * (len(pose.feet) - 1)
    local = np.concatenate([pose.q, np.zeros(n_local - len(pose.q))])
    w = first.get(pose.pose, np.zeros(6))

    def measured(unknowns: Complex) -> Complex:
        return predict(machine, pose, w, unknowns[:, :n_local], unknowns[:, n_local:])

    J = jacobian(measured, np.concatenate([local, x]))
    wrench = np.repeat([noise.ft_force, noise.ft_moment], 3)
    sigma = np.concatenate([np.full(len(pose.q), noise.encoder), *[wrench] * len(pose.feet)])
    J = J / sigma[:, None]
    own, rest = J[:, :n_local], J[:, n_local:]
    basis, _ = np.linalg.qr(own / np.linalg.norm(own, axis=0))
    return rest - basis @ (basis.T @ rest)


def _gradients(machine: Machine, com_poses: Mapping[str, Pose], x: Real) -> dict[str, Real]:
    shared = Globals(machine)
    at = {name: i for i, name in enumerate(shared.names)}
    mass = np.zeros(len(x))
    mass[0] = 1.0
    mass[[at[f"m {k}"] for k in machine.hidden]] = 1.0
    found = {"mass": mass}
    for k in machine.free:
        for a in AXES:
            found[f"{k}.{a}"] = np.eye(len(x))[at[f"h {k} {a}"]] / machine.masses[k]
    for name, pose in com_poses.items():
        frames = place(machine, pose.q[None].astype(complex))
        R, origin = stance(machine, frames, pose.feet)

        def com_in_stance(
            values: Complex, frames: Frames = frames, R: Complex = R, origin: Complex = origin
        ) -> Complex:
            m, moment = shared.masses_and_moments(values, frames, set())
            return (moment / m[:, None] - origin) @ R[0]

        for a, g in zip(AXES, jacobian(com_in_stance, x), strict=True):
            found[f"total_com.{name}.{a}"] = g
    return found


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


def load_sharing(folder: Path) -> dict[int, Real]:
    """Return the wrench of the left foot in every two-foot pose of the simulated world.

    Statics leaves it open, so the simulator has to be asked.
    """
    from comcal.measure.plan_csv import read_plan as read_comcal_plan
    from comcal.robot.description import load_robot
    from comcal_sims.builtin_world import static_state

    robot = load_robot(folder / "robot.yaml")
    name = robot.feet["left"].sensor
    plan = read_comcal_plan(folder / "plan.csv", robot.tree.joint_names)
    return {p.pose: static_state(robot, p).wrenches[name] for p in plan if p.support == "double"}


def bounds_of_study(path: Path) -> dict[str, Any]:
    """Return what the study file at *path* compares with, ready to be written as JSON."""
    study = YAML(typ="safe", pure=True).load(path.read_text("utf-8"))
    found = list[dict[str, Any]]()
    for entry in study["robots"]:
        generate = next(
            iter(entry_points(group="comcal.robots", name=entry.get("robot", entry["name"])))
        ).load()
        with tempfile.TemporaryDirectory() as folder:
            generate(Path(folder), **(entry.get("parameters") or {}))
            machine = read_machine(Path(folder))
            poses = read_plan(Path(folder), machine)
            first = load_sharing(Path(folder))
        by_id = {pose.pose: pose for pose in poses}
        wanted = entry.get("quantities", {}).get("total_com", {})
        com_poses = {name: by_id[i] for name, i in wanted.items()}
        for sensor in study["noise"]:
            n = sensor["samples"]
            noise = NoiseOfMeans(
                sensor["ft_force"] / np.sqrt(n), sensor["ft_moment"] / np.sqrt(n), sensor["encoder"]
            )
            result = bound(machine, poses, first, noise, com_poses)
            found.append(
                {
                    "robot": entry["name"],
                    "noise": {**vars(noise)},
                    "poses": [pose.pose for pose in poses],
                    "rank": result.seen,
                    "unseen": result.unseen,
                    "sigma": result.sigma,
                }
            )
    return {"format": "comcal-crb/1", "bounds": found}


def main() -> None:
    """Write the bounds of a study file."""
    parser = argparse.ArgumentParser(description="Cramer-Rao bounds of a study")
    parser.add_argument("study", type=Path, help="study file (comcal-study/1)")
    parser.add_argument("--output", type=Path, required=True, help="JSON file to write")
    arguments = parser.parse_args()
    result = bounds_of_study(arguments.study)
    arguments.output.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    for entry in result["bounds"]:
        print(f"{entry['robot']}: rank {entry['rank']}, {entry['unseen']} directions unseen")


if __name__ == "__main__":
    main()
