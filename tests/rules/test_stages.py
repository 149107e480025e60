# SPDX-License-Identifier: Apache-2.0
"""A stage of ``.ci/run`` that fails makes the whole fail, also when it runs beside others."""

from __future__ import annotations

import os
import shutil
import subprocess
import time
from pathlib import Path

import pytest

GATE = r"""
set -u
work=$1
source "$2/.ci/stages.sh"
trap leave_nothing EXIT
good() { stage "good" echo fine; optional "absent" sh -c 'echo "not | here"; exit 77'; }
bad() { stage "bad" false; stage "after it" true; }
torn() { stage "begun" true; kill -9 "$BASHPID"; }
endless() { stage "endless" sleep 60; }
for name in good bad torn endless; do beside "all $name" "$name"; done
stage "in front" true
for name in good bad torn; do joined "all $name"; done
table
echo "$failures failed"
echo "endless: ${lanes[all endless]}"
"""


@pytest.fixture(scope="module")
def said(root: Path, tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Every line of a gate with stages side by side."""
    if shutil.which("bash") is None:
        pytest.skip("no bash here")
    work = tmp_path_factory.mktemp("gate") / "work"
    work.mkdir()
    command = ["bash", "-c", GATE, "bash", str(work), str(root)]
    run = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    assert not work.exists()
    return run.stdout.splitlines()


def test_each_stage_beside_others_has_its_row(said: list[str]) -> None:
    rows = [line.split(" | ") for line in said if line.startswith("| ")][1:]
    ended = {row[0].removeprefix("| "): row[2].removesuffix(" |") for row in rows}
    assert ended == {
        "in front": "passed",
        "good": "passed",
        "absent": "skipped: not / here",
        "bad": "FAILED (1)",
        "after it": "passed",
        "all torn": "FAILED (137)",
    }


def test_what_failed_beside_others_is_counted(said: list[str]) -> None:
    assert "2 failed" in said


def test_what_was_printed_beside_others_is_shown_in_one_piece(said: list[str]) -> None:
    begin = said.index("=== good")
    assert said[begin : begin + 3] == ["=== good", "fine", "--- good: passed"]
    assert begin > said.index("--- in front: passed")


def test_nothing_outlives_the_gate(said: list[str]) -> None:
    (group,) = (line.partition(": ")[2] for line in said if line.startswith("endless: "))
    until = time.monotonic() + 10
    while is_alive(int(group)) and time.monotonic() < until:
        time.sleep(0.01)
    assert not is_alive(int(group))


def is_alive(group: int) -> bool:
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True
