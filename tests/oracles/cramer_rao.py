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
import json
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

import numpy as np
from forward_model import (
    AXES,
    Complex,
    Frames,
    Globals,
    Machine,
    Pose,
    Real,
    place,
    predict,
    read_machine,
    read_plan,
    stance,
)
from ruamel.yaml import YAML

SEEN = 1e-9
"""Singular values below this part of the largest are rounding."""
STEP = 1e-30
"""Imaginary step of the derivatives, exact to rounding."""


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
