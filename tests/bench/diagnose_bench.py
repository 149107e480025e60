# SPDX-License-Identifier: Apache-2.0
"""How long one diagnosis takes: 60 poses of the 14-joint robot, all channels, all causes.

    python tests/bench/diagnose_bench.py [--robot talos]

The limits are those of the 14-joint robot; a published humanoid beside it has none.
There is no peer that names causes. A prototype of the method (167 causes, 342 parameters, 8 to 36
poses) took 0.25 to 0.8 s of CPU. Beside it stands the time of one evaluation of all residuals in
the same run, a unit that goes with the machine.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import argparse
import resource
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from comcal.cli.main import main as comcal
from comcal.diagnose.candidates import candidates
from comcal.diagnose.diagnose import diagnose
from comcal.measure.plan import PlannedPose
from comcal.measure.plan_csv import write_plan
from comcal.measure.poses_csv import read_poses
from comcal.plan.candidates import random_pool
from comcal.plan.rules import rules_of
from comcal.predict.assumed import Assumed
from comcal.predict.parity import parity
from comcal.robot.description import load_robot
from comcal_sims.robots import biped14

POSES = 60
LIMIT_S, LIMIT_MB = 3.0, 500.0
HIDDEN = "payload@{}:mass=3,com_x=0.1"
SUPPORTS = ("double", "left", "right")


def plan_of(folder: Path) -> Path:
    """Write a plan of 60 poses: the generated one, its first poses once more."""
    lines = (folder / "plan.csv").read_text("utf-8").splitlines()
    header, rows = lines[0], lines[1:]
    more = [f"{len(rows) + k},{row.split(',', 1)[1]}" for k, row in enumerate(rows, start=1)]
    plan = folder / "plan60.csv"
    plan.write_text("\n".join([header, *[*rows, *more][:POSES]]) + "\n", "utf-8")
    return plan


def published(name: str, folder: Path) -> tuple[Path, Path, str]:
    """Write a published humanoid and 60 random poses of it; return both, and its heaviest link."""
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "oracles"))
    from humanoids import write_humanoid

    robot_yaml = write_humanoid(name, folder)
    robot = load_robot(robot_yaml)
    rules = rules_of(robot, SUPPORTS, margin=0.015, share=0.95)
    pool = random_pool(rules, POSES // len(SUPPORTS), np.random.default_rng(1), uniform=True)
    drawn = zip(pool.support, pool.q, strict=True)
    poses = [PlannedPose(i, q, support) for i, (support, q) in enumerate(drawn, start=1)]
    plan = folder / "plan60.csv"
    write_plan(plan, poses, robot.tree.joint_names)
    return robot_yaml, plan, max(robot.tree.links, key=lambda link: link.mass).name


def main() -> int:
    """Record, diagnose three times, print the best."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--robot", choices=("biped14", "talos", "g1"), default="biped14")
    given = parser.parse_args().robot
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if given == "biped14":
            robot_yaml, link = biped14.generate(folder), "torso"
            plan = plan_of(folder)
        else:
            robot_yaml, plan, link = published(given, folder)
        session = folder / "session"
        words = ["record", str(robot_yaml), "-s", str(session), "--source", "builtin"]
        words += ["--poses", str(plan), "--seed", "1", "--effect", HIDDEN.format(link)]
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
    has_limits = given == "biped14"
    limits = f" (limits {LIMIT_S:g} s, {LIMIT_MB:g} MB)" if has_limits else ""
    print(f"one diagnosis {best:.2f} s of CPU, {peak:.0f} MB{limits}")
    print(f"that is {best / one:.0f} evaluations of all residuals ({1e3 * one:.1f} ms each)")
    print(f"and {best / 0.8:.1f} to {best / 0.25:.1f} times the prototype's 0.8 to 0.25 s")
    return 5 if has_limits and not (best < LIMIT_S and peak < LIMIT_MB) else 0


if __name__ == "__main__":
    sys.exit(main())
