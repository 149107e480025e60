# SPDX-License-Identifier: Apache-2.0
"""CoM and static rows of many poses against a loop over Pinocchio; run by hand, prints a table.

    python tests/bench/statics_bench.py [--robot talos] [--poses 1000] [--rounds 20]

Both sides take turns in one process on one thread, so that they see the same load; the best of all
rounds counts. Pinocchio's loop gets its configurations as rows of one array, made beforehand, and
its regressor is a new array in every pose. Its columns are ten per body, of which statics needs
four; that cannot be asked of it.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import time
from collections.abc import Callable, Mapping
from importlib import metadata

import numpy as np
import pinocchio as pin

from comcal.robot.kinematics import place_links
from comcal.robot.urdf import read_urdf
from comcal.statics.com import com_jacobian, total_com
from comcal.statics.regressor import static_regressor

URDFS = {
    "talos": "talos_data/robots/talos_reduced.urdf",
    "g1": "g1_description/urdf/g1_29dof_rev_1_0.urdf",
    "icub": "icub_description/robots/icub.urdf",
    "romeo": "romeo_description/urdf/romeo.urdf",
}


def urdf_of(name: str) -> str:
    package = metadata.distribution("example-robot-data")
    found = next(f for f in package.files or () if str(f).endswith(URDFS[name]))
    return str(package.locate_file(found))


IN_A_ROW = 5
"""Calls before the other side's turn: what one leaves in the cache is not the other's affair."""


def best_in_turns(calls: Mapping[str, Callable[[], object]], rounds: int) -> dict[str, float]:
    """Shortest time of each call [s], in rounds in which all of them have their turn."""
    best = dict.fromkeys(calls, np.inf)
    for _ in range(rounds):
        for name, call in calls.items():
            for _ in range(IN_A_ROW):
                start = time.perf_counter()
                call()
                best[name] = min(best[name], time.perf_counter() - start)
    return best


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--robot", choices=URDFS, default="talos")
    parser.add_argument("--poses", type=int, default=1000)
    parser.add_argument("--rounds", type=int, default=20)
    options = parser.parse_args()

    path, n = urdf_of(options.robot), options.poses
    tree = read_urdf(path)
    model = pin.buildModelFromUrdf(path, pin.JointModelFreeFlyer())
    data, zero = model.createData(), np.zeros(model.nv)
    rng = np.random.default_rng(0)
    q = rng.uniform(-1.0, 1.0, (n, len(tree.joint_names)))
    bound = np.ones(model.nq)
    q_pin = np.array([pin.randomConfiguration(model, -bound, bound) for _ in range(n)])
    up = rng.normal(size=(n, 3))
    up /= np.linalg.norm(up, axis=1)[:, None]
    buffer = static_regressor(tree, q, up)

    def loop(call: Callable[[np.ndarray], object]) -> Callable[[], None]:
        def run() -> None:
            for pose in q_pin:
                call(pose)

        return run

    times = best_in_turns(
        {
            "pin com": loop(lambda x: pin.centerOfMass(model, data, x)),
            "com": lambda: total_com(tree, q),
            "pin jacobian": loop(lambda x: pin.jacobianCenterOfMass(model, data, x)),
            "jacobian": lambda: com_jacobian(tree, q),
            "pin regressor": loop(
                lambda x: pin.computeJointTorqueRegressor(model, data, x, zero, zero)
            ),
            "fresh": lambda: static_regressor(tree, q, up),
            "buffer": lambda: static_regressor(tree, q, up, out=buffer),
            "zeros": lambda: buffer.fill(0.0),
            "new zeros": lambda: np.empty_like(buffer).fill(0.0),
            "place": lambda: place_links(tree, q),
        },
        options.rounds,
    )
    per_pose = {name: 1e6 * seconds / n for name, seconds in times.items()}
    print(
        f"{options.robot}: {n} poses, {len(tree.joint_names)} joints, rows {buffer.shape[1]} x "
        f"{buffer.shape[2]}; load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores; us per pose"
    )
    print(f"{'':34}{'comcal':>8}{'pinocchio':>11}{'ratio':>7}{'required':>10}")
    for words, ours, theirs, required in (
        ("CoM", "com", "pin com", 2.0),
        ("CoM Jacobian", "jacobian", "pin jacobian", None),
        ("static regressor, freshly allocated", "fresh", "pin regressor", 2.0),
        ("static regressor, into a buffer", "buffer", "pin regressor", 4.0),
    ):
        ratio = per_pose[theirs] / per_pose[ours]
        wanted = "" if required is None else f"{required:.1f}"
        print(f"{words:35}{per_pose[ours]:7.2f}{per_pose[theirs]:11.2f}{ratio:7.2f}{wanted:>10}")
    print(
        f"writing zeros into the buffer alone {per_pose['zeros']:.2f}"
        f" ({per_pose['buffer'] / per_pose['zeros']:.1f} times that are used),"
        f" into a new array {per_pose['new zeros']:.2f}"
        f" ({per_pose['fresh'] / per_pose['new zeros']:.1f} times)"
    )
    print(f"placing all {len(tree.links)} links {per_pose['place']:.2f}")


if __name__ == "__main__":
    main()
