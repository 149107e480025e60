# SPDX-License-Identifier: Apache-2.0
"""What every test shares: deterministic hypothesis, and the folder of real measurements."""

from __future__ import annotations

import gc
import os
import signal
from collections.abc import Callable
from importlib import metadata
from pathlib import Path

import hypothesis
import pytest

ROOT = Path(__file__).resolve().parent.parent

# A test run in the background of a shell, or under nohup, ignores these; the programs that tests
# start and interrupt must not inherit that.
for _ignored in (signal.SIGINT, signal.SIGHUP, signal.SIGTERM):
    if signal.getsignal(_ignored) is signal.SIG_IGN:
        signal.signal(_ignored, signal.SIG_DFL)

# Programs under test write as wide as they do into a file, whatever terminal runs the tests.
os.environ.pop("COLUMNS", None)

# The same examples on every machine; `--hypothesis-profile=random` draws new ones.
_COMMON = {"deadline": None, "print_blob": True}
hypothesis.settings.register_profile("fixed", derandomize=True, database=None, **_COMMON)
hypothesis.settings.register_profile("random", **_COMMON)
hypothesis.settings.load_profile("fixed")


def pytest_collection_finish() -> None:
    """Keep the garbage collector away from thousands of tests and modules that stay to the end."""
    gc.collect()
    gc.freeze()


def pytest_report_header(config: pytest.Config) -> list[str]:
    profile = config.getoption("--hypothesis-profile", None) or "fixed"
    shared = _shared()
    found = "found" if shared.is_dir() else f"none at {shared}, their tests skip"
    return [
        f"seeds: every test seeds its own generator; hypothesis profile {profile!r}"
        + (" (derandomised: the same examples every time)" if profile == "fixed" else ""),
        f"real measurements: {found}",
    ]


def _shared() -> Path:
    return Path(os.environ.get("COMCAL_SHARED") or ROOT.parent / "shared")


@pytest.fixture(scope="session")
def root() -> Path:
    """The project's folder."""
    return ROOT


@pytest.fixture(scope="session")
def shared_dir() -> Path:
    """The folder of real measurements; the test skips, saying so, where there is none."""
    shared = _shared()
    if not shared.is_dir():
        pytest.skip(f"no real measurements at {shared}; set COMCAL_SHARED to their folder")
    return shared


EXAMPLE_URDFS = {
    "talos": "talos_data/robots/talos_reduced.urdf",
    "g1": "g1_description/urdf/g1_29dof_rev_1_0.urdf",
    "icub": "icub_description/robots/icub.urdf",
    "romeo": "romeo_description/urdf/romeo.urdf",
}
"""Published humanoids, in the package example-robot-data."""


@pytest.fixture(scope="session")
def example_urdf() -> Callable[[str], Path]:
    """Return the path of a published humanoid's URDF by its short name; skips where absent."""

    def find(name: str) -> Path:
        try:
            package = metadata.distribution("example-robot-data")
        except metadata.PackageNotFoundError:
            pytest.skip("example-robot-data is not installed: no published robots here")
        wanted = EXAMPLE_URDFS[name]
        found = next(f for f in package.files or () if str(f).endswith(wanted))
        return Path(str(package.locate_file(found)))

    return find
