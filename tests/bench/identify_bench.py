# SPDX-License-Identifier: Apache-2.0
"""Seconds for identifying every body of talos from 1000 poses on one foot.

    python tests/bench/identify_bench.py [--poses 1000]

132 unknowns (mass and first moment of 33 bodies), force plate under the standing foot, level floor;
the time includes the rank decision, the base parameters, their covariance and that of every
prediction. Beside it a dense least squares of the same rows, by singular values, as one would type
it: without weights, covariance or rank decision.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "oracles"))

import humanoids

from comcal.identify.adjust import Adjustment, adjust
from comcal.identify.linearise import linearise
from comcal.identify.scope import Scope, scoped
from comcal.measure.table import PoseTable
from comcal.robot.description import load_robot
from comcal.robot.kinematics import place_links
from comcal.robot.model import Plate, Robot

LIMIT = 0.2
SEED = 20261122
FORCE, MOMENT, ENCODER = 0.1, 0.01, 3e-4


def plated(name: str) -> Robot:
    """A published humanoid with force plates instead of foot sensors: nothing is below a cut."""
    with tempfile.TemporaryDirectory() as folder:
        robot = load_robot(humanoids.write_humanoid(name, Path(folder)))
    feet = {side: replace(foot, sensor=None) for side, foot in robot.feet.items()}
    plates = {side: Plate(side, foot.link, (side,)) for side, foot in feet.items()}
    return replace(robot, sensors={}, feet=feet, plates=plates)


def standing(robot: Robot, n: int, rng: np.random.Generator) -> PoseTable:
    """What the plate under the left foot reads in random poses on level floor."""
    tree = robot.tree
    joints = [tree.joints[tree.joint_index[name]] for name in tree.joint_names]
    low = np.maximum([joint.lower for joint in joints], -1.5)
    q = rng.uniform(low, np.minimum([joint.upper for joint in joints], 1.5), (n, len(joints)))
    at = place_links(tree, q)
    R, p = at.link(robot.feet["left"].link)
    up = R[:, :, 2]
    arm = at.total_com() - p
    weight = tree.total_mass * robot.gravity
    force = np.einsum("nji,nj->ni", R, weight * up)
    moment = np.einsum("nji,nj->ni", R, weight * np.cross(arm, up))
    sigma = np.repeat([FORCE, MOMENT], 3)
    wrench = np.concatenate([force, moment], axis=1) + sigma * rng.standard_normal((n, 6))
    nan = np.full(q.shape, np.nan)
    return PoseTable(
        pose=tuple(range(n)),
        support=("left",) * n,
        q=q + ENCODER * rng.standard_normal(q.shape),
        q_cov=np.full(q.shape, ENCODER**2),
        wrench={"left": wrench},
        wrench_cov={"left": np.tile(np.diag(sigma**2), (n, 1, 1))},
        torque=nan,
        torque_var=nan,
        current=nan,
        current_var=nan,
        com=np.full((n, 3), np.nan),
        com_var=np.full((n, 3), np.nan),
        imu=np.full((n, 3), np.nan),
        configuration=("",) * n,
        tilt=np.full(n, np.nan),
    )


def best_of(run: Callable[[], object], repeats: int = 5) -> float:
    """Return the shortest wall time [s]."""
    times: list[float] = []
    for _ in range(repeats):
        began = time.perf_counter()
        run()
        times.append(time.perf_counter() - began)
    return min(times)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--poses", type=int, default=1000)
    poses = parser.parse_args().poses
    robot = plated("talos")
    table = standing(robot, poses, np.random.default_rng(SEED))
    scope = Scope(free_masses=True)

    def identify() -> Adjustment:
        return adjust(robot, *scoped(robot, table, scope))

    fit = identify()
    unknowns, groups = scoped(robot, table, scope)
    rows = linearise(robot, unknowns, groups[0], fit.theta, groups[0].inputs)
    A, b = rows.A.reshape(-1, unknowns.size), rows.misclosure.ravel()
    ours, plain = best_of(identify), best_of(lambda: np.linalg.lstsq(A, b, rcond=1e-7))
    print(f"seed {SEED}, {poses} poses, {unknowns.size} unknowns, rank {fit.rank}")
    print(f"chi2 {fit.chi2:.0f} for {fit.dof} degrees of freedom, {fit.iterations} iterations")
    print(f"{'identification':38} {ours:7.3f} s   limit {LIMIT} s for 1000 poses")
    print(f"{'least squares of the ready rows alone':38} {plain:7.3f} s   ratio {ours / plain:.1f}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
