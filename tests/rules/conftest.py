# SPDX-License-Identifier: Apache-2.0
"""The files that the rules speak about."""

from __future__ import annotations

from pathlib import Path

import pytest

LIBRARY = ("comcal", "drivers/comcal_drivers", "sims/comcal_sims")


@pytest.fixture(scope="session")
def library_files(root: Path) -> list[Path]:
    """Every module that ships."""
    return sorted(file for package in LIBRARY for file in (root / package).rglob("*.py"))


@pytest.fixture(scope="session")
def all_files(root: Path, library_files: list[Path]) -> list[Path]:
    """Every Python file of the project."""
    return [*library_files, *sorted((root / "tests").rglob("*.py"))]
