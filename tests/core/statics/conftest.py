# SPDX-License-Identifier: Apache-2.0
"""Trees of any shape, with Pinocchio as the oracle."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest


@pytest.fixture(scope="session")
def pinocchio_oracle() -> Iterator[ModuleType]:
    """Random trees and what Pinocchio says of them: ``tests/oracles/random_trees.py``."""
    pytest.importorskip("pinocchio")
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(Path(__file__).resolve().parents[2] / "oracles"))
        yield importlib.import_module("random_trees")
