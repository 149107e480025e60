# SPDX-License-Identifier: Apache-2.0
"""A biped whose sensors and drives speak on one bus, emulated in a process of its own."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from comcal.cli.main import main
from comcal_drivers.emulator.opening import Options, RunningEmulator
from comcal_sims.robots import biped14

SENSORS = {"l_foot": 0x70, "r_foot": 0x71}
POSES = 12
SEED = 3
START = 30.0
"""How long the emulator may take to say where it is [s]."""

Connections = Mapping[str, Mapping[str, object]]


def with_buses(text: str, joints: Sequence[str]) -> str:
    """The robot's description with its devices; TTY stands for the interface."""
    lines = ["sources:", "  can:", "    buses:", "      can0: INTERFACE", "    sensors:"]
    for name, number in SENSORS.items():
        lines.append(
            f"      {name}: {{bus: can0, device: jr3_uc3m, ids: {{id: {number}}}, "
            "period: 0.00833333333333, timeout: 0.5}"
        )
    lines.append("    joints:")
    for node, name in enumerate(joints, start=1):
        lines.append(
            f"      {name}: {{bus: can0, device: maxon_epos, ids: {{node: {node}}}, "
            "counts_per_turn: 65536, timeout: 0.5}"
        )
    return text.rstrip() + "\n" + "\n".join(lines) + "\n"


class Robot:
    """The description, its plan, and what to put in place of the interface."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        generated = biped14.generate(folder)
        joints = [
            line.strip().partition(":")[0]
            for line in generated.read_text("utf-8").partition("motors:")[2].splitlines()
            if "torque_constant" in line
        ]
        self._text = with_buses(generated.read_text("utf-8"), joints)
        plan = (folder / "plan.csv").read_text("utf-8").splitlines()
        self.plan = folder / "some.csv"
        self.plan.write_text("\n".join(plan[: POSES + 1]) + "\n", "utf-8")
        self.yaml = self.at({"interface": "virtual", "channel": "nowhere"}, "robot.yaml")

    def at(self, connection: Mapping[str, object], name: str) -> Path:
        """Write the description of the robot on that bus."""
        path = self.folder / name
        entry = {**connection, "bitrate": 1_000_000}
        path.write_text(self._text.replace("INTERFACE", json.dumps(entry)), "utf-8")
        return path


@pytest.fixture(scope="session")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    return Robot(tmp_path_factory.mktemp("robot"))


@contextmanager
def emulated(robot_yaml: Path, adapter: str, plan: Path, *more: str) -> Iterator[Connections]:
    """Run the emulator as long as the block lasts; a virtual bus needs it in this process."""
    if adapter == "virtual":
        options = Options(robot_yaml, plan=plan, seed=SEED, rate=0.0, slot=0, started=True)
        with RunningEmulator(options) as buses:
            yield buses
        return
    words = [sys.executable, "-m", "comcal_drivers.emulator", str(robot_yaml)]
    words += ["--adapter", adapter, "--plan", str(plan), "--seed", str(SEED), "--rate", "0"]
    process = subprocess.Popen(
        [*words, "--started", "--slot", "0", *more], stdout=subprocess.PIPE, text=True
    )
    try:
        assert process.stdout is not None
        yield json.loads(process.stdout.readline())["buses"]
    finally:
        process.terminate()
        process.wait(10.0)
        if process.stdout is not None:
            process.stdout.close()


@pytest.fixture(scope="session")
def emulator() -> Callable[..., object]:
    return emulated


@pytest.fixture(scope="session")
def record() -> Callable[..., int]:
    """``comcal record`` of a session folder beside the robot."""

    def run(robot: Robot, name: str, source: str, robot_yaml: Path, *more: str) -> int:
        words = ["record", str(robot_yaml), "-s", str(robot.folder / name), "--source", source]
        return main([*words, "--poses", str(robot.plan), *more])

    return run


@pytest.fixture(scope="session")
def recorded_over(robot: Robot, record: Callable[..., int]) -> Callable[[str], Path]:
    """Record over an adapter, once in a session."""
    known: dict[str, Path] = {}

    def over(adapter: str) -> Path:
        if adapter not in known:
            with emulated(robot.yaml, adapter, robot.plan) as buses:
                there = robot.at(buses["can0"], f"robot_{adapter}.yaml")
                moved = ("--commander", "emulated", "--yes")
                assert record(robot, adapter, "can", there, *moved) == 0
            known[adapter] = robot.folder / adapter
        return known[adapter]

    return over


@pytest.fixture(scope="session")
def numbers() -> Callable[[Path], tuple[list[str], np.ndarray]]:
    """Everything that was measured: all columns but the clock's, as numbers."""

    def of(session: Path) -> tuple[list[str], np.ndarray]:
        lines = (session / "poses.csv").read_text("utf-8").splitlines()
        header = lines[0].split(",")
        kept = [k for k, name in enumerate(header) if name not in ("support", "t", "use")]
        rows = [line.split(",") for line in lines[1:]]
        return [header[k] for k in kept], np.array(
            [[float(row[k]) if row[k] else np.nan for k in kept] for row in rows]
        )

    return of
