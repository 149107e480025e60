# SPDX-License-Identifier: Apache-2.0
"""Small robots whose devices speak on one bus, and everything that they can truly say.

The Table 1 robot stands on two force/torque sensors and six drives; which devices these are is the
variant. What the reader may accept is known exactly: the emulated robot says the same samples in
every pose, whatever else happens, so a value is right if it is one of them, to the last bit.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import numpy.typing as npt

from comcal.measure.plan import PlannedPose
from comcal.measure.plan_csv import read_plan
from comcal.measure.source import Block, SourceRequest
from comcal.robot.description import load_robot
from comcal.robot.model import Robot
from comcal.workflow.sources import open_source
from comcal_drivers.canopen_setup.conflicts import is_canopen
from comcal_drivers.devices.configuration import CanConfig, read_configuration
from comcal_drivers.devices.tables import bus_table
from comcal_drivers.emulator.frame import ERROR, EXTENDED, Frame
from comcal_drivers.emulator.registry import emulate_all
from comcal_drivers.emulator.robot import Behaviour, EmulatedRobot, Tick
from comcal_drivers.frames.batch import ERROR as ERROR_KIND
from comcal_drivers.frames.batch import FrameBatch
from comcal_drivers.source.stream import SampleStream
from comcal_sims.robots import table1

Array = npt.NDArray[np.float64]

BUS = "can0"
SEED = 5
PERIOD = 1.0 / 120.0
"""Of the samples of the simulated robot [s]."""
APART = 0.5 * PERIOD
"""Pause that betrays a loss where nothing is counted [s]."""
LENGTH = 2.5
"""How long a pose is streamed [s]."""
POSES = 3
"""Of which the last one is never struck: what happened before has then gone through the reader."""

_JR3 = f"device: jr3_uc3m, period: {PERIOD!r}, full_scale: [400, 400, 800, 400, 400, 400]"
_IIT = f"device: iit_strain, apart: {APART!r}, full_scale: [400, 400, 800, 40, 40, 40]"
_GAGES = "[[0.02, 0, 0, 0, 0, 0], [0, 0.02, 0, 0, 0, 0], [0, 0, 0.03, 0.001, 0, 0], \
[0, 0, 0.001, 0.002, 0, 0], [0, 0, 0, 0, 0.002, 0], [0, 0, 0, 0, 0, 0.002]]"
_ATI = f"device: ati_netcanoem, matrix: {_GAGES}, counts_per_force: 1, counts_per_torque: 1"
_RFT = f"device: robotous_rft, apart: {APART!r}"

SENSORS: Mapping[str, tuple[str, str]] = {
    "jr3+ati": (_JR3, _ATI),
    "jr3+iit": (_JR3, _IIT),
    "jr3+rft": (_JR3, _RFT),
    "iit+jr3": (_IIT, _JR3),
    "ati+rft": (_ATI, _RFT),
}
"""Devices of the left foot, which is the clock, and of the right one."""

ORDER_ONLY = ("iit_strain", "odrive_cansimple", "robotous_rft")
"""Devices whose halves bear nothing that says to which sample they belong."""
DRIVES: Mapping[str, str] = {
    "l_hip_pitch": "maxon",
    "l_knee": "odrive",
    "l_ankle_pitch": "maxon",
    "r_hip_pitch": "maxon",
    "r_knee": "odrive",
    "r_ankle_pitch": "maxon",
}
NOISE = "noise: {ft_force: 0.5, ft_moment: 0.05, encoder: 0.0, current: 0.02}"
"""Large enough that no two samples of a device are alike."""


def _sources(variant: str, *, asked: bool) -> str:
    """Return ``sources`` of robot.yaml; BUS stands for the interface."""
    begin = "" if asked else ", start: []"
    lines = ["sources:", "  can:", f"    buses: {{{BUS}: BUS}}", "    sensors:"]
    for foot, (name, device) in enumerate(
        zip(("l_foot", "r_foot"), SENSORS[variant], strict=True), start=1
    ):
        polled = asked and "ati" in device
        lines.append(
            f"      {name}: {{bus: {BUS}, {device}, timeout: 0.1{begin}{_ids(device, foot)}"
            + (", period: 0.008}" if polled else "}")
        )
    lines.append("    joints:")
    for node, (joint, kind) in enumerate(DRIVES.items(), start=1):
        device = (
            "device: maxon_epos, counts_per_turn: 65536"
            if kind == "maxon"
            else f"device: odrive_cansimple, apart: {APART!r}"
        )
        if asked and node == 1:
            device += ", sync_period: 0.008"
        # 0x181 to 0x186 of CANopen, from 0x2E9 on of CANSimple.
        node = node if kind == "maxon" else node + 0x20
        lines.append(
            f"      {joint}: {{bus: {BUS}, {device}, ids: {{node: {node}}}, timeout: 0.1{begin}}}"
        )
    return "\n".join(lines) + "\n"


def _ids(device: str, foot: int) -> str:
    if "jr3" in device:
        return f", ids: {{id: {0x70 + foot}}}"
    if "iit" in device:
        return f", ids: {{board: {8 + foot}}}"
    if "ati" in device:
        return ", ids: {base: 0x78}"
    return ""


@dataclass(frozen=True)
class Truth:
    """All that is ever measured in one pose.

    Parameters
    ----------
    wrenches : mapping from sensor to array, shape (n, 6)
    q, currents : array, shape (n, joints)
    said : tuple of (int, bytes)
        All frames in order, see :func:`said`.
    """

    wrenches: Mapping[str, Array]
    q: Array
    currents: Array
    said: tuple[tuple[int, bytes], ...]


class SmallRobot:
    """Robot, plan and devices of one variant, written into a folder.

    Parameters
    ----------
    folder : Path
        New; several robots may share its parent.
    variant : str
        A key of :data:`SENSORS`.
    asked : bool
        Whether the host starts the devices and polls them; else somebody else did and does.
    """

    def __init__(self, folder: Path, variant: str, *, asked: bool = False) -> None:
        self.folder, self.variant, self.asked = folder, variant, asked
        folder.mkdir(parents=True)
        generated = table1.generate(folder)
        lines = generated.read_text("utf-8").splitlines()
        kept = [line for line in lines if not line.startswith("noise:")]
        self._text = "\n".join([*kept, NOISE, _sources(variant, asked=asked)])
        self.plan_path = folder / "some.csv"
        header, *rows = (folder / "plan.csv").read_text("utf-8").splitlines()
        self.plan_path.write_text("\n".join([header, *rows[:POSES]]) + "\n", "utf-8")
        self.yaml = self.at({"interface": "virtual", "channel": "nowhere"}, "emulated.yaml")

    def at(self, connection: Mapping[str, object], name: str) -> Path:
        """Write robot.yaml with the bus reached in that way."""
        path = self.folder / name
        entry = json.dumps({"bitrate": 1_000_000, **connection})
        path.write_text(self._text.replace(f"{BUS}: BUS", f"{BUS}: {entry}"), "utf-8")
        return path

    @cached_property
    def robot(self) -> Robot:
        return load_robot(self.yaml)

    @cached_property
    def config(self) -> CanConfig:
        return read_configuration(self.robot.sources["can"], self.robot)

    @cached_property
    def plan(self) -> tuple[PlannedPose, ...]:
        return read_plan(self.plan_path, self.robot.tree.joint_names)

    def emulated(self) -> EmulatedRobot:
        """Return the robot without a bus, its devices started and polled."""
        source = open_source("builtin", SourceRequest(self.robot, SEED, plan=self.plan))
        devices = emulate_all(self.config, self.robot, started=True)
        return EmulatedRobot(source, self.plan, devices, Behaviour(0, LENGTH))

    @cached_property
    def truth(self) -> Mapping[int, Truth]:
        """By pose; a pose is sent from its first sample on whenever it is taken."""
        return {pose.pose: self._truth(pose.pose) for pose in self.plan}

    @cached_property
    def unpolled(self) -> Mapping[int, tuple[tuple[int, bytes], ...]]:
        """By pose, all frames of the devices that are not polled, see :func:`said`."""
        return {
            pose.pose: tuple(said(packed(self._frames(pose.pose)), self.config, polled=False))
            for pose in self.plan
        }

    def _frames(self, pose: int) -> list[Frame]:
        robot = self.emulated()
        robot.take(pose)
        return [frame for tick in ticks(robot) for frame in tick.frames[BUS]]

    def _truth(self, pose: int) -> Truth:
        frames = self._frames(pose)
        stream = SampleStream(self.config, self.robot)
        stream.begin()
        first, last = stream.feed({BUS: packed(frames)}), stream.finish()
        blocks = [block for block in (first, last) if block.t.size]
        return Truth(
            {
                name: np.concatenate([block.wrenches[name] for block in blocks])
                for name in blocks[0].wrenches
            },
            np.concatenate([block.q for block in blocks]),
            np.concatenate([_currents(block) for block in blocks]),
            tuple(said(packed(frames), self.config)),
        )


def _currents(block: Block) -> Array:
    return np.full_like(block.q, np.nan) if block.currents is None else block.currents


def ticks(robot: EmulatedRobot) -> Iterator[Tick]:
    """Yield all moments of the pose in which the robot stands."""
    while (tick := robot.tick()) is not None:
        yield tick


def packed(frames: Sequence[Frame]) -> FrameBatch:
    """Return frames of an emulated robot as a batch."""
    n = len(frames)
    data = np.zeros((n, 8), np.uint8)
    for row, frame in enumerate(frames):
        data[row, : len(frame.data)] = list(frame.data)
    return FrameBatch(
        np.round(np.array([frame.t for frame in frames], np.float64), 6),
        np.array([frame.id & ~EXTENDED for frame in frames], np.uint32),
        np.array([len(frame.data) for frame in frames], np.uint8),
        data,
        np.array([ERROR_KIND * (frame.kind == ERROR) for frame in frames], np.uint8),
    )


def said(batch: FrameBatch, config: CanConfig, *, polled: bool = True) -> list[tuple[int, bytes]]:
    """Return what devices said, without what they count: identifiers and payloads.

    Parameters
    ----------
    batch : FrameBatch
    config : CanConfig
    polled : bool
        False: leave out devices that are polled or follow SYNC; when they speak is up to who asks.
    """
    ids = set[int]()
    counted = dict[int, int]()
    requests = set[int]()
    for device in config.every_device:
        description = device.device.description
        if description.join.request is not None:
            requests.add(device.device.relocate(description.join.request.id))
            if not polled:
                continue
        if is_canopen(device.device) and not polled:
            continue
        table = bus_table(device.device)
        found = {table.id_of(name) for name in description.parts}
        ids |= found
        if description.name == "jr3_uc3m":
            counted |= dict.fromkeys(found, 6)
    lengths = batch.lengths.tolist()
    return [
        (number, batch.data[k, : min(lengths[k], counted.get(number, 8))].tobytes())
        for k, number in enumerate(batch.ids.tolist())
        if number in ids
        and not batch.kinds[k] & ERROR_KIND
        and not (number in requests and not lengths[k])
    ]
