# SPDX-License-Identifier: Apache-2.0
"""``comcal check --live`` as typed: healthy and broken sources."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from comcal.measure.source import Block, SourceRequest, SourceStatus
from comcal_sims.robots.biped14 import generate
from comcal_sims.sources import open_builtin

Run = Callable[..., tuple[int, str, str]]
Spoil = Callable[[Block], Block]


@pytest.fixture(scope="module")
def yaml(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return generate(tmp_path_factory.mktemp("biped14"))


class Broken:
    """The built-in world behind a fault."""

    def __init__(self, request: SourceRequest, spoil: Spoil, status: SourceStatus | None) -> None:
        self.world = open_builtin(request)
        self.spoil = spoil
        if status is not None:
            self.status = lambda: status

    @property
    def name(self) -> str:
        return self.world.name

    def move_to(self, pose: Any) -> None:
        self.world.move_to(pose)

    def read(self, duration: float) -> Block:
        return self.spoil(self.world.read(duration))

    def close(self) -> None:
        self.world.close()


@pytest.fixture
def live(
    yaml: Path, run: Run, monkeypatch: pytest.MonkeyPatch
) -> Callable[..., tuple[int, dict[str, Any]]]:
    """Look at a spoilt world; return the exit code and what ``--json`` says."""

    def call(spoil: Spoil = lambda block: block, status: SourceStatus | None = None) -> Any:
        monkeypatch.setattr(
            EntryPoint, "load", lambda self: lambda request: Broken(request, spoil, status)
        )
        code, out, err = run("check", yaml, "--live", "--source", "builtin", "--json")
        assert out, err
        return code, json.loads(out)

    return call


def wrenches(block: Block, change: Callable[[np.ndarray], np.ndarray], *names: str) -> Block:
    changed = {n: change(w) if n in names else w for n, w in block.wrenches.items()}
    return replace(block, wrenches=changed)


def test_a_healthy_robot_makes_sense(yaml: Path, run: Run) -> None:
    code, out, err = run("check", yaml, "--live", "--source", "builtin", "--seconds", "2")
    assert (code, err) == (0, "")
    assert out.endswith("the readings make sense\n")
    for words in ("at 120 samples/s", "N of 622", "ft.l_foot.fz", "imu.az", "inside the soles"):
        assert words in out


def test_the_channels_are_told_with_their_numbers(live: Any) -> None:
    code, found = live(status=SourceStatus({"l_foot": 998.0}, {"l_foot": 0}))
    assert code == 0
    assert found["verdict"] == "usable"
    channels = {c["channel"]: c for c in found["channels"]}
    assert channels["ft.l_foot.fz"]["state"] == "ok"
    assert channels["ft.l_foot.fz"]["sd"] == pytest.approx(0.5, rel=0.15)
    assert channels["ft.l_foot.fz"]["standard_error"] == pytest.approx(0.1, rel=0.5)
    assert found["rates"] == {"l_foot": 998.0}
    assert found["force"] == pytest.approx(found["weight"], rel=0.01)
    assert found["findings"] == []


@pytest.mark.parametrize(
    ("spoil", "code", "where", "what"),
    [
        (lambda b: wrenches(b, lambda w: w * np.nan, "r_foot"), 3, "ft.r_foot", "sends nothing"),
        (lambda b: replace(b, wrenches={"l_foot": b.wrenches["l_foot"]}), 3, "ft.r_foot", "sends"),
        (lambda b: wrenches(b, lambda w: w * 0 + 1.5, "l_foot"), 3, "ft.l_foot", "always reads"),
        (lambda b: wrenches(b, lambda w: -w, "l_foot", "r_foot"), 3, "", "pulls the feet down"),
        (lambda b: wrenches(b, lambda w: w / 9.81, "l_foot", "r_foot"), 3, "", "look like kgf"),
        (lambda b: wrenches(b, lambda w: 2 * w, "l_foot", "r_foot"), 3, "(pose 0)", "weight"),
        (lambda b: replace(b, q=np.degrees(b.q)), 3, "(pose 0)", "looks like degrees"),
        (lambda b: replace(b, imu=b.imu / 9.81), 3, "", "multiples of g"),
        (lambda b: replace(b, imu=b.imu * 1.2), 0, "imu", "does not read gravity"),
        (
            lambda b: replace(b, imu=b.imu + 0.05 * np.sin(1e4 * b.t)[:, None]),
            0,
            "imu",
            "noisier than robot.yaml",
        ),
    ],
)
def test_what_is_wrong_is_named(live: Any, spoil: Spoil, code: int, where: str, what: str) -> None:
    found_code, found = live(spoil)
    told = [(f["where"], f["what"]) for f in found["findings"]]
    assert found_code == code, told
    assert any(w == where and what in text for w, text in told), told


def test_gaps_and_losses_are_warnings(live: Any) -> None:
    def gaps(block: Block) -> Block:
        def cut(w: np.ndarray) -> np.ndarray:
            w = w.copy()
            w[::7] = np.nan
            return w

        return wrenches(block, cut, "l_foot")

    code, found = live(gaps, SourceStatus({}, {"l_foot": 12}, ("can0 was silent",)))
    assert code == 0
    told = {(f["level"], f["where"], f["what"]) for f in found["findings"]}
    assert ("warning", "ft.l_foot", "has gaps") in told
    assert ("warning", "l_foot", "has lost samples") in told
    assert ("info", "", "can0 was silent") in told


def test_a_source_that_says_nothing_is_a_hardware_error(
    yaml: Path, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    def nothing(block: Block) -> Block:
        empty = {n: w[:0] for n, w in block.wrenches.items()}
        return Block(block.t[:0], block.q[:0], empty)

    monkeypatch.setattr(
        EntryPoint, "load", lambda self: lambda request: Broken(request, nothing, None)
    )
    code, out, err = run("check", yaml, "--live", "--source", "builtin")
    assert (code, out) == (4, "")
    assert "delivers no samples" in err


def test_which_source_has_to_be_clear(yaml: Path, run: Run, tmp_path: Path) -> None:
    code, _, err = run("check", yaml, "--live")
    assert code == 2
    assert "name it with --source" in err
    code, _, err = run("check", yaml, "--source", "builtin")
    assert code == 2
    assert "--live" in err
    code, _, err = run("check", yaml, "--live", "--source", "builtin", "--support", "hands")
    assert code == 2
    assert "double, none, left, right" in err
