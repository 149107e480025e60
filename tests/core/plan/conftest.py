# SPDX-License-Identifier: Apache-2.0
"""A plan of the 14-joint biped, and published humanoids."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from comcal.identify.unknowns import Unknowns, unknowns_of
from comcal.plan.candidates import Pool, random_pool
from comcal.plan.rules import Rules, rules_of
from comcal.plan.search import Effort, Found, search
from comcal.robot.description import load_robot
from comcal.robot.model import Robot

MARGIN = 0.015
QUICK = Effort(seeds=20, grown=8, around=8, rounds=(0.2, 0.05))


@dataclass(frozen=True)
class Planning:
    """Rules, unknowns and a plan of one robot, and random poses beside it."""

    robot: Robot
    rules: Rules
    unknowns: Unknowns
    found: Found
    random: Pool

    def search(self, n: int, seed: int, **options: Any) -> Found:
        """A plan of *n* poses, after a short search."""
        rng = np.random.default_rng(seed)
        return search(self.rules, self.unknowns, n, rng, effort=QUICK, **options)


@pytest.fixture(scope="session")
def planning(biped14: Any) -> Planning:
    robot = biped14.robot
    rules = rules_of(robot, ("double", "left", "right"), margin=MARGIN)
    unknowns = unknowns_of(robot)
    found = search(rules, unknowns, 20, np.random.default_rng(1), effort=QUICK)
    return Planning(robot, rules, unknowns, found, random_pool(rules, 60, np.random.default_rng(2)))


@pytest.fixture(scope="session")
def humanoid(tmp_path_factory: pytest.TempPathFactory, root: Path) -> Callable[[str], Robot]:
    """A published humanoid by name; the test skips where its URDF is absent."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(root / "tests" / "oracles"))
        import humanoids

    def load(name: str) -> Robot:
        try:
            return load_robot(humanoids.write_humanoid(name, tmp_path_factory.mktemp(name)))
        except LookupError as absent:
            pytest.skip(str(absent))

    return load
