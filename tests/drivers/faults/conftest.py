# SPDX-License-Identifier: Apache-2.0
"""The scenarios of the study of bus faults, for tests."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from copy import deepcopy
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

STUDIES = Path(__file__).resolve().parents[2] / "studies"
MASTER = 7


@pytest.fixture(scope="session")
def study() -> Iterator[ModuleType]:
    """The study as a module."""
    sys.path.insert(0, str(STUDIES))
    try:
        yield import_module("bus_faults")
    finally:
        sys.path.remove(str(STUDIES))


@pytest.fixture(scope="session")
def scenario(
    study: ModuleType, tmp_path_factory: pytest.TempPathFactory
) -> Callable[[str, str], dict[str, Any]]:
    """Run a scenario; one whose fault does not reach the reader is followed by the next."""
    home = tmp_path_factory.mktemp("faults")

    def run(kind: str, path: str) -> dict[str, Any]:
        for index in range(4):
            record = study.run_one(kind, path, index, MASTER, str(home))
            if record["reached"]:
                return record
        pytest.fail(f"no fault of kind {kind} reached the reader over {path}")

    return run


@pytest.fixture(scope="session")
def judged(study: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Any]:
    """Change what was seen of a scenario, and judge that."""

    drawn = study.draw("saturate", "replay", 0, MASTER)
    robot = study.robot_of(drawn, tmp_path_factory.mktemp("robots"))
    watched = study.run_scenario(drawn, robot, tmp_path_factory.mktemp("judged"))

    def judge(change: Callable[[Any], None]) -> Any:
        changed = deepcopy(watched)
        change(changed)
        return study.judge(drawn, robot, changed)

    return judge
