# SPDX-License-Identifier: Apache-2.0
"""The modules of the study of hidden effects, which are scripts beside ``tests/studies``."""

from __future__ import annotations

import importlib
import importlib.util
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest

PARTS = (
    "scenario",
    "world",
    "columns",
    "ruler",
    "draw",
    "lines",
    "judge",
    "trial",
    "rates",
    "medians",
    "table",
    "store",
)


@pytest.fixture(scope="session")
def study(root: Path) -> Iterator[SimpleNamespace]:
    """``tests/studies/hidden_*.py`` by their last words, and ``hidden.py`` as ``script``."""
    with pytest.MonkeyPatch.context() as patch:
        folder = root / "tests" / "studies"
        patch.syspath_prepend(str(folder))
        patch.setenv("OMP_NUM_THREADS", "1")  # the script would set it for good
        parts = {part: importlib.import_module(f"hidden_{part}") for part in PARTS}
        spec = importlib.util.spec_from_file_location("hidden_study", folder / "hidden.py")
        assert spec is not None
        assert spec.loader is not None
        script = importlib.util.module_from_spec(spec)
        patch.setitem(sys.modules, spec.name, script)
        spec.loader.exec_module(script)
        yield SimpleNamespace(script=script, **parts)
