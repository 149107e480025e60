# SPDX-License-Identifier: Apache-2.0
"""MF4 files cost time only those who open one, and work for everybody."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

ROUND_TRIP = """
import sys
{first}
import can
assert ("asammdf" in sys.modules) is {slow}, "asammdf"
reader = can.MF4Reader
with can.Logger({path!r}) as log:
    assert type(log) is can.MF4Writer is can.io.mf4.MF4Writer
    log(can.Message(arbitration_id=0x123, data=b"ab", timestamp=1.0, is_extended_id=False))
assert "asammdf" in sys.modules
with can.LogReader({path!r}) as log:
    assert type(log) is reader is can.MF4Reader is can.io.mf4.MF4Reader
    assert [(m.arbitration_id, bytes(m.data)) for m in log] == [(0x123, b"ab")]
"""


def run(program: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60.0, check=False
    )


@pytest.mark.parametrize(
    ("first", "slow"),
    [("import comcal_drivers", False), ("import can, comcal_drivers", True)],
)
def test_another_program_in_the_process_reads_and_writes_mf4_as_ever(
    first: str, slow: bool, tmp_path: Path
) -> None:
    done = run(ROUND_TRIP.format(first=first, slow=slow, path=str(tmp_path / "x.mf4")))
    assert done.returncode == 0, done.stderr


def test_nothing_heavy_is_imported_before_a_bus_is_opened() -> None:
    done = run(
        "import comcal_drivers.source.live, sys\n"
        "print({'asammdf', 'pandas', 'sympy', 'scipy'} & set(sys.modules))"
    )
    assert done.stdout.strip() == "set()", done.stderr


def test_without_asammdf_python_can_says_what_it_always_says() -> None:
    program = (
        "import sys, comcal_drivers, can\n"
        "sys.modules['asammdf'] = None\n"
        "try:\n    can.MF4Reader('x.mf4')\n"
        "except NotImplementedError as error:\n    print(error)"
    )
    assert "asammdf package was not found" in run(program).stdout
