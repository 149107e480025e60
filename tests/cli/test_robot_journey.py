# SPDX-License-Identifier: Apache-2.0
"""From a URDF to a better one over a CAN bus, with the commands that README names."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from comcal.robot.kinematics import place_links
from comcal.robot.urdf import read_urdf
from comcal.robot.urdf_write import InertialEdit, write_inertials
from comcal_sims.robots import biped14

POSES = 12
SENSORS = {"left_foot": 0x70, "right_foot": 0x71}
OFFSET = 12e-3
"""By how much the CoM of each link is off in the URDF, in each direction [m]."""


def misbuilt(folder: Path) -> tuple[Path, Path]:
    """Return the robot as it is and the URDF that somebody drew of it."""
    true = biped14.generate(folder / "true").with_name("biped14.urdf")
    rng = np.random.default_rng(5)
    edits = [
        InertialEdit(link.name, tuple(link.com + OFFSET * rng.standard_normal(3)))
        for link in read_urdf(true).links
        if link.mass > 0.5  # neither yokes nor soles
    ]
    drawn = folder / "biped14.urdf"
    drawn.write_bytes(write_inertials(true.read_bytes(), true.name, edits))
    return true, drawn


def fill_in(robot_yaml: Path, port: Path) -> None:
    """Do what a newcomer does: take the comment signs away, and name the own devices."""
    head, _, rest = robot_yaml.read_text("utf-8").partition("# sources:\n")
    block, blank, tail = rest.partition("\n\n")
    lines = ["sources:", *(line.removeprefix("# ") for line in block.splitlines())]
    for k, line in enumerate(lines):
        name = line.strip().partition(":")[0]
        if name == "can0":
            lines[k] = f"      can0: {{interface: slcan, channel: {port}, bitrate: 1000000}}"
        elif name in SENSORS:
            lines[k] = (
                f"      {name}: {{bus: can0, device: jr3_uc3m, ids: {{id: {SENSORS[name]}}}, "
                "period: 0.00833333333333, timeout: 0.5}"
            )
        elif "device: cia402" in line:
            more = "maxon_epos, sync_period: 0.01, timeout: 0.5"
            lines[k] = line.replace("cia402", more)
    robot_yaml.write_text(head + "\n".join(lines) + blank + tail, "utf-8")


@contextmanager
def emulator(robot_yaml: Path, plan: Path, *more: str) -> Iterator[None]:
    """Run the robot, in the folder of its robot.yaml, at three times its speed."""
    words = [sys.executable, "-m", "comcal_drivers.emulator", str(robot_yaml), *more]
    words += ["--ports", str(plan.parent), "--plan", str(plan), "--rate", "3", "--seed", "4"]
    process = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    try:
        assert json.loads(process.stdout.readline())["buses"]["can0"]["interface"] == "slcan"
        yield
    finally:
        process.terminate()
        process.wait(10.0)
        process.stdout.close()


@pytest.mark.slow
def test_a_urdf_is_mended_over_a_bus(tmp_path: Path, run) -> None:
    true, drawn = misbuilt(tmp_path)
    home = tmp_path / "home"
    home.mkdir()
    robot_yaml, session, mended = home / "robot.yaml", home / "monday", home / "mended.urdf"
    assert run("init", robot_yaml, "--urdf", drawn)[0] == 0
    fill_in(robot_yaml, home / "can0")
    assert run("check", robot_yaml)[0] == 0

    plan = home / "plan.csv"
    assert run("plan", robot_yaml, "-n", POSES, "-o", plan, "--seed", "1")[0] == 0
    # The emulated robot is built as it is, and speaks as its description says.
    built = true.parent / "built.yaml"
    built.write_text(
        robot_yaml.read_text("utf-8").replace("../biped14.urdf", "biped14.urdf"), "utf-8"
    )
    with emulator(built, plan):
        code, out, _ = run("check", robot_yaml, "--live", "--seconds", "1")
        assert code == 0, out
        moved = ("--source", "can", "--commander", "emulated", "--yes")
        code, out, err = run("record", robot_yaml, "-s", session, *moved)
        assert code == 0, err
        assert f"{POSES} poses in" in out
    assert run("solve", session, "--method", "lstsq", "--no-currents")[0] in (0, 5)
    assert run("export", session, "--urdf", mended)[0] == 0
    assert run("verify", session, "--urdf", mended)[0] == 0
    truth, before, after = (total_coms(path) for path in (true, drawn, mended))
    assert rms(after - truth) < 0.3 * rms(before - truth)


def total_coms(urdf: Path) -> np.ndarray:
    """Total CoM in the root's frame, in poses that nobody measured, shape (50, 3) [m]."""
    tree = read_urdf(urdf)
    q = 0.4 * np.random.default_rng(6).standard_normal((50, len(tree.joint_names)))
    return place_links(tree, q).total_com()


def rms(x: np.ndarray) -> float:
    return float(np.sqrt(np.mean(x**2)))
