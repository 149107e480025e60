# SPDX-License-Identifier: Apache-2.0
"""The parts of every sample of one device brought together, from a stream of any length.

What comes out does not depend on how the stream is cut into batches, and nothing is kept but the
few frames that wait for their partners.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from comcal_drivers.decode.table import Decoded, DecodeTable
from comcal_drivers.devices.configured import DeviceConfig
from comcal_drivers.devices.description import Device
from comcal_drivers.frames.batch import FrameBatch
from comcal_drivers.join.counter import Counter
from comcal_drivers.join.events import Events, Gatherer, chain_events
from comcal_drivers.join.fifo import Fifo
from comcal_drivers.join.packets import Packets
from comcal_drivers.join.pairs import Pairing, Single
from comcal_drivers.join.reading import Reading
from comcal_drivers.join.sample import Counts, Samples, no_samples

TRUSTED_TURN = 0.25
"""A counter is trusted over a silence of up to this part of its turn."""


class Joiner:
    """Joins the samples of one device.

    Parameters
    ----------
    device : Device
    table : DecodeTable
        Its messages by identifier on the bus: :func:`~comcal_drivers.devices.tables.bus_table`.
    timeout : float, optional
        Seconds that two parts of a sample may be apart; default: that of the description.
    period : float, optional
        Seconds between two samples, where known: tells when a counter may have gone round.
    counter_step : int, optional
        What the counter grows by from sample to sample; default: that of the description.

    Raises
    ------
    ConfigError
        If the table lacks a part or a signal of the description.

    Attributes
    ----------
    parts : int
        Frames of a sample.
    """

    def __init__(
        self,
        device: Device,
        table: DecodeTable,
        *,
        timeout: float | None = None,
        period: float | None = None,
        counter_step: int | None = None,
    ) -> None:
        join, parts = device.description.join, len(device.description.parts)
        self._gatherer = Gatherer(device, table)
        self._reading = Reading(device, self._gatherer.columns)
        timeout = join.timeout if timeout is None else timeout
        counter = _counter(device, counter_step, period)
        self._order: Pairing | None = None
        if join.rule == "counter" and counter is not None:
            counter.parts, counter.timeout = parts, timeout
            self._pairing: Pairing = counter
        else:
            self._order = counter
            if join.rule == "single":
                self._pairing = Single()
            elif join.length is not None:
                packets = Packets(join.header, join.length, timeout)
                self._pairing, parts = packets, packets.parts
            else:
                self._pairing = Fifo(parts, join.depth, timeout)
        self.parts = parts
        self._held = self._gatherer.nothing()
        self._waiting: Events | None = None
        self._channels = len(device.description.values)
        self._frames = self._emitted = 0
        self._last_row = np.int64(-1)

    @property
    def counts(self) -> Counts:
        """What became of the frames so far."""
        first, second, spoilt = self._pairing, self._order, self._reading.spoilt
        waiting = 0 if self._waiting is None else len(self._waiting)
        counts = Counts(
            frames=self._frames,
            samples=self._emitted,
            lost=first.lost + spoilt.lost if second is None else second.lost,
            duplicated=first.duplicated,
            orphaned=first.orphaned + spoilt.orphaned,
            short=first.short + spoilt.short,
            resyncs=first.resyncs,
            other=first.other + spoilt.other,
            pending=len(self._held) + waiting * self.parts,
        )
        if second is None:
            return counts
        return counts + Counts(
            duplicated=second.duplicated * self.parts,
            orphaned=second.orphaned * self.parts,
            short=second.short * self.parts,
            resyncs=second.resyncs,
        )

    @property
    def oldest(self) -> tuple[int, float] | None:
        """Running index and stamp [s] of the oldest part that is held back; None: none is."""
        held = [e for e in (self._waiting, self._held) if e is not None]
        parts = [(e, int(np.argmax(e.code >= 0))) for e in held if (e.code >= 0).any()]
        found = [(int(e.row[first]), float(e.t[first])) for e, first in parts]
        return min(found, default=None)

    def feed(self, decoded: Mapping[int, Decoded], batch: FrameBatch, first_row: int) -> Samples:
        """Return the samples that the frames of a batch complete.

        Parameters
        ----------
        decoded : mapping from identifier to Decoded
            The batch, decoded with a table that holds at least this device's messages.
        batch : FrameBatch
        first_row : int
            Running index of its first frame since the start of the stream.

        Returns
        -------
        Samples
        """
        new = self._gatherer.gather(decoded, batch, first_row)
        if not len(new):
            return no_samples(self._channels)
        self._frames += len(new)
        return self._join(new, at_end=False)

    def finish(self) -> Samples:
        """Return the samples that the end of the stream completes; what is left is orphaned."""
        return self._join(self._gatherer.nothing(), at_end=True)

    def _join(self, new: Events, *, at_end: bool) -> Samples:
        """Pair, read, put in order."""
        events = chain_events(self._held, new)
        pairs = self._pairing.pair(events, at_end=at_end)
        samples = self._reading.read(events, pairs)
        self._held = events.take(pairs.keep)
        if self._order is not None:
            waiting = samples if self._waiting is None else chain_events(self._waiting, samples)
            order = self._order.pair(waiting, at_end=at_end)
            samples = waiting.take(order.index[:, 0])
            samples.flags[:] |= order.flags
            self._waiting = waiting.take(order.keep)
        self._emitted += len(samples)
        last_row = np.maximum.accumulate(np.maximum(samples.row, self._last_row))
        self._last_row = last_row[-1] if last_row.size else self._last_row
        return Samples(
            samples.t, samples.counter, last_row, samples.raw, samples.status, samples.flags
        )


def joiner_for(config: DeviceConfig, table: DecodeTable) -> Joiner:
    """Return the joiner of a configured device; *table* holds at least its messages."""
    return Joiner(
        config.device,
        table,
        timeout=config.apart,
        period=config.period,
        counter_step=config.counter_step,
    )


def _counter(device: Device, step: int | None, period: float | None) -> Counter | None:
    """Return what watches the counter of whole samples; None where there is nothing to watch."""
    join = device.description.join
    step = join.step if step is None else step
    if join.modulus is None or step == 0:
        return None
    turn = np.inf if period is None else join.modulus / step * period
    return Counter(1, join.modulus, step, np.inf, TRUSTED_TURN * turn)
