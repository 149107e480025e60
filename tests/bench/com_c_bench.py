# SPDX-License-Identifier: Apache-2.0
"""Exported C against Pinocchio, CoM and Jacobian per call; run by hand, prints a table.

    python tests/bench/com_c_bench.py [ROBOT.urdf] [--cc gcc] [--flags=-O2]

Both walk the same poses in the same run, in turns. "in C" is a loop in the same library: what a
controller pays. "from Python" calls through ctypes, whose own price is shown beside it.
"""

from __future__ import annotations

import argparse
import ctypes
import os
import subprocess
import tempfile
import time
from collections.abc import Callable
from importlib import metadata
from pathlib import Path

import numpy as np
import pinocchio as pin

from comcal.robot.tree import Tree
from comcal.robot.urdf import read_urdf
from comcal.workflow.export_c import export_c

POSES, ROUNDS = 1000, 15
TALOS = "talos_data/robots/talos_reduced.urdf"
REQUIRED = 1.0

LOOP = """
void robot_com_loop(int n, int nq, const double *q, double *com, double *J)
{
    for (int k = 0; k < n; k++)
        robot_com_jacobian(q + (long)k * nq, com, J);
}
void robot_com_only_loop(int n, int nq, const double *q, double *com)
{
    for (int k = 0; k < n; k++)
        robot_com(q + (long)k * nq, com);
}
void robot_trig_loop(int n, int nq, const double *q, double *J)
{
    for (int k = 0; k < n; k++)
        for (int j = 0; j < nq; j++) {
            J[j] = sin(q[(long)k * nq + j]);
            J[nq + j] = cos(q[(long)k * nq + j]);
        }
}
void robot_nothing(const double *q, double *com, double *J)
{
    (void)q;
    (void)com;
    (void)J;
}
"""


def talos() -> Path:
    package = metadata.distribution("example-robot-data")
    found = next(f for f in package.files or () if str(f).endswith(TALOS))
    return Path(str(package.locate_file(found)))


def library(tree: Tree, folder: Path, compiler: str, flags: list[str]) -> ctypes.CDLL:
    files = export_c(tree, "robot")
    for name, text in files.items():
        (folder / name).write_text(text)
    (folder / "all.c").write_text(files["robot_com.c"] + LOOP)
    command = [compiler, "-std=c99", *flags, "-shared", "-fPIC", folder / "all.c"]
    began = time.perf_counter()
    subprocess.run([*command, "-o", folder / "all.so", "-lm"], check=True)
    print(f"compiled in {time.perf_counter() - began:.2f} s with {compiler} {' '.join(flags)}")
    return ctypes.CDLL(str(folder / "all.so"))


def best_of(jobs: dict[str, Callable[[], object]]) -> dict[str, float]:
    """Seconds per pose of every job; taken in turns, so that all see the same load."""
    best = dict.fromkeys(jobs, np.inf)
    for _ in range(ROUNDS):
        for name, job in jobs.items():
            began = time.perf_counter()
            job()
            best[name] = min(best[name], (time.perf_counter() - began) / POSES)
    return best


def pin_loop(model: pin.Model, poses: list[np.ndarray]) -> Callable[[], None]:
    data = model.createData()

    def loop() -> None:
        for q in poses:
            pin.jacobianCenterOfMass(model, data, q)

    return loop


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("urdf", nargs="?", type=Path, default=None)
    parser.add_argument("--cc", default="gcc")
    parser.add_argument("--flags", default="-O2")
    arguments = parser.parse_args()
    path = arguments.urdf or talos()
    tree = read_urdf(path)
    nq = len(tree.joint_names)
    q = np.random.default_rng(0).uniform(-1, 1, (POSES, nq))
    com, J = np.empty(3), np.empty((3, nq))

    fixed = pin.buildModelFromUrdf(str(path))
    free = pin.buildModelFromUrdf(str(path), pin.JointModelFreeFlyer())
    columns = [tree.joint_names.index(name) for name in fixed.names if name in tree.joint_names]
    if fixed.nq != nq:
        raise SystemExit("only robots whose every joint is one number, without mimics")
    base = np.tile([0, 0, 0, 0, 0, 0, 1.0], (POSES, 1))
    with tempfile.TemporaryDirectory() as folder:
        c = library(tree, Path(folder), arguments.cc, arguments.flags.split())
        pointer = ctypes.POINTER(ctypes.c_double)

        def at(array: np.ndarray) -> object:
            return array.ctypes.data_as(pointer)

        rows = [at(row) for row in q]
        to_com, to_J, all_q = at(com), at(J), at(q)
        n_poses, n_q = ctypes.c_int(POSES), ctypes.c_int(nq)

        def from_python(function: Callable[..., object]) -> Callable[[], None]:
            def loop() -> None:
                for row in rows:
                    function(row, to_com, to_J)

            return loop

        seconds = best_of(
            {
                "C, CoM and Jacobian, in C": lambda: c.robot_com_loop(
                    n_poses, n_q, all_q, to_com, to_J
                ),
                "C, CoM alone, in C": lambda: c.robot_com_only_loop(n_poses, n_q, all_q, to_com),
                "C, sines and cosines alone": lambda: c.robot_trig_loop(n_poses, n_q, all_q, to_J),
                "C, CoM and Jacobian, from Python": from_python(c.robot_com_jacobian),
                "C, nothing, from Python": from_python(c.robot_nothing),
                "Pinocchio, fixed root": pin_loop(fixed, list(q[:, columns])),
                "Pinocchio, free root": pin_loop(free, list(np.hstack([base, q[:, columns]]))),
            }
        )
        # With a fixed root Pinocchio leaves the root's mass out: the free one computes the same.
        data = free.createData()
        expected = pin.jacobianCenterOfMass(free, data, np.r_[base[-1], q[-1, columns]])[:, 6:]
        c.robot_com_jacobian(rows[-1], to_com, to_J)
    off = max(abs(J[:, columns] - expected).max(), abs(com - data.com[0]).max())

    print(f"{tree.name}, {nq} joints; {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")
    print(f"largest difference to Pinocchio {off:.1e}")
    print(f"{'':34}{'us per call':>12}{'times faster than Pinocchio':>30}{'required':>10}")
    reference = min(seconds["Pinocchio, fixed root"], seconds["Pinocchio, free root"])
    for name, value in seconds.items():
        text = f"{name:34}{value * 1e6:12.2f}"
        if "Jacobian" in name:
            text += f"{reference / value:30.1f}{'> ' + str(REQUIRED):>10}"
        print(text)


if __name__ == "__main__":
    main()
