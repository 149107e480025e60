# SPDX-License-Identifier: Apache-2.0
"""``comcal study``: what it prints, its exit codes, and that ``kill -9`` loses nothing finished."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from comcal.cli.main import main

STUDY = """\
format: comcal-study/1
name: little
robots:
  - name: table1
noise:
  - {name: realistic}
seeds: {master: [7], count: 60}
limits: {coverage: [0, 1]}
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "little.yaml").write_text(STUDY)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def start(folder: Path) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "comcal", "study", "little.yaml", "--workers", "1"]
    return subprocess.Popen(
        command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True
    )


def wait_for_results(folder: Path, process: subprocess.Popen[bytes]) -> None:
    until = time.monotonic() + 60
    results = folder / "little" / "results.jsonl"
    while not results.exists() or results.stat().st_size == 0:
        assert process.poll() is None, process.stderr.read() if process.stderr else b""
        assert time.monotonic() < until
        time.sleep(0.02)


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT])
def test_what_was_finished_when_it_was_stopped_is_kept_and_nobody_stays_behind(
    folder: Path, how: signal.Signals, capsys: pytest.CaptureFixture[str]
) -> None:
    process = start(folder)
    wait_for_results(folder, process)
    os.kill(process.pid, how)
    _, said = process.communicate(timeout=30)
    if how is signal.SIGINT:
        assert process.returncode == 130
        assert b"the same command goes on" in said
    kept = (folder / "little" / "results.jsonl").read_bytes()
    kept = kept[: kept.rfind(b"\n") + 1]
    assert 0 < kept.count(b"\n") < 60

    # The workers share the process group of the command that is gone.
    until = time.monotonic() + 10
    while is_alive(process.pid) and time.monotonic() < until:
        time.sleep(0.05)
    assert not is_alive(process.pid)

    wanted = kept.count(b"\n") + 1
    code = main(["study", "little.yaml", "--json", "--workers", "1", "--limit", str(wanted)])
    assert code in (0, 5)
    assert json.loads(capsys.readouterr().out)["pooled"][-1]["calibrations"] == wanted
    lines = (folder / "little" / "results.jsonl").read_bytes().splitlines()
    assert set(kept.splitlines()) <= set(lines)
    assert len(lines) == len({json.loads(line)["index"] for line in lines})


def is_alive(group: int) -> bool:
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


def test_report_names_every_quantity_and_a_missed_limit_is_exit_code_5(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "little.yaml").write_text(STUDY.replace("[0, 1]", "[0, 0.5]"))
    assert main(["study", "little.yaml", "--limit", "4", "--workers", "1"]) == 5
    out = capsys.readouterr().out
    assert out.startswith("little: 4 calibrations, master seeds 7\n")
    for name in ("mass", "waist.x", "l_shin.z"):
        assert f"\n  {name} " in out
    assert "\nFAILED  coverage of 95 % intervals, pooled: " in out
    assert "limit 0 to 50 %\n" in out
    assert "\nVerdict: failed.\n" in out
    summary = json.loads((folder / "little" / "summary.json").read_text())
    assert summary["verdict"] == "failed"
    assert main(["study", "little.yaml", "--limit", "4", "--json"]) == 5
    assert json.loads(capsys.readouterr().out) == summary


def test_study_that_does_not_exist_is_exit_code_2(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["study", "larger.yaml"]) == 2
    assert "larger.yaml: there is no such file" in capsys.readouterr().err
    assert not (folder / "larger").exists()
