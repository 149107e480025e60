# SPDX-License-Identifier: Apache-2.0
"""How much planned poses tell more than random ones; run by hand, prints a table.

    python tests/bench/plan_bench.py [g1 talos] [--poses 40] [--sets 20] [--held-out 300] [--stand]

Random sets are drawn uniformly in the same joint limits and kept where they happen to be balanced
with the same margin (both feet: after closing the legs), one third of them in every support.
``worst`` is the standard error of the worst identifiable combination of unit length in scaled
unknowns (0.1 m times the body's mass), ``com z`` that of total CoM heights over held-out uniform
poses, ``bound`` a lower limit of the latter for any set from the planner's own candidates.
``--stand`` lets every planned pose stand in MuJoCo.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "oracles"))

from humanoids import HUMANOIDS, write_humanoid

from comcal.errors import ComcalError
from comcal.identify.unknowns import Unknowns, unknowns_of
from comcal.measure.plan import PlannedPose
from comcal.plan.bound import worst_sigma
from comcal.plan.candidates import Pool, random_pool
from comcal.plan.com_height import height_gradients, height_sigma
from comcal.plan.design import Goal
from comcal.plan.information import information_roots
from comcal.plan.rules import Rules, rules_of
from comcal.plan.search import determined, search
from comcal.robot.description import load_robot
from comcal.robot.model import Robot
from comcal.robot.tree import Array
from comcal_sims.mujoco_world import MujocoWorld

SUPPORTS = ("double", "left", "right")


def measures(roots: Array, basis: Array, heights: Array) -> tuple[float, float]:
    """Return the worst combination's and the CoM heights' standard errors (0.1 m; mm)."""
    F = (roots @ basis).reshape(-1, basis.shape[1])
    M = F.T @ F
    return worst_sigma(M), 1e3 * height_sigma(heights, M, basis)


def random_sets(
    rules: Rules, unknowns: Unknowns, poses: int, sets: int, rng: np.random.Generator
) -> list[Array]:
    """Return the rows of random sets, the supports mixed evenly."""
    each = -(-poses // len(SUPPORTS))
    found = []
    for _ in range(sets):
        pool = random_pool(rules, each, rng, uniform=True)
        # 42 poses for 40: the two too many go by chance.
        found.append(information_roots(unknowns, pool.select(rng.permutation(len(pool))[:poses])))
    return found


def standing(robot: Robot, poses: Pool) -> int:
    """Return how many poses stand in MuJoCo; say of the others why not."""
    count = 0
    with MujocoWorld(robot) as world:
        for i, (support, q) in enumerate(zip(poses.support, poses.q, strict=True), start=1):
            try:
                world.place(PlannedPose(i, q, support))
                count += 1
            except ComcalError as refusal:
                print(f"  {refusal}")
    return count


def compare(name: str, poses: int, sets: int, held_out: int, stand: bool) -> None:
    with tempfile.TemporaryDirectory() as folder:
        robot = load_robot(write_humanoid(name, Path(folder)))
    rules = rules_of(robot, SUPPORTS, margin=0.015, share=0.95)
    unknowns = unknowns_of(robot)
    rng = np.random.default_rng(7)
    start = time.perf_counter()
    held = random_pool(rules, -(-held_out // len(SUPPORTS)), rng, uniform=True)
    drawn = random_sets(rules, unknowns, poses, sets, rng)
    basis = determined(unknowns, held)
    heights = height_gradients(unknowns, held)
    medians = np.median([measures(roots, basis, heights) for roots in drawn], axis=0)
    spent = time.perf_counter() - start
    print(
        f"{name}: {robot.tree.total_mass:.1f} kg, {len(robot.tree.joint_names)} joints, "
        f"{unknowns.size} unknowns, rank {basis.shape[1]}, {poses} poses"
    )
    print(
        f"  {'set':22s}{'worst':>8s}{'better':>8s}{'com z mm':>10s}{'better':>8s}"
        f"{'efficiency':>12s}{'time s':>8s}{'stand':>8s}"
    )
    print(
        f"  {f'random, median of {sets}':22s}{medians[0]:8.3f}{'':8s}{medians[1]:10.3f}"
        f"{'':20s}{spent:8.1f}"
    )
    for goal in Goal:
        start = time.perf_counter()
        found = search(rules, unknowns, poses, np.random.default_rng(1), goal=goal)
        spent = time.perf_counter() - start
        worst, z = measures(information_roots(unknowns, found.poses), basis, heights)
        stands = f"{standing(robot, found.poses)}/{poses}" if stand else "-"
        print(
            f"  {'planned, ' + goal.value:22s}{worst:8.3f}{medians[0] / worst:8.2f}{z:10.3f}"
            f"{medians[1] / z:8.2f}{found.efficiency:12.2f}{spent:8.1f}{stands:>8s}"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("robots", nargs="*", default=list(HUMANOIDS)[::-1])
    parser.add_argument("--poses", type=int, default=40)
    parser.add_argument("--sets", type=int, default=20)
    parser.add_argument("--held-out", type=int, default=300)
    parser.add_argument("--stand", action="store_true")
    given = parser.parse_args()
    for name in given.robots:
        compare(name, given.poses, given.sets, given.held_out, given.stand)


if __name__ == "__main__":
    main()
