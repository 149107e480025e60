# SPDX-License-Identifier: Apache-2.0
"""A simulated biped with devices on a bus, and emulated robots made of it."""

from __future__ import annotations

import json
import logging
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from comcal.measure.plan import PlannedPose
from comcal.measure.plan_csv import read_plan
from comcal.measure.source import SourceRequest
from comcal.robot.description import load_robot
from comcal.robot.model import Robot
from comcal.workflow.sources import open_source
from comcal_drivers.devices.configuration import (
    BusConfig,
    CanConfig,
    DeviceConfig,
    JointConfig,
    SensorConfig,
)
from comcal_drivers.devices.description import load_device
from comcal_drivers.emulator.registry import emulate_all
from comcal_drivers.emulator.robot import Behaviour, EmulatedRobot
from comcal_sims.robots import biped14

logging.getLogger("can.interfaces.socketcand").setLevel(logging.ERROR)  # it warns of every packet

FAST = {**os.environ, "OMP_NUM_THREADS": "1"}
PATIENCE = 20.0


class Biped:
    """A robot, its plan and its file; no dataclass, which hypothesis would print in full."""

    def __init__(self, yaml: Path) -> None:
        self.yaml = yaml
        self.robot: Robot = load_robot(yaml)
        names = self.robot.tree.joint_names
        self.plan: tuple[PlannedPose, ...] = read_plan(yaml.parent / "plan.csv", names)

    def sensor(self, device: str, name: str = "l_foot", **settings: object) -> SensorConfig:
        """A force/torque sensor on the bus can0."""
        ids = settings.pop("ids", None)
        return SensorConfig(name, "can0", load_device(device, ids), **settings)  # type: ignore[arg-type]

    def drive(self, device: str, joint: str = "l_knee", **settings: object) -> JointConfig:
        """A drive on the bus can0."""
        ids = settings.pop("ids", None)
        counts = {"counts_per_turn": 4096.0, "gear": 50.0, **settings}
        return JointConfig(joint, "can0", load_device(device, ids), **counts)  # type: ignore[arg-type]

    def config(self, *devices: DeviceConfig) -> CanConfig:
        """What robot.yaml would say about these devices."""
        sensors = {d.name: d for d in devices if isinstance(d, SensorConfig)}
        joints = {d.name: d for d in devices if isinstance(d, JointConfig)}
        buses = {d.bus: BusConfig(d.bus, "virtual", d.bus) for d in devices}
        return CanConfig(buses, sensors, joints, None, devices[0].name)

    def emulated(
        self,
        *devices: DeviceConfig,
        started: bool = True,
        seed: int = 1,
        plan: tuple[PlannedPose, ...] = (),
        **behaviour: float,
    ) -> EmulatedRobot:
        """A robot with these devices, which stands nowhere yet."""
        buses = emulate_all(self.config(*devices), self.robot, started=started)
        source = open_source("builtin", SourceRequest(self.robot, seed))
        return EmulatedRobot(source, plan or self.plan, buses, replace(Behaviour(), **behaviour))


SOURCES = """
sources:
  can:
    buses:
      can0: {interface: socketcan, channel: can0, bitrate: 1000000}
    clock: l_foot
    sensors:
      l_foot: {bus: can0, device: jr3_uc3m, ids: {id: 1}, period: 0.008333333333333333}
      r_foot: {bus: can0, device: iit_strain, ids: {board: 2}}
    joints:
      l_knee: {bus: can0, device: cia402, ids: {node: 11}, counts_per_turn: 4096}
"""


@pytest.fixture(scope="session")
def biped(tmp_path_factory: pytest.TempPathFactory) -> Biped:
    path = biped14.generate(tmp_path_factory.mktemp("biped14"))
    path.write_text(path.read_text() + SOURCES)
    return Biped(path)


@dataclass(frozen=True)
class Process:
    """An emulator process and how to reach its buses."""

    popen: subprocess.Popen[str]
    buses: dict[str, dict[str, object]]


@pytest.fixture(scope="session")
def emulators(biped: Biped) -> Callable[..., object]:
    """Start emulator processes, all at once; they are gone after the ``with``."""

    @contextmanager
    def start(*commands: tuple[str, ...]) -> Iterator[list[Process]]:
        head = [sys.executable, "-m", "comcal_drivers.emulator", str(biped.yaml)]
        with ExitStack() as stack:
            popens = [stack.enter_context(_started([*head, *command])) for command in commands]
            yield [Process(popen, json.loads(_first_line(popen))["buses"]) for popen in popens]

    return start


@contextmanager
def _started(command: list[str]) -> Iterator[subprocess.Popen[str]]:
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True, env=FAST) as popen:
        try:
            yield popen
        finally:
            popen.terminate()
            try:
                popen.wait(PATIENCE)
            except subprocess.TimeoutExpired:
                popen.kill()
                raise


def _first_line(popen: subprocess.Popen[str]) -> str:
    if popen.stdout is None or popen.stderr is None:
        pytest.fail("the process has no output")
    return popen.stdout.readline() or pytest.fail(popen.stderr.read())
