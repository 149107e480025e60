# SPDX-License-Identifier: Apache-2.0
"""The emulated robot: poses of a simulated source, as the frames of the devices in robot.yaml.

It stands in the pose of plan.csv that it was last told, and its devices speak about that. What they
say depends on the pose alone: not on the adapter, nor on how often the pose was taken, nor on how
long the robot stood there. Their counters begin with ``slot`` times the number of the pose.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from comcal.errors import ComcalError, ConfigError
from comcal.measure.plan import PlannedPose
from comcal.measure.source import Block, SimulatedSource
from comcal.measure.still import StillCriterion
from comcal.measure.waiting import STEP
from comcal_drivers.emulator.device import EmulatedDevice, Stream
from comcal_drivers.emulator.frame import Frame
from comcal_drivers.emulator.models.canopen_drive import CanopenDrive

COMMAND_ID, STATE_ID = 0x7F1, 0x7F2
"""Identifiers of the frames that move the robot, on every bus: from the host, to the host."""
MOVE, ABORT = 1, 2
"""Commands."""
MOVING, ARRIVED, REFUSED = 1, 2, 3
"""States; the last one also after an abort, and for poses that cannot be taken."""
NEAR = 2e-3
"""Set-points that are so close to a pose mean it [rad]."""
NOWHERE = 0xFFFF
"""Number of the pose in which a robot stands that was never told any."""
SYNC = Frame(0x080)
FRAME_TIME = 130e-6
"""Between the stamps of two frames [s]: eight bytes at 1 Mbit/s."""

_CRITERION = StillCriterion()
FIRST_READ = max(_CRITERION.settle, _CRITERION.window)
"""How much of a pose is read from the source first, and then in steps of ``STEP`` [s]: as the
recorder does, so that simulated noise is the same with and without a bus in between."""


@dataclass(frozen=True)
class Behaviour:
    """How the robot behaves.

    Parameters
    ----------
    slot : int
        Samples by which the counters of two poses of consecutive numbers are apart; zero: they
        go on from where they were.
    length : float
        How long a pose is streamed [s]; infinite: until the next one.
    is_paced : bool
        Whether time passes by itself. If not, and the host polls devices or gives the SYNC, a
        moment passes when it has asked all of these: the k-th question gets the k-th sample.
    """

    slot: int = 7200
    length: float = np.inf
    is_paced: bool = True


@dataclass(frozen=True)
class Tick:
    """Everything that the devices say at one moment.

    Parameters
    ----------
    t : float
        Of the source's clock [s].
    index : int
        Samples since the pose began.
    frames : mapping from bus to list of Frame
    """

    t: float
    index: int
    frames: Mapping[str, list[Frame]]


@dataclass(frozen=True)
class Move:
    """A pose was taken, or not.

    Parameters
    ----------
    pose : int
    state : int
        :data:`ARRIVED` or :data:`REFUSED`.
    count : int
        Running number of the first sample in it.
    reason : str
        Why not.
    """

    pose: int
    state: int
    count: int = 0
    reason: str = ""


class EmulatedRobot:
    """A robot whose measurements come from a source and leave as frames.

    Parameters
    ----------
    source : SimulatedSource
    plan : sequence of PlannedPose
        The poses that it knows.
    buses : mapping from bus to list of EmulatedDevice
        In the order in which they send.
    behaviour : Behaviour
    """

    def __init__(
        self,
        source: SimulatedSource,
        plan: Sequence[PlannedPose],
        buses: Mapping[str, Sequence[EmulatedDevice]],
        behaviour: Behaviour | None = None,
    ) -> None:
        self._source = source
        self._plan = {pose.pose: pose for pose in plan}
        self._buses = buses
        self._behaviour = behaviour or Behaviour()
        self._pose: int | None = None
        self._taken: PlannedPose | None = None
        self._block: Block | None = None
        self._base = 0  # running number of the first sample of the pose
        self._begun = 0  # index, within the pose, of the first sample of the block
        self._row = 0  # of the next sample within the block
        self._streams: dict[EmulatedDevice, tuple[int, int, Stream]] = {}
        self._period = 1.0

    @property
    def pose(self) -> int | None:
        """Number of the pose in which it stands."""
        return self._pose

    @property
    def devices(self) -> tuple[EmulatedDevice, ...]:
        """All devices of all buses."""
        return tuple(device for devices in self._buses.values() for device in devices)

    def boot(self) -> dict[str, list[Frame]]:
        """Return what the devices say when they are switched on, by bus."""
        return {bus: [f for d in devices for f in d.boot()] for bus, devices in self._buses.items()}

    def hear(self, bus: str, frame: Frame) -> list[Frame]:
        """Let all devices of a bus obey a frame; return their answers."""
        return [answer for device in self._buses.get(bus, ()) for answer in device.hear(frame)]

    @property
    def drives(self) -> list[CanopenDrive]:
        """Drives that can be told a position."""
        return [device for device in self.devices if isinstance(device, CanopenDrive)]

    @property
    def commanded(self) -> int | None:
        """Number of the pose to which the drives were sent and have not come yet.

        The robot knows the poses of its plan only: as long as the set-points of all drives
        together are none of them, it stays where it is.
        """
        if all(drive.arrived for drive in self.drives):
            return None
        for number, pose in self._plan.items():
            wanted = np.array(pose.q if self._taken is None else self._taken.q, dtype=np.float64)
            for drive in self.drives:
                if drive.target is not None:
                    wanted[drive.column] = drive.target
            if np.allclose(pose.q, wanted, atol=NEAR, rtol=0.0):
                return number
        return None

    def take(self, pose: int, planned_as: int | None = None) -> Move:
        """Stand in another pose.

        Parameters
        ----------
        pose : int
            Its number, from which samples and counters follow.
        planned_as : int or None
            Number in the plan, for the repetition of a pose under a new number.
        """
        planned = self._plan.get(pose if planned_as is None else planned_as)
        if planned is None:
            return Move(pose, REFUSED, reason=f"pose {pose} is not in the plan")
        try:
            self._source.move_to(replace(planned, pose=pose))
            block = self._source.read(FIRST_READ)
        except ComcalError as error:
            self._pose = self._block = None
            return Move(pose, REFUSED, reason=str(error))
        self._base = pose * self._behaviour.slot if self._behaviour.slot else self.count
        self._pose, self._block, self._taken = pose, block, planned
        for drive in self.drives:
            drive.arrive()
        self._period = float(np.median(np.diff(block.t))) if block.t.size > 1 else 1.0
        self._begun = self._row = 0
        self._streams.clear()
        return Move(pose, ARRIVED, self.count)

    @property
    def count(self) -> int:
        """Running number of the next sample."""
        return self._base + self._begun + self._row

    @property
    def has_more(self) -> bool:
        """Whether there is another moment of this pose."""
        index = self._begun + self._row
        if self._block is None or (index + 0.5) * self._period >= self._behaviour.length:
            return False
        return self._behaviour.is_paced or index == 0 or all(d.was_asked for d in self._asked)

    @property
    def _asked(self) -> list[EmulatedDevice]:
        """Devices that send only what the host asks for."""
        return [device for device in self.devices if device.waits and not device.is_started]

    def tick(self) -> Tick | None:
        """Return the next moment; None where the robot stands nowhere, or all was said."""
        block = self._block
        if block is None or not self.has_more:
            return None
        if self._row >= block.t.size:
            self._begun += block.t.size
            self._row = 0
            block = self._block = self._source.read(STEP)
        t = float(block.t[self._row])
        index = self._begun + self._row
        for device in self.devices:
            device.was_asked = False
        frames = {bus: self._frames(devices, block) for bus, devices in self._buses.items()}
        self._row += 1
        return Tick(t, index, frames)

    def _frames(self, devices: Sequence[EmulatedDevice], block: Block) -> list[Frame]:
        """Return what the devices of one bus send at this moment."""
        out = list[Frame]()
        if any(device.is_started and device.follows_sync for device in devices):
            out.append(SYNC)
        for device in devices:
            stream, row = self._stream(device, block)
            device.newest = tuple(stream.samples[row])
            poll = device.poll if device.is_started else None
            if poll is not None:
                out.append(poll)
            if device.streams or (device.is_started and device.waits):
                out += stream.beside[row]
                out += device.newest
        t, step = float(block.t[self._row]), min(FRAME_TIME, self._period / (len(out) + 1))
        return [frame._replace(t=t + k * step) for k, frame in enumerate(out)]

    def _stream(self, device: EmulatedDevice, block: Block) -> tuple[Stream, int]:
        """Return the frames of a device, made anew where a command changed what they say."""
        made = self._streams.get(device)
        end = 0 if made is None else made[1] + len(made[2].samples)
        if made is None or made[0] != device.revision or end <= self.count:
            rest = _from(block, self._row)
            stream = device.stream(rest, self.count, self._begun + self._row)
            made = (device.revision, self.count, stream)
            self._streams[device] = made
        return made[2], self.count - made[1]


def _from(block: Block, row: int) -> Block:
    """Return a block without its first samples."""
    if row == 0:
        return block
    return Block(
        t=block.t[row:],
        q=block.q[row:],
        wrenches={name: w[row:] for name, w in block.wrenches.items()},
        torques=None if block.torques is None else block.torques[row:],
        currents=None if block.currents is None else block.currents[row:],
        imu=None if block.imu is None else block.imu[row:],
        temperatures=None
        if block.temperatures is None
        else {name: t[row:] for name, t in block.temperatures.items()},
    )


def command_of(frame: Frame) -> tuple[int, int, int | None] | None:
    """Return pose, command and number in the plan of a control frame; None where it is none.

    The payload is ``u16 pose, u8 command``, and optionally ``u16 number in the plan``.
    """
    if frame.id != COMMAND_ID or len(frame.data) not in (3, 5):
        return None
    pose, command = struct.unpack_from("<HB", frame.data)
    planned_as = struct.unpack_from("<H", frame.data, 3)[0] if len(frame.data) == 5 else None
    return pose, command, planned_as


def state_frame(pose: int, state: int, count: int = 0, t: float = 0.0) -> Frame:
    """Return the frame that answers a control frame: ``u16 pose, u8 state, u32 count``."""
    return Frame(STATE_ID, struct.pack("<HBI", pose & 0xFFFF, state, count & 0xFFFFFFFF), t)


def check_ids(buses: Mapping[str, Sequence[EmulatedDevice]]) -> None:
    """Refuse devices whose frames cannot be told from each other or from the control frames.

    Raises
    ------
    ConfigError
        If two devices send the same identifier, or one of those that move the robot.
    """
    for bus, devices in buses.items():
        owners: dict[int, str] = {COMMAND_ID: "the pose control", STATE_ID: "the pose control"}
        for device in devices:
            if device.config.device.description.select is not None:
                continue  # they share an identifier, and name themselves in the frame
            for number in device.ids:
                other = owners.setdefault(number, device.name)
                if other != device.name:
                    raise ConfigError(
                        f"{device.name} sends with an identifier of {other}",
                        where=f"sources.can, bus {bus}",
                        measured=f"0x{number & 0x1FFFFFFF:X}",
                        next_step="give one of them other `ids`",
                    )
