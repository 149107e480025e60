# SPDX-License-Identifier: Apache-2.0
"""A biped whose sensors and drives speak on one bus, emulated in a process of its own.

Tests here run as root where there is an interface vcan0, as in the guest of
``.ci/socketcan/guest.sh``; elsewhere they skip, saying so.

In the guest, python-can does without asammdf, which it would import for logs that nobody reads
here: with what that brings along, half a minute on one emulated core.
"""

from __future__ import annotations

import json
import os
import select
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

if "COMCAL_GUEST" in os.environ:
    sys.modules["asammdf"] = None

SENSORS = {"l_foot": 0x70, "r_foot": 0x71}
POSES = 5
SEED = 3
BITRATE = 1_000_000
PARTS_APART = 10.0
"""How far apart the parts of a sample may come [s]: a guest may have to wait for its host."""
TRIES = 3
"""The clock of a guest that had to wait jumps by seconds, and a source seems silent then: as the
message says, the same command goes on."""
SILENT = 4
START, END = 60.0, 20.0
"""How long an emulator may take to speak, and to end [s]."""

Numbers = tuple[list[str], np.ndarray]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Skip what needs SocketCAN where there is none; in the guest that is a failure."""
    interfaces = {name for _, name in socket.if_nameindex()}
    is_there = hasattr(socket, "AF_CAN") and "vcan0" in interfaces and os.geteuid() == 0
    if is_there or "COMCAL_GUEST" in os.environ:
        return
    reason = "no vcan0 here, or not root; bash .ci/socketcan/guest.sh makes a guest with both"
    for item in items:
        if Path(__file__).parent in item.path.parents:
            item.add_marker(pytest.mark.skip(reason=reason))


class Robot:
    """A generated biped with its devices, and a short plan."""

    def __init__(self, folder: Path) -> None:
        from comcal_sims.robots import biped14

        self.folder = folder
        generated = biped14.generate(folder).read_text("utf-8")
        motors = generated.partition("motors:")[2].splitlines()
        joints = [line.strip().partition(":")[0] for line in motors if "torque_constant" in line]
        entries = ["sources:", "  can:", "    buses:", "      can0: INTERFACE", "    sensors:"]
        entries += [
            f"      {name}: {{bus: can0, device: jr3_uc3m, ids: {{id: {number}}}, "
            f"period: 0.00833333333333, timeout: {PARTS_APART}}}"
            for name, number in SENSORS.items()
        ]
        entries.append("    joints:")
        entries += [
            f"      {name}: {{bus: can0, device: maxon_epos, ids: {{node: {node}}}, "
            f"counts_per_turn: 65536, timeout: {PARTS_APART}}}"
            for node, name in enumerate(joints, start=1)
        ]
        self._text = generated.rstrip() + "\n" + "\n".join(entries) + "\n"
        self.plan = folder / "some.csv"
        lines = (folder / "plan.csv").read_text("utf-8").splitlines()
        self.plan.write_text("\n".join(lines[: POSES + 1]) + "\n", "utf-8")

    def on(self, channel: str) -> Path:
        """Write the description of the robot on this interface of SocketCAN."""
        path = self.folder / f"robot_{channel}.yaml"
        bus = {"interface": "socketcan", "channel": channel, "bitrate": BITRATE}
        path.write_text(self._text.replace("INTERFACE", json.dumps(bus)), "utf-8")
        return path

    def record(self, name: str, source: str, robot_yaml: Path, *more: str) -> Path:
        """Record the plan, and return the folder of the session."""
        from comcal.cli.main import main

        session = self.folder / name
        words = ["record", str(robot_yaml), "-s", str(session), "--source", source]
        words += ["--poses", str(self.plan), *more]
        codes = [main(words)]
        while codes[-1] == SILENT and len(codes) < TRIES:
            codes.append(main(words))
        assert codes[-1] == 0, f"exit codes {codes}"
        return session

    @contextmanager
    def emulated(self, robot_yaml: Path, adapter: str) -> Iterator[Mapping[str, object]]:
        """Run the emulator as long as the block lasts; yields how to reach the bus."""
        words = [sys.executable, "-m", "comcal_drivers.emulator", str(robot_yaml)]
        words += ["--adapter", adapter, "--plan", str(self.plan), "--seed", str(SEED)]
        words += ["--rate", "0", "--started", "--slot", "0"]
        with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as process:
            try:
                assert process.stdout is not None
                assert select.select([process.stdout], [], [], START)[0], "it says nothing"
                yield json.loads(process.stdout.readline())["buses"]["can0"]
            finally:
                process.terminate()
                try:
                    process.wait(END)
                except subprocess.TimeoutExpired:
                    process.kill()


@pytest.fixture(scope="session")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    return Robot(tmp_path_factory.mktemp("robot"))


@pytest.fixture(scope="session")
def direct(robot: Robot) -> Path:
    """The session without any bus."""
    return robot.record("direct", "builtin", robot.on("vcan0"), "--seed", str(SEED))


@pytest.fixture(scope="session")
def numbers() -> Callable[[Path], Numbers]:
    """Everything that was measured: all columns but the clock's, as numbers."""

    def of(session: Path) -> Numbers:
        lines = (session / "poses.csv").read_text("utf-8").splitlines()
        header = lines[0].split(",")
        kept = [k for k, name in enumerate(header) if name not in ("support", "t", "use")]
        rows = [line.split(",") for line in lines[1:]]
        return [header[k] for k in kept], np.array(
            [[float(row[k]) if row[k] else np.nan for k in kept] for row in rows]
        )

    return of
