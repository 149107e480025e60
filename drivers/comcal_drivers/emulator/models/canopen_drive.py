# SPDX-License-Identifier: Apache-2.0
"""A CiA 402 drive: objects through SDO, states through NMT, samples as TPDO.

Source: CiA 301 (NMT, SDO, PDO parameters, heartbeat) and CiA 402-2 (state machine, profile position
mode). The motion itself is none: a drive that is told a new position says so to the robot, and has
arrived when its joint stands there.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping

import numpy as np

from comcal.measure.source import Block
from comcal.robot.tree import Array
from comcal_drivers.canopen_setup.eds import FIRST_COMMUNICATION, FIRST_MAPPING
from comcal_drivers.canopen_setup.fit import layout_of
from comcal_drivers.canopen_setup.layout import (
    COB_EXTENDED,
    LAST_SYNCHRONOUS,
    MappedObject,
    TransmitPdo,
)
from comcal_drivers.canopen_setup.objects import (
    CONTROLWORD,
    CURRENT,
    DEVICE_NAME,
    IDENTITY,
    MODE,
    MODE_DISPLAY,
    POSITION,
    PROFILE_ACCELERATION,
    PROFILE_DECELERATION,
    PROFILE_VELOCITY,
    QUICK_STOP_OPTION,
    RATED_CURRENT,
    RATED_TORQUE,
    STATUSWORD,
    TARGET_POSITION,
    TORQUE,
    index_of_signal,
)
from comcal_drivers.devices.configuration import JointConfig
from comcal_drivers.emulator.device import EmulatedDevice, Stream
from comcal_drivers.emulator.frame import Frame
from comcal_drivers.emulator.meters import DriveMeter, Reading
from comcal_drivers.emulator.models.sdo_server import Key, SdoServer

NMT, SYNC, SDO_REQUEST, SDO_ANSWER, HEARTBEAT = 0x000, 0x080, 0x600, 0x580, 0x700
START, STOP, PRE_OPERATIONAL, RESET, RESET_COMMUNICATION = 0x01, 0x02, 0x80, 0x81, 0x82
BOOTED, STOPPED, OPERATIONAL, IS_PRE_OPERATIONAL = 0x00, 0x04, 0x05, 0x7F
ON_EVERY_SYNC, BY_EVENT = 1, 255
PROFILE_POSITION = 1

SWITCH_ON_DISABLED, READY, SWITCHED_ON, ENABLED, QUICK_STOP = 0x40, 0x21, 0x23, 0x27, 0x07
"""States as bits 0 to 3, 5 and 6 of the status word show them."""
VOLTAGE, BY_REMOTE, REACHED, ACKNOWLEDGED = 1 << 4, 1 << 9, 1 << 10, 1 << 12


class CanopenDrive(EmulatedDevice):
    """A drive; operational, and sending, once NMT says so.

    Parameters
    ----------
    config : JointConfig
    meter : DriveMeter
    started : bool
        Whether another master has brought it to OPERATIONAL.
    """

    streams_at_power_up = False

    def __init__(self, config: JointConfig, meter: DriveMeter, *, started: bool = False) -> None:
        super().__init__(config, meter, started=started)
        self.joint = config
        self.column = meter.column
        """Of its joint in ``q``."""
        self.state = OPERATIONAL if started else IS_PRE_OPERATIONAL
        self.word = SWITCH_ON_DISABLED
        self.target: float | None = None
        """Position last commanded [rad]; None before."""
        self.arrived = True
        self._acknowledged = False
        self._last = np.zeros(len(config.device.description.values))
        self.server = SdoServer(*_objects(self, meter.rated))
        self._show()
        self._choose()

    @property
    def node(self) -> int:
        """Number of the node."""
        return self.config.device.ids["node"]

    @property
    def is_synchronous(self) -> bool:
        """Whether its TPDOs come on SYNC only."""
        return all(
            1 <= self.server.integer(*key) <= LAST_SYNCHRONOUS
            for key in self.server.objects
            if FIRST_COMMUNICATION <= key[0] < FIRST_MAPPING and key[1] == 2
        )

    @property
    def follows_sync(self) -> bool:
        """Whether it is operational, and its TPDO of that type."""
        return self.state == OPERATIONAL and self.is_synchronous

    def boot(self) -> list[Frame]:
        """Announce the node."""
        return [self._heartbeat(BOOTED)]

    def hear(self, frame: Frame) -> list[Frame]:
        """Obey NMT, SYNC and SDO."""
        if frame.id == NMT and len(frame.data) >= 2 and frame.data[1] in (0, self.node):
            return self._manage(frame.data[0])
        if frame.id == SYNC and not frame.data:
            self.was_asked = True
            return list(self.newest) if self.follows_sync else []
        if frame.id == SDO_REQUEST + self.node and self.state != STOPPED and frame.data:
            answer, written = self.server.answer(frame.data)
            answers = [Frame(SDO_ANSWER + self.node, answer, device=self.name)]
            if written is not None:
                self._write(written)
            return answers
        return []

    def stream(self, block: Block, first: int, index: int) -> Stream:
        """Return samples as frames; keep the newest values for SDO."""
        made = super().stream(block, first, index)
        columns = dict(zip(self.config.device.description.values, self._last, strict=True))
        for name, value in columns.items():
            key = index_of_signal(name)
            if key is not None and key in self.server.objects:
                self.server.put(key[0], round(float(value)), key[1])
        return made

    def converted(self, values: Array, reading: Reading) -> tuple[Array, dict[str, Array]]:
        """Return the values beside the status word."""
        values, extra = super().converted(values, reading)
        self._last: Array = values[-1]
        n = len(values)
        return values, {
            **extra,
            "statusword": np.full(n, float(self.server.integer(STATUSWORD))),
            "mode": np.full(n, float(self.server.integer(MODE_DISPLAY, signed=True))),
        }

    def arrive(self) -> None:
        """Say in the status word that the target is reached."""
        self.arrived = True
        self._show()

    # What the host does

    def _manage(self, command: int) -> list[Frame]:
        states = {START: OPERATIONAL, STOP: STOPPED, PRE_OPERATIONAL: IS_PRE_OPERATIONAL}
        boots = command in (RESET, RESET_COMMUNICATION)
        self.state = IS_PRE_OPERATIONAL if boots else states.get(command, self.state)
        self._choose()
        return self.boot() if boots else []

    def _write(self, key: Key) -> None:
        index, _ = key
        if index == MODE:
            self.server.put(MODE_DISPLAY, self.server.integer(MODE))
        elif index == CONTROLWORD:
            self._control(self.server.integer(CONTROLWORD))
        elif FIRST_COMMUNICATION <= index < FIRST_MAPPING:
            self._choose()

    def _control(self, word: int) -> None:
        """Follow the transitions of the state machine, and take a new set-point."""
        if word & 0x80 or not word & 0x02:  # fault reset, disable voltage
            self.word = SWITCH_ON_DISABLED
        elif not word & 0x04:  # quick stop, active low; it leads back to SWITCH ON DISABLED
            self.word = QUICK_STOP if self.word == ENABLED else SWITCH_ON_DISABLED
            self.target = None
        elif word & 0x0F == 0x06:
            self.word = READY
        elif word & 0x0F == 0x07 and self.word != SWITCH_ON_DISABLED:
            self.word = SWITCHED_ON
        elif word & 0x0F == 0x0F and self.word in (READY, SWITCHED_ON, ENABLED):
            self.word = ENABLED
        in_mode = self.server.integer(MODE_DISPLAY, signed=True) == PROFILE_POSITION
        is_new = word & 0x10 and not self._acknowledged
        self._acknowledged = bool(word & 0x10) and self.word == ENABLED and in_mode
        if is_new and self._acknowledged:
            counts = self.server.integer(TARGET_POSITION, signed=True)
            turns = counts / ((self.joint.counts_per_turn or 1.0) * self.joint.gear)
            self.target = self.joint.sign * 2.0 * np.pi * turns + self.joint.zero
            self.arrived = False
        self._show()

    def _choose(self) -> None:
        """Stream or not."""
        self.streams = self.state == OPERATIONAL and not self.is_synchronous

    def _show(self) -> None:
        word = self.word | VOLTAGE | BY_REMOTE
        word |= REACHED if self.arrived else 0
        word |= ACKNOWLEDGED if self._acknowledged else 0
        self.server.put(STATUSWORD, word)
        self.revision += 1

    def _heartbeat(self, state: int) -> Frame:
        return Frame(HEARTBEAT + self.node, bytes([state]), device=self.name)


def _objects(drive: CanopenDrive, rated: Mapping[str, float]) -> tuple[dict[Key, bytes], set[Key]]:
    """Return the objects at power-up, and those that may be written."""
    is_epos = "epos" in drive.config.device.description.name
    objects: dict[Key, bytes] = {
        (0x1000, 0): struct.pack("<I", 0x00020192),
        (0x1001, 0): b"\0",
        (DEVICE_NAME, 0): b"EPOS2 emulated" if is_epos else b"emulated CiA 402 drive",
        (0x1017, 0): struct.pack("<H", 0),
        (IDENTITY, 0): b"\x04",
        (IDENTITY, 1): struct.pack("<I", 0xFB if is_epos else 0),
        (IDENTITY, 2): struct.pack("<I", 1),
        (IDENTITY, 3): struct.pack("<I", 1),
        (IDENTITY, 4): struct.pack("<I", 1000 + drive.node),
        (CONTROLWORD, 0): b"\0\0",
        (STATUSWORD, 0): bytes(2),
        (QUICK_STOP_OPTION, 0): struct.pack("<h", 2),
        (MODE, 0): b"\0",
        (MODE_DISPLAY, 0): b"\0",
        (POSITION, 0): bytes(4),
        (RATED_CURRENT, 0): struct.pack("<I", round(rated["rated_current"] * 1e3)),
        (RATED_TORQUE, 0): struct.pack("<I", round(rated["rated_torque"] * 1e3)),
        (TORQUE, 0): bytes(2),
        (CURRENT, 0): bytes(2),
        (TARGET_POSITION, 0): bytes(4),
        (PROFILE_VELOCITY, 0): struct.pack("<I", 1000),
        (PROFILE_ACCELERATION, 0): struct.pack("<I", 10000),
        (PROFILE_DECELERATION, 0): struct.pack("<I", 10000),
    }
    writable = {
        (0x1017, 0), (CONTROLWORD, 0), (QUICK_STOP_OPTION, 0), (MODE, 0), (TARGET_POSITION, 0),
        (PROFILE_VELOCITY, 0), (PROFILE_ACCELERATION, 0), (PROFILE_DECELERATION, 0),
    }  # fmt: skip
    for pdo in _pdos(drive, ON_EVERY_SYNC if is_epos else BY_EVENT):
        communication, mapping = 0x17FF + pdo.number, 0x19FF + pdo.number
        flag = COB_EXTENDED if pdo.extended else 0
        objects[communication, 0] = b"\x02"
        objects[communication, 1] = struct.pack("<I", pdo.cob_id | flag)
        objects[communication, 2] = bytes([pdo.transmission])
        objects[mapping, 0] = bytes([len(pdo.entries)])
        for sub, entry in enumerate(pdo.entries, start=1):
            word = entry.index << 16 | entry.subindex << 8 | entry.bits
            objects[mapping, sub] = struct.pack("<I", word)
        writable.add((communication, 2))
    if is_epos:  # its current is in mA, and it has neither torque nor rated values
        for index in (RATED_CURRENT, RATED_TORQUE, TORQUE):
            del objects[index, 0]
    return objects, writable


def _pdos(drive: CanopenDrive, transmission: int) -> tuple[TransmitPdo, ...]:
    """Return the PDOs of a sample: of the EDS or DCF of the joint, else of the device's layout."""
    layout = layout_of(drive.joint)
    if layout is not None:
        return layout.pdos
    pdos = list[TransmitPdo]()
    for number, message in enumerate(drive.layout.messages, start=1):
        signals = sorted(message.signals, key=lambda signal: signal.start)
        found = [(index_of_signal(signal.name), signal.length) for signal in signals]
        entries = tuple(MappedObject(*key, bits) for key, bits in found if key is not None)
        cob_id = drive.layout.part_ids[number - 1]
        pdos.append(TransmitPdo(number, cob_id, True, transmission, entries))
    return tuple(pdos)
