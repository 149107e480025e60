# SPDX-License-Identifier: Apache-2.0
"""How long one diagnosis takes: 60 poses of the 14-joint robot, all channels, all causes.

    python tests/bench/diagnose_bench.py

There is no peer that names causes. A prototype of the method (167 causes, 342 parameters, 8 to 36
poses) took 0.25 to 0.8 s of CPU. Beside it stands the time of one evaluation of all residuals in
the same run, a unit that goes with the machine.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import resource
import sys
import tempfile
import time
from pathlib import Path

from comcal.cli.main import main as comcal
from comcal.diagnose.candidates import candidates
from comcal.diagnose.diagnose import diagnose
from comcal.measure.poses_csv import read_poses
from comcal.predict.assumed import Assumed
from comcal.predict.parity import parity
from comcal.robot.description import load_robot
from comcal_sims.robots import biped14

POSES = 60
LIMIT_S, LIMIT_MB = 3.0, 500.0
HIDDEN = "payload@torso:mass=3,com_x=0.1"


def plan_of(folder: Path) -> Path:
    """Write a plan of 60 poses: the generated one, its first poses once more."""
    lines = (folder / "plan.csv").read_text("utf-8").splitlines()
    header, rows = lines[0], lines[1:]
    more = [f"{len(rows) + k},{row.split(',', 1)[1]}" for k, row in enumerate(rows, start=1)]
    plan = folder / "plan60.csv"
    plan.write_text("\n".join([header, *[*rows, *more][:POSES]]) + "\n", "utf-8")
    return plan


def main() -> int:
    """Record, diagnose three times, print the best."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        robot_yaml = biped14.generate(folder)
        session = folder / "session"
        words = ["record", str(robot_yaml), "-s", str(session), "--source", "builtin"]
        words += ["--poses", str(plan_of(folder)), "--seed", "1", "--effect", HIDDEN]
        if comcal(words) != 0:
            return 1
        robot = load_robot(session / "robot.yaml")
        table = read_poses(session / "poses.csv", robot)
    assumed = Assumed(robot)
    known = candidates(robot, table)
    times: list[float] = []
    said = ""
    for _ in range(3):
        began = time.process_time()
        found = diagnose(assumed, table)
        times.append(time.process_time() - began)
        said = f"{found.verdict.value} ({', '.join(cause.name for cause in found.causes)})"
    began = time.process_time()
    for _ in range(20):
        parity(assumed, table)
    one = (time.process_time() - began) / 20
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    best = min(times)
    parameters = sum(len(candidate.keys) for candidate in known)
    print(f"{len(table)} poses, {len(known)} causes with {parameters} parameters: {said}")
    print(f"one diagnosis {best:.2f} s of CPU (limit {LIMIT_S:g}), {peak:.0f} MB ({LIMIT_MB:g})")
    print(f"that is {best / one:.0f} evaluations of all residuals ({1e3 * one:.1f} ms each)")
    print(f"and {best / 0.8:.1f} to {best / 0.25:.1f} times the prototype's 0.8 to 0.25 s")
    return 0 if best < LIMIT_S and peak < LIMIT_MB else 5


if __name__ == "__main__":
    sys.exit(main())
