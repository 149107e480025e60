# SPDX-License-Identifier: Apache-2.0
"""A biped calibrated over a bus gives what the simulation gives, up to the devices' last bit."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from comcal.cli.main import main

pytestmark = pytest.mark.slow

STEP = {"ft": 0.5, "q": 2 * np.pi / 65536 / 80, "i": 1e-3}
"""Largest steps of the devices: forces and moments [N, N m], angles [rad], currents [A]."""


@pytest.fixture(scope="module")
def direct(robot, record) -> Path:
    assert record(robot, "direct", "builtin", robot.yaml, "--seed", "3") == 0
    return robot.folder / "direct"


@pytest.mark.parametrize("adapter", ["slcan", "socketcand", "virtual"])
def test_what_comes_over_a_bus_is_what_was_measured(
    adapter, direct, recorded_over, numbers
) -> None:
    header, found = numbers(recorded_over(adapter))
    names, wanted = numbers(direct)
    shared = [name for name in names if name in header and name.startswith(tuple(STEP))]
    assert {name.partition(".")[0] for name in shared} == set(STEP)
    for name in shared:
        a, b = found[:, header.index(name)], wanted[:, names.index(name)]
        step = STEP[name.partition(".")[0]]
        np.testing.assert_allclose(a, b, atol=0.51 * step, err_msg=name)
        assert name.startswith("q") or not np.array_equal(a, b), f"{name} was not quantised"


def test_all_paths_give_the_same_numbers_to_the_last_bit(robot, record, recorded_over, numbers):
    over_slcan = recorded_over("slcan")
    header, first = numbers(over_slcan)
    replay = record(robot, "replay", f"replay:{over_slcan}", robot.yaml)
    assert replay == 0
    for other in (recorded_over("socketcand"), recorded_over("virtual"), robot.folder / "replay"):
        names, second = numbers(other)
        assert names == header
        np.testing.assert_array_equal(second, first, err_msg=str(other))


def test_the_calibration_is_that_of_the_simulation(direct, recorded_over, capsys) -> None:
    results = []
    for session in (direct, recorded_over("slcan")):
        capsys.readouterr()
        assert main(["solve", str(session), "--json"]) in (0, 5)
        results.append(json.loads(capsys.readouterr().out))
    one, other = results
    assert one["rank"] == other["rank"]
    for a, b in zip(one["total_com"], other["total_com"], strict=True):
        np.testing.assert_allclose(a["xyz"], b["xyz"], atol=5e-4)
    assert one["mass"]["value"] == pytest.approx(other["mass"]["value"], abs=0.02)
