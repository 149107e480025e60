# SPDX-License-Identifier: Apache-2.0
"""Frames of all buses in, blocks of samples out: the one path of live buses and of logs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from comcal.measure.source import Block
from comcal.robot.model import Robot
from comcal_drivers.devices.commands import DeviceValues
from comcal_drivers.devices.configuration import CanConfig
from comcal_drivers.frames.batch import FrameBatch
from comcal_drivers.join.sample import Counts
from comcal_drivers.source.assemble import Assembler, Pending
from comcal_drivers.source.clock import SampleClock
from comcal_drivers.source.order import FrameOrder
from comcal_drivers.source.pipeline import Pipeline
from comcal_drivers.source.series import Array, Series


class SampleStream:
    """Turns frames into samples; on one bus, however the stream is cut.

    Parameters
    ----------
    config : CanConfig
    robot : Robot
    told : mapping from device name to its values, optional
        What devices told earlier: matrices, full scales, rated currents.
    origin : float, optional
        The stamp that is time zero [s]; None: that of the first frame.

    Raises
    ------
    ConfigError
        If a description does not fit its DBC.
    """

    def __init__(
        self,
        config: CanConfig,
        robot: Robot,
        told: Mapping[str, DeviceValues] | None = None,
        origin: float | None = None,
    ) -> None:
        earlier = told or {}
        self._pipelines = {
            device.name: Pipeline(device, earlier.get(device.name, {}))
            for device in config.every_device
        }
        self._order = FrameOrder(tuple(config.buses))
        joints = robot.tree.joint_names
        clock = self._pipelines[config.clock].config
        join = clock.device.description.join
        step = clock.counter_step if clock.counter_step is not None else join.step
        self._is_timed = origin is not None
        time = SampleClock(
            config.clock, clock.period, join.modulus, step, clock.timeout, origin or 0.0
        )
        self._assembler = Assembler(
            [
                pipeline.slot(joints.index(name) if name in config.joints else -1)
                for name, pipeline in self._pipelines.items()
            ],
            config.clock,
            time,
            len(joints),
        )
        self._warmth = {
            device.name: np.nan
            for device in config.every_device
            if device.device.description.temperature is not None
        }

    @property
    def told(self) -> dict[str, DeviceValues]:
        """What every device has told about itself."""
        return {name: pipeline.told for name, pipeline in self._pipelines.items()}

    @property
    def counts(self) -> dict[str, Counts]:
        """What became of the frames of every device."""
        return {name: pipeline.counts for name, pipeline in self._pipelines.items()}

    @property
    def gaps(self) -> Mapping[str, int]:
        """Rows in which each device owed its part, and which therefore carry no wrenches."""
        return self._assembler.gaps

    @property
    def lost(self) -> dict[str, int]:
        """What did not become a usable sample, by device and kind; only what there was."""
        kinds = ("lost", "duplicated", "orphaned", "short", "resyncs", "saturated")
        found = {
            f"{name} {kind}": int(getattr(counts, kind))
            for name, counts in self.counts.items()
            for kind in kinds
        }
        found |= {f"{name} gaps": gaps for name, gaps in self.gaps.items()}
        time = self._assembler.time
        found[f"{time.device} pauses"] = time.paused
        return {name: count for name, count in found.items() if count}

    @property
    def notes(self) -> tuple[str, ...]:
        """What status words and clocks said, in sentences."""
        found = [
            f"{name}: {note}"
            for name, pipeline in self._pipelines.items()
            for note in pipeline.notes
        ]
        time = self._assembler.time
        if time.turned_back:
            found.append(f"the clock of the stamps went back {time.turned_back} times")
        if time.restarted:
            found.append(f"{time.device}: its counter began anew {time.restarted} times")
        return tuple(found)

    def begin(self) -> None:
        """Let nothing that came before take part in the rows to come.

        They begin with the first one for which every device has spoken since.
        """
        self._assembler.begin_after(self._order.last)
        self._assembler.time.begin()

    def feed(self, batches: Mapping[str, FrameBatch]) -> Block:
        """Return the rows that frames of all buses complete, perhaps none.

        Parameters
        ----------
        batches : mapping from bus to FrameBatch
            That came together.
        """
        if not self._is_timed:
            self._begin_time(batches)
        first = {bus: self._order.first_row(bus) for bus in batches}
        self._order.take(batches)
        series: dict[str, Series] = {}
        pending: dict[str, Pending] = {}
        for name, pipeline in self._pipelines.items():
            bus = pipeline.config.bus
            if bus in batches:
                found = pipeline.feed(batches[bus], first[bus])
                series[name] = replace(found, row=self._order.of(bus, found.row))
                if pipeline.warmth.value.size:
                    self._warmth[name] = float(pipeline.warmth.value[-1])
            held = pipeline.pending
            if held is not None:
                row = self._order.of(bus, np.array([held.row]))
                pending[name] = Pending(int(row[0]), held.t)
        return self._rows(series, pending)

    def _begin_time(self, batches: Mapping[str, FrameBatch]) -> None:
        stamps = [float(batch.t[0]) for batch in batches.values() if len(batch)]
        if stamps:
            self._is_timed = True
            self._assembler.time.origin = min(stamps) if np.isfinite(stamps).all() else 0.0

    def finish(self) -> Block:
        """Return the rows that the end of the stream completes, perhaps none."""
        series: dict[str, Series] = {}
        for name, pipeline in self._pipelines.items():
            found = pipeline.finish()
            series[name] = replace(found, row=self._order.of(pipeline.config.bus, found.row))
        return self._rows(series, {})

    def _rows(self, series: Mapping[str, Series], pending: Mapping[str, Pending]) -> Block:
        block = self._assembler.feed(series, pending)
        return replace(block, temperatures=self._temperatures(len(block.t)))

    def _temperatures(self, n: int) -> dict[str, Array]:
        """Return the newest reading of every thermometer; they change slowly."""
        return {name: np.full(n, value) for name, value in self._warmth.items()}
