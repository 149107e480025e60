# SPDX-License-Identifier: Apache-2.0
"""Buses as a :class:`~comcal.measure.source.Source`."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator
from types import TracebackType

import can
import numpy as np

from comcal.errors import ComcalError, HardwareError
from comcal.measure.source import Block, SourceRequest, SourceStatus
from comcal_drivers.bus.open import open_bus
from comcal_drivers.bus.reader import BusReader
from comcal_drivers.canopen_setup.conflicts import is_canopen, node_of, sync_conflict
from comcal_drivers.canopen_setup.set_up import nmt_start, rated_values, set_up_drives
from comcal_drivers.devices.commands import DeviceValues
from comcal_drivers.devices.configuration import BusConfig, CanConfig, read_configuration
from comcal_drivers.frames.batch import FrameBatch
from comcal_drivers.frames.batches import take
from comcal_drivers.replay.reading import BlockReader
from comcal_drivers.source.fitted import fitted
from comcal_drivers.source.logs import SessionLog
from comcal_drivers.source.rates import Rates
from comcal_drivers.source.requests import Poller, requests_of
from comcal_drivers.source.start import command_device, merged
from comcal_drivers.source.stream import SampleStream

PATIENCE = 3.0
"""How long nothing usable may come before the operator is told to look [s]."""
WAIT = 0.02
"""How long one look for frames takes [s]."""

Wanted = Callable[[FrameBatch, int], bool]
"""Whether a frame, by its number in the batch, is the one that is waited for."""


class CanSource:
    """Samples of the devices on one or more buses.

    Parameters
    ----------
    config : CanConfig
    request : SourceRequest
        ``directory``: where frames are kept, if it is there.
    patience : float
        How long a device may owe its samples before :meth:`read` gives up [s].

    Raises
    ------
    ConfigError
        If devices cannot live on one bus, or a value is needed that nobody states.
    HardwareError
        If a bus cannot be opened, or a device does not answer.
    """

    def __init__(
        self, config: CanConfig, request: SourceRequest, patience: float = PATIENCE
    ) -> None:
        conflict = sync_conflict(config)
        if conflict is not None:
            raise conflict
        self._asked, self._patience = config, patience
        self._cleanup = contextlib.ExitStack()
        self._config = self._cleanup.enter_context(fitted(config))
        self._log = SessionLog(request.directory)
        self._told: dict[str, DeviceValues] = {}
        self._facts: dict[str, dict[str, object]] = {}
        self._on_sync: set[str] = set()
        self._readers: dict[str, BusReader] = {}
        self._pollers: list[Poller] = []
        self._rates = Rates()
        try:
            self._log.begin("start")
            for bus in config.buses.values():
                self._readers[bus.name] = BusReader(bus, self._log, opener=self._opened)
            self._start()
        except BaseException:
            with contextlib.suppress(ComcalError):
                self.close()
            raise
        self._stream = SampleStream(self._config, request.robot, self._told, self._log.origin)
        self._stream.begin()
        self._reading = BlockReader(self._blocks)
        self._ready: Block | None = None
        self.status()  # rates count from here

    @property
    def name(self) -> str:
        """The buses, as configured."""
        buses = self._config.buses.values()
        return ", ".join(f"{bus.interface} {bus.channel}" for bus in buses)

    def read(self, duration: float) -> Block:
        """Return the samples of the next *duration* seconds.

        Raises
        ------
        HardwareError
            If no sample comes for too long; it says which device is silent. If the frames cannot be
            written to disk any more: nothing is accepted from then on.
        """
        block = self._reading.read(duration)
        if block is None:
            raise HardwareError("was closed", where=self.name)
        return block

    def begin_pose(self, pose: int) -> None:
        """Keep the frames from now on as those of *pose*; nothing earlier is part of it."""
        self._log.begin(f"pose_{pose:03d}")
        self.drop_earlier()

    def drop_earlier(self) -> None:
        """Let :meth:`read` begin with samples that are measured from now on."""
        for bus, reader in self._readers.items():
            self._stream.feed({bus: reader.take()})
        self._begin()

    def send(self, message: can.Message, bus: str | None = None) -> None:
        """Send a frame on *bus*; None: on the one of the device that is the clock.

        Raises
        ------
        HardwareError
            If the device is away, or takes nothing.
        """
        self._readers[self._main_bus if bus is None else bus].send(message)

    def wait_for(self, wanted: Wanted, timeout: float) -> bytes | None:
        """Wait for a frame of the main bus; samples before it are passed over.

        Returns
        -------
        bytes or None
            Its payload; None if it does not come in time.
        """
        ends = time.monotonic() + timeout
        while time.monotonic() < ends:
            for bus, reader in self._readers.items():
                batch = reader.take(WAIT if bus == self._main_bus else 0.0)
                at = -1
                if bus == self._main_bus:
                    at = next((k for k in range(len(batch)) if wanted(batch, k)), -1)
                if at < 0:
                    self._stream.feed({bus: batch})
                    continue
                self._stream.feed({bus: take(batch, np.arange(at + 1))})
                self._begin()
                self._ready = self._stream.feed({bus: take(batch, np.arange(at + 1, len(batch)))})
                return batch.data[at, : batch.lengths[at]].tobytes()
        return None

    def status(self) -> SourceStatus:
        """Return what was lost, by device and bus, and what else has happened."""
        lost: dict[str, int] = {}
        lost |= self._stream.lost
        notes = list(self._stream.notes)
        for name, reader in self._readers.items():
            health = reader.health()
            lost[f"{name} frames"] = health.lost
            for what in ("error_frames", "bus_offs", "garbage", "silences", "reconnects"):
                lost[f"{name} {what.replace('_', ' ')}"] = int(getattr(health, what))
            if health.bus_off:
                notes.append(f"{name}: bus-off, restart the controller")
            if not health.is_connected:
                notes.append(f"{name}: the device is away, it is looked for ({health.exception})")
            elif health.is_silent:
                notes.append(f"{name}: nothing comes")
        samples = {name: counts.samples for name, counts in self._stream.counts.items()}
        frames = {name: reader.health().frames for name, reader in self._readers.items()}
        told = {name: count for name, count in lost.items() if count}
        return SourceStatus(self._rates.of({**samples, **frames}), told, tuple(notes))

    def close(self) -> None:
        """Stop asking, close buses and logs."""
        for poller in self._pollers:
            poller.close()
        self._pollers.clear()
        try:
            for reader in self._readers.values():
                reader.close()
        finally:
            self._readers.clear()
            self._log.close()
            self._cleanup.close()

    def __enter__(self) -> CanSource:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        with contextlib.suppress(ComcalError) if kind is not None else contextlib.nullcontext():
            self.close()

    # --- starting ------------------------------------------------------------------------------

    def _opened(self, bus: BusConfig) -> can.BusABC:
        """Open a bus, the first time and after it was away; CANopen drives are asked before."""
        opened = open_bus(bus)
        joints = [j for j in self._asked.joints.values() if j.bus == bus.name]
        if any(is_canopen(joint.device) for joint in joints):
            try:
                facts = set_up_drives(opened, joints)
            except BaseException:
                opened.shutdown()
                raise
            rated = {name: rated_values(each) for name, each in facts.items()}
            self._told = merged(self._told, rated)
            self._facts |= {name: each.as_mapping() for name, each in facts.items()}
            self._on_sync |= {
                name
                for name, each in facts.items()
                if any(pdo.is_synchronous for pdo in each.layout.enabled)
            }
        return opened

    def _start(self) -> None:
        """Ask and start every device, then poll those that want to be polled."""
        for config in self._config.every_device:
            reader = self._readers[config.bus]
            told = command_device(reader.send, reader.take, config, config.start)
            self._told = merged(self._told, {config.name: told})
        for name, reader in self._readers.items():
            devices = self._config.devices(name)
            for config in devices:
                if is_canopen(config.device):
                    reader.send(nmt_start(node_of(config.device)))
            self._pollers.append(Poller(reader.send, requests_of(devices)))
        self._log.tell(self._told, self._facts)

    # --- reading -------------------------------------------------------------------------------

    @property
    def _main_bus(self) -> str:
        clock = self._config.clock
        return next(d.bus for d in self._config.every_device if d.name == clock)

    def _begin(self) -> None:
        self._stream.begin()
        self._ready = None
        self._reading.close()
        self._reading = BlockReader(self._blocks)

    def _blocks(self, start: float) -> Iterator[Block]:
        """Yield blocks as they come, until nothing comes any more."""
        del start  # a bus has no past
        last = time.monotonic()
        while self._readers:
            if self._ready is not None:
                block, self._ready = self._ready, None
            else:
                block = self._stream.feed(
                    {
                        name: reader.take(WAIT if k == 0 else 0.0)
                        for k, (name, reader) in enumerate(self._readers.items())
                    }
                )
            if block.t.size:
                last = time.monotonic()
                yield block
            elif time.monotonic() - last > self._patience:
                raise self._silent()

    def _silent(self) -> HardwareError:
        """Say who has sent nothing usable."""
        counts = self._stream.counts
        mute = [name for name, each in counts.items() if not each.samples]
        notes = self.status().notes
        if len(mute) == len(counts) > 1:
            who = f"none of the {len(mute)} devices has sent anything"
        else:
            have = "have" if len(mute) > 1 else "has"
            who = f"{', '.join(mute) or self._config.clock} {have} sent nothing"
        return HardwareError(
            f"no samples come: {who} usable",
            where=self.name,
            measured=f"nothing for {self._patience:g} s" + "".join(f"; {note}" for note in notes),
            next_step=self._without_sync(mute)
            or "see that the devices are powered, on this bus, at this bit rate, with the "
            "`ids` that robot.yaml states; then go on with the same command",
        )

    def _without_sync(self, mute: list[str]) -> str:
        """Return what to do about drives that wait for a SYNC which nobody sends; else nothing."""
        joints = self._config.joints
        given = {j.bus for j in joints.values() if j.sync_period is not None}
        waiting = [n for n in mute if n in self._on_sync and joints[n].bus not in given]
        if not waiting:
            return ""
        return (
            f"{waiting[0]} sends only after a SYNC: give one drive of the bus `sync_period: 0.01` "
            "in robot.yaml, start the master that sends SYNC, or set its TPDO to type 255"
        )


def open_can(request: SourceRequest) -> CanSource:
    """Open the buses of ``sources.can`` in robot.yaml.

    Parameters
    ----------
    request : SourceRequest

    Raises
    ------
    UsageError
        If effects are asked for: they can be hidden in simulated robots only.
    ConfigError
        If ``sources.can`` is missing or wrong.
    HardwareError
        If a bus or a device does not answer.
    """
    request.refuse_effects()
    return CanSource(read_configuration(request.options or {}, request.robot), request)
