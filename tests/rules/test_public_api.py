# SPDX-License-Identifier: Apache-2.0
"""The public names exist, are documented, and cost nothing until they are used."""

from __future__ import annotations

import subprocess
import sys

import pytest

import comcal

HEAVY = (
    "numpy", "scipy", "sympy", "pydantic", "ruamel", "lxml", "mcap", "rich",
    "can", "cantools", "canopen", "asammdf", "pandas", "rosbags", "comcal_drivers", "comcal_sims",
)  # fmt: skip


def loaded_after(code: str) -> set[str]:
    """Return which heavy packages a fresh interpreter has imported after *code*."""
    script = f"{code}\nimport sys; print(*[m for m in {HEAVY!r} if m in sys.modules])"
    run = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=60
    )
    return set(run.stdout.splitlines()[-1].split())


@pytest.mark.parametrize("name", comcal.__all__)
def test_public_name_resolves_and_is_documented(name: str) -> None:
    value = getattr(comcal, name)
    assert (value.__doc__ or "").strip()


def test_every_public_name_has_a_module_and_no_other() -> None:
    assert set(comcal.__all__) == set(comcal._WHERE)
    assert len(set(comcal.__all__)) == len(comcal.__all__)
    assert set(comcal.__all__) <= set(dir(comcal))


def test_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no_such_name"):
        comcal.no_such_name  # noqa: B018


def test_version_is_that_of_the_distribution() -> None:
    from importlib.metadata import version

    assert comcal.__version__ == version("comcal")


def test_importing_comcal_imports_nothing_heavy() -> None:
    assert loaded_after("import comcal") == set()


def test_help_imports_nothing_heavy() -> None:
    assert loaded_after("from comcal.cli.main import main; main(['--help'])") == set()


def test_the_heavy_packages_are_seen_when_imported() -> None:
    assert loaded_after("import numpy") == {"numpy"}
