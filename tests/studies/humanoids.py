# SPDX-License-Identifier: Apache-2.0
"""Published humanoids that are not what their URDF says, calibrated from poses in an engine.

    python tests/studies/humanoids.py --sample
    python tests/studies/humanoids.py --full -o FOLDER

Masses of all bodies above the feet's cuts are off by up to 10 %, their CoMs by up to 20 mm. Every
robot stands in MuJoCo once in every planned pose; draws of noise come on top. Judged are all
identifiable combinations of masses and first moments, each the unknown that leads it plus what
statics merges with it: how often their 95 % intervals hold the truth, and how their errors compare
with the Cramer-Rao bound, which an oracle computes at the truth. No prior, no inequality. The CoM
of the whole robot in other balanced poses is compared with the engine's own.

Takes half a minute (sample) or about an hour on one core (full); what is in FOLDER is not made
again. Exit code 5: a limit is not met.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # small matrices: threads only wait for one another

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from zlib import crc32

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "oracles"))

from humanoid_engine import Stood, engine_coms, off_builtin, off_statics, perturbed, pool_of, stand
from humanoid_table import Check, Row, table_lines
from humanoid_trials import Calibrations, HeldOut, calibrate, held_out_of, nominal_com
from humanoids import write_humanoid

from comcal.errors import ComcalError, MissingExtraError
from comcal.identify.scope import Scope
from comcal.identify.unknowns import unknowns_of
from comcal.plan.candidates import Pool, random_pool
from comcal.plan.rules import rules_of
from comcal.plan.search import search
from comcal.robot.description import load_robot
from comcal.robot.model import Robot

SEED = 20260714
SUPPORTS = ("double", "left", "right")
MARGIN, RANGE = 0.015, 0.95
"""Of balance [m], and the middle share of every joint's range: what ``comcal plan`` takes."""
EQUILIBRIUM = 1e-3
"""Largest difference between engine and statics [N], [N m]."""
MOST_FALLEN = 0.05
"""Share of the poses in which a robot may fall, which are then left out: its CoM is a centimetre
from where the URDF has it, the margin not much more, and servos sag."""
USES = {
    "wrenches": Scope(free_masses=True),
    "wrenches, torques": Scope(free_masses=True, torques=True),
    "wrenches, URDF masses": Scope(),
}


@dataclass(frozen=True)
class Design:
    """What is calibrated how often, and what is asked of it.

    Parameters
    ----------
    kinds : tuple of str
    robots : int
        Perturbed ones of each kind.
    poses : tuple of int
        Sizes of the sets.
    held_out : int
        Poses in each support in which the CoM is predicted.
    planned : bool
        Sets are planned; else random balanced poses.
    draws : mapping from use to mapping from number of poses to number of draws
        For every robot.
    coverage, rms_over_bound : tuple of (float, float)
        Limits of pooled numbers, for each kind, number of poses and use.
    """

    kinds: tuple[str, ...]
    robots: int
    poses: tuple[int, ...]
    held_out: int
    planned: bool
    draws: dict[str, dict[int, int]]
    coverage: tuple[float, float]
    rms_over_bound: tuple[float, float]


FULL = Design(
    kinds=("talos", "g1"),
    robots=20,
    poses=(20, 40, 100),
    held_out=20,
    planned=True,
    draws={
        "wrenches": {20: 50, 40: 50, 100: 50},
        "wrenches, torques": {40: 50},
        "wrenches, URDF masses": {20: 5, 40: 5, 100: 5},
    },
    coverage=(0.94, 0.96),
    rms_over_bound=(0.97, 1.03),
)
SAMPLE = Design(
    kinds=("talos", "g1"),
    robots=1,
    poses=(36,),
    held_out=4,
    planned=False,
    draws={"wrenches": {36: 14}, "wrenches, torques": {36: 3}},
    coverage=(0.92, 0.98),  # room for the chance of few calibrations
    rms_over_bound=(0.9, 1.1),
)


class Folder:
    """Arrays that are made once.

    Raises
    ------
    SystemExit
        If the folder holds the results of another study (exit code 2).
    """

    def __init__(self, directory: Path, design: Design, seed: int) -> None:
        self._directory = directory
        meaning = json.loads(json.dumps({"seed": seed, **asdict(design)}))
        del meaning["robots"], meaning["kinds"]  # more of them may join
        file = directory / "study.json"
        directory.mkdir(parents=True, exist_ok=True)
        if file.exists() and json.loads(file.read_text("utf-8")) != meaning:
            print(f"{directory} holds the results of another study", file=sys.stderr)
            raise SystemExit(2)
        file.write_text(json.dumps(meaning) + "\n", encoding="utf-8")

    def once(self, name: str, make: Callable[[], dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
        """Return the arrays of *name*; make and keep them if they are not there."""
        file = self._directory / f"{name}.npz"
        if not file.exists():
            file.parent.mkdir(parents=True, exist_ok=True)
            unfinished = file.with_suffix(".part")
            arrays = make()
            with unfinished.open("wb") as stream:
                np.savez(stream, **arrays)
            unfinished.replace(file)
        with np.load(file, allow_pickle=False) as kept:
            return {key: kept[key] for key in kept.files}


def generator(seed: int, *what: str | int) -> np.random.Generator:
    """Return the generator of one purpose: it does not matter what was drawn before."""
    words = [crc32(w.encode()) if isinstance(w, str) else w for w in what]
    return np.random.default_rng([seed, *words])


def pose_sets(
    robot: Robot, design: Design, seed: int, folder: Folder
) -> tuple[dict[int, Pool], Pool]:
    """Return the sets of poses by size, and those held out."""
    rules = rules_of(robot, SUPPORTS, margin=MARGIN, share=RANGE)
    unknowns = unknowns_of(robot, free_masses=True)

    def kept(what: str, make: Callable[[], Pool]) -> Pool:
        def arrays() -> dict[str, np.ndarray]:
            print(f"{robot.name}: {what}", file=sys.stderr, flush=True)
            pool = make()
            return {"support": np.array(pool.support), "q": pool.q}

        found = folder.once(f"{robot.name}/{what}", arrays)
        return pool_of(found["support"], found["q"])

    def drawn(n: int) -> Pool:
        rng = generator(seed, robot.name, "plan", n)
        if design.planned:
            return search(rules, unknowns, n, rng).poses
        return random_pool(rules, -(-n // len(SUPPORTS)), rng)

    rng = generator(seed, robot.name, "held out")
    held_out = kept("held_out", lambda: random_pool(rules, design.held_out, rng))
    return {n: kept(f"poses_{n}", lambda n=n: drawn(n)) for n in design.poses}, held_out


def stood_in(true: Robot, poses: Pool, folder: Folder, name: str) -> Stood:
    """Return what the engine says, from the folder where it was asked before."""

    def make() -> dict[str, np.ndarray]:
        found = stand(true, poses)
        return {f.name: np.asarray(getattr(found, f.name)) for f in fields(found)}

    at = folder.once(name, make)
    support = tuple(str(s) for s in at["support"])
    return Stood(support, at["q"], at["wrench"], at["torque"], at["root"], int(at["fallen"]))


def calibrations_of(make: Callable[[], Calibrations], folder: Folder, name: str) -> Calibrations:
    """Return calibrations, from the folder where they were made before."""

    def arrays() -> dict[str, np.ndarray]:
        found = make()
        return {f.name: np.asarray(getattr(found, f.name)) for f in fields(found)}

    at = folder.once(name, arrays)
    names = tuple(str(n) for n in at.pop("names"))
    return Calibrations(names, **at)


def run_kind(
    robot: Robot, design: Design, seed: int, folder: Folder
) -> tuple[list[Row], list[Check]]:
    """Let perturbed robots of one kind stand and be calibrated."""
    sets, held_out_poses = pose_sets(robot, design, seed, folder)
    unknowns = unknowns_of(robot, free_masses=True)
    cells: dict[tuple[str, int], list[Calibrations]] = {
        (use, n): [] for use, by_n in design.draws.items() for n in by_n
    }
    nominal = list[np.ndarray]()
    statics, builtin, fallen, count = np.zeros(2), np.zeros(2), 0, 0
    for i in range(design.robots):
        place, start = f"{robot.name}/robot_{i:02d}", time.monotonic()
        true = perturbed(unknowns, generator(seed, robot.name, "robot", i))
        com = folder.once(
            f"{place}/held_out", lambda true=true: {"com": engine_coms(true, held_out_poses)}
        )["com"]
        held_out = held_out_of(robot, held_out_poses, com)
        nominal.append(nominal_com(robot, held_out))
        for n, poses in sets.items():
            stood = stood_in(true, poses, folder, f"{place}/stood_{n}")
            statics = np.maximum(statics, off_statics(true, stood))
            builtin = np.maximum(builtin, off_builtin(true, stood))
            fallen, count = fallen + stood.fallen, count + len(poses)
            for use, by_n in design.draws.items():
                if n in by_n:
                    found = calibrations_of(
                        _calibrating(robot, true, stood, held_out, use, (seed, i, n, by_n[n])),
                        folder,
                        f"{place}/{use.replace(', ', '_').replace(' ', '_')}_{n}",
                    )
                    cells[use, n].append(found)
        print(f"{place}: {time.monotonic() - start:.0f} s", file=sys.stderr, flush=True)
    rows = [
        Row(robot.name, n, use, tuple(found), tuple(nominal)) for (use, n), found in cells.items()
    ]
    return rows, _engine_checks(robot.name, statics, builtin, fallen, count)


def _calibrating(
    robot: Robot,
    true: Robot,
    stood: Stood,
    held_out: HeldOut,
    use: str,
    which: tuple[int, int, int, int],
) -> Callable[[], Calibrations]:
    seed, i, n, draws = which
    rngs = [generator(seed, robot.name, "noise", use, i, n, d) for d in range(draws)]
    return lambda: calibrate(robot, true, stood, held_out, USES[use], rngs)


def _engine_checks(
    kind: str, statics: np.ndarray, builtin: np.ndarray, fallen: int, count: int
) -> list[Check]:
    limit = f"{EQUILIBRIUM:g} N, N m"

    def check(what: str, off: np.ndarray) -> Check:
        found = f"{off[0]:.1e} N, {off[1]:.1e} N m"
        return Check(f"{kind}: engine against {what}", found, limit, bool(max(off) <= EQUILIBRIUM))

    return [
        check("statics, all rows", statics),
        check("built-in world", builtin),
        Check(
            f"{kind}: poses in which a robot fell",
            f"{fallen} of {count}",
            f"{100 * MOST_FALLEN:g} %",
            fallen <= MOST_FALLEN * count,
        ),
    ]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the study and print its table; return the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    size = parser.add_mutually_exclusive_group(required=True)
    size.add_argument("--sample", action="store_true", help="few calibrations from random poses")
    size.add_argument("--full", action="store_true", help="everything; needs -o")
    parser.add_argument("-o", "--output", type=Path, help="folder of engine data and fits")
    parser.add_argument("--seed", type=int, default=SEED, help="master seed")
    parser.add_argument("--robots", type=int, help="perturbed robots of each kind")
    given = parser.parse_args(arguments)
    if given.full and given.output is None:
        parser.error("--full needs -o FOLDER: it takes long, and goes on where it was stopped")
    design = FULL if given.full else SAMPLE
    if given.robots is not None:
        design = Design(**{**vars(design), "robots": given.robots})
    with tempfile.TemporaryDirectory() as scratch:
        directory = given.output or Path(scratch)
        folder = Folder(directory, design, given.seed)
        rows, checks = list[Row](), list[Check]()
        for kind in design.kinds:
            try:
                yaml = write_humanoid(kind, directory / kind)
            except LookupError as absent:
                print(absent, file=sys.stderr)
                return MissingExtraError.exit_code
            try:
                found, engine = run_kind(load_robot(yaml), design, given.seed, folder)
            except ComcalError as refusal:
                print(refusal, file=sys.stderr)
                return refusal.exit_code
            rows += found
            checks += engine
    lines, judged = table_lines(rows, design.coverage, design.rms_over_bound)
    checks += judged
    print(
        f"master seed {given.seed}; {design.robots} perturbed robots of each kind; "
        f"{'planned' if design.planned else 'random balanced'} poses\n"
    )
    print("\n".join(lines), end="\n\n")
    for check in checks:
        verdict = "ok    " if check.passed else "MISSED"
        print(f"{verdict} {check.what}: {check.found} (limit {check.limit})")
    missed = sum(not check.passed for check in checks)
    print(f"\n{'PASSED' if not missed else f'FAILED: {missed} limits are not met'}")
    return 5 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
