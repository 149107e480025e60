# SPDX-License-Identifier: Apache-2.0
"""A device on the bus: what it measures becomes frames, and it obeys commands."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from comcal.measure.source import Block
from comcal.robot.tree import Array
from comcal_drivers.devices.configuration import DeviceConfig
from comcal_drivers.emulator.frame import Frame
from comcal_drivers.emulator.layout import DeviceLayout, RawSamples
from comcal_drivers.emulator.meters import Meter, Reading


@dataclass(frozen=True)
class Stream:
    """Consecutive samples of one device, made into frames.

    Parameters
    ----------
    samples : list of list of Frame
        The parts of each sample.
    beside : list of list of Frame
        What goes out with each sample and is none of its parts: the thermometer.
    """

    samples: list[list[Frame]]
    beside: list[list[Frame]]


class EmulatedDevice:
    """A device that sends every sample as soon as it is switched on, and obeys nothing.

    Parameters
    ----------
    config : DeviceConfig
        Its entry in robot.yaml.
    meter : Meter
        What it measures.
    started : bool
        Whether somebody else on the bus started it, or polls it.
    """

    streams_at_power_up: ClassVar[bool] = True
    """Whether it sends before it is told to."""

    def __init__(self, config: DeviceConfig, meter: Meter, *, started: bool = False) -> None:
        self.name = config.name
        self.config = config
        self.meter = meter
        self.layout = DeviceLayout(config.name, config.device, self.limit_bits, config.counter_step)
        self.is_started = started
        self.streams = (started or self.streams_at_power_up) and not self.is_polled
        self.revision = 0
        """Grows whenever the same readings would become other frames."""
        self.newest: tuple[Frame, ...] = ()
        self.was_asked = False
        """Whether somebody wanted a sample since the last moment."""
        self.bias: Array | None = None
        """Subtracted on board, in raw units."""
        self.rest: Array | None = None
        """Raw mean in this pose: what a tare makes zero."""

    # Identifiers

    @property
    def ids(self) -> frozenset[int]:
        """Identifiers with which it sends samples."""
        return frozenset(self.layout.part_ids)

    @property
    def is_polled(self) -> bool:
        """Whether it sends a sample only when it is asked for one."""
        return self.config.device.description.join.request is not None

    @property
    def follows_sync(self) -> bool:
        """Whether it sends a sample on every SYNC."""
        return False

    @property
    def waits(self) -> bool:
        """Whether it sends a sample only when somebody wants one."""
        return self.is_polled or self.follows_sync

    @property
    def poll(self) -> Frame | None:
        """The frame that asks for one sample; None where it is not polled."""
        request = self.config.device.description.join.request
        if request is None:
            return None
        return Frame(self.config.device.relocate(request.id), self.poll_data)

    @property
    def poll_data(self) -> bytes:
        """Payload of a poll."""
        request = self.config.device.description.join.request
        return b"" if request is None else bytes(request.data).ljust(request.length, b"\0")

    # What the host says

    def boot(self) -> list[Frame]:
        """Return what it sends when it is switched on."""
        return []

    def hear(self, frame: Frame) -> list[Frame]:
        """Obey a frame that is meant for it, and return the answers.

        Polls are answered with the newest sample.
        """
        poll = self.poll
        if poll is not None and (frame.id, len(frame.data)) == (poll.id, len(poll.data)):
            self.was_asked = True
            return self.polled(frame)
        return self.obey(frame)

    def polled(self, frame: Frame) -> list[Frame]:
        """Return the answers to a poll."""
        del frame
        return list(self.newest)

    def obey(self, frame: Frame) -> list[Frame]:
        """Return the answers to a command; nothing to what is none."""
        del frame
        return []

    def tare(self) -> None:
        """Make what is measured in this pose zero."""
        if self.rest is not None:
            self.bias = self.rest if self.bias is None else self.bias + self.rest
            self.revision += 1

    def untare(self) -> None:
        """Forget the tare."""
        self.bias = None
        self.revision += 1

    # What it measures

    def stream(self, block: Block, first: int, index: int) -> Stream:
        """Return samples as frames.

        Parameters
        ----------
        block : Block
            Readings in SI units.
        first : int
            Running number of the first sample.
        index : int
            Number of the first sample within its pose.
        """
        reading = self.meter.read(block)
        values = reading.values if self.bias is None else reading.values - self.bias
        if index == 0:
            self.rest = np.rint(values.mean(axis=0))
        values, extra = self.converted(values, reading)
        count = first + np.arange(block.t.size, dtype=np.int64)
        samples = self.layout.frames(RawSamples(values, count, block.t, extra))
        beside = self._thermometer(reading, block.t, index)
        return Stream(samples, beside)

    def converted(self, values: Array, reading: Reading) -> tuple[Array, dict[str, Array]]:
        """Return the values as the device has them, and other signals of its parts."""
        temperature = self.config.device.description.temperature
        if temperature is None or temperature.message not in self.config.device.description.parts:
            return values, {}
        return values, {temperature.signal: reading.temperature / temperature.scale}

    def limit_bits(self, channel: int, *, high: bool) -> tuple[int, ...]:
        """Return the bits of the status word that say that a channel is at its limit."""
        status = self.config.device.description.status
        if status is None:
            return ()
        return (status.channels[channel][high],) if status.channels else status.saturated[:1]

    @property
    def thermometer_period(self) -> float:
        """Seconds between two messages of its own for the temperature; zero: it sends none."""
        temperature = self.config.device.description.temperature
        own = temperature is not None and temperature.message not in (
            self.config.device.description.parts
        )
        return 1.0 if own else 0.0

    def thermometer_columns(self, temperature: Array) -> dict[str, Array]:
        """Return the signals of the message for the temperature.

        Parameters
        ----------
        temperature : array, shape (n,)
            [deg C]
        """
        told = self.config.device.description.temperature
        return {} if told is None else {told.signal: temperature / told.scale}

    def _thermometer(self, reading: Reading, t: Array, index: int) -> list[list[Frame]]:
        beside: list[list[Frame]] = [[] for _ in range(t.size)]
        temperature = self.config.device.description.temperature
        period = self.thermometer_period
        if temperature is None or period <= 0.0 or t.size < 2:
            return beside
        every = max(1, round(period / float(np.median(np.diff(t)))))
        for row in range(-index % every, t.size, every):
            columns = self.thermometer_columns(reading.temperature[row : row + 1])
            beside[row] = [self.layout.message_frame(temperature.message, columns, float(t[row]))]
        return beside
