# SPDX-License-Identifier: Apache-2.0
"""From frames to the calibrated samples of one device."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from comcal_drivers.bus.error_frames import is_gap
from comcal_drivers.calibrate.calibrated import status_notes
from comcal_drivers.calibrate.drive import DriveCalibration, drive_calibration
from comcal_drivers.calibrate.imu import ImuCalibration, imu_calibration
from comcal_drivers.calibrate.temperature import Temperatures, temperatures
from comcal_drivers.calibrate.wrench import WrenchCalibration, wrench_calibration
from comcal_drivers.decode.table import decode
from comcal_drivers.devices.commands import DeviceValues, Listener
from comcal_drivers.devices.configuration import DeviceConfig, JointConfig, SensorConfig
from comcal_drivers.devices.tables import bus_table
from comcal_drivers.frames.batch import FrameBatch
from comcal_drivers.frames.batches import take
from comcal_drivers.join.joiner import Joiner, joiner_for
from comcal_drivers.join.sample import SATURATED, STATUS, Counts, Samples
from comcal_drivers.source.assemble import CURRENT, POSITION, TORQUE, Pending, Slot
from comcal_drivers.source.series import Series, chained, no_series

Calibration = WrenchCalibration | DriveCalibration | ImuCalibration


class Pipeline:
    """Decodes, joins and calibrates what one device sends, however the stream is cut.

    Parameters
    ----------
    config : DeviceConfig
    told : mapping
        What the device told about itself earlier, such as its matrix; what it tells in the frames
        themselves is newer.

    Raises
    ------
    ConfigError
        If its description does not fit its DBC; when samples come, if its matrix or another value
        is needed that nobody says.
    """

    def __init__(self, config: DeviceConfig, told: DeviceValues) -> None:
        self.config = config
        self.table = bus_table(config.device)
        self._joiner = self._new_joiner()
        self._counts_samples = config.device.description.join.signal is not None
        self._earlier_counts = Counts()
        self._listener = Listener(config.device)
        self._earlier = dict(told)
        self._made_with: DeviceValues | None = None
        self._calibration: Calibration | None = None
        self._judged = Counts()
        self.warmth = Temperatures(np.empty(0), np.empty(0, np.int64), np.empty(0))
        """The newest temperatures."""

    @property
    def told(self) -> DeviceValues:
        """What the device has told about itself."""
        return {**self._earlier, **self._listener.values}

    @property
    def counts(self) -> Counts:
        """What became of its frames and samples."""
        return self._earlier_counts + self._joiner.counts + self._judged

    @property
    def notes(self) -> tuple[str, ...]:
        """What its status words said, in sentences."""
        description = self.config.device.description
        return status_notes(description, self.counts, self.config.ignore_where)

    @property
    def pending(self) -> Pending | None:
        """The oldest frame that waits for others."""
        oldest = self._joiner.oldest
        return None if oldest is None else Pending(*oldest)

    def feed(self, batch: FrameBatch, first_row: int) -> Series:
        """Return the samples that became known with *batch*; NaN where they cannot be used."""
        pieces: list[Series] = []
        begin = 0
        for gap in [*np.flatnonzero(is_gap(batch)).tolist(), len(batch)]:
            pieces.append(self._feed(take(batch, np.arange(begin, gap)), first_row + begin))
            if gap < len(batch) and not self._counts_samples:
                pieces.append(self._begin_anew())
            begin = gap
        return chained(pieces, self.slot(-1).width)

    def finish(self) -> Series:
        """Return the samples that the end of the stream completes."""
        return self._usable(self._joiner.finish())

    def _begin_anew(self) -> Series:
        """Let no frame from before a gap meet one from behind it: nothing would show it."""
        last = self._usable(self._joiner.finish())
        self._earlier_counts = self._earlier_counts + replace(self._joiner.counts, pending=0)
        self._earlier_counts = self._earlier_counts + Counts(resyncs=1)
        self._joiner = self._new_joiner()
        return last

    def _feed(self, batch: FrameBatch, first_row: int) -> Series:
        self._listener.see(batch)
        decoded = decode(self.table, batch)
        device = self.config.device
        warmth = temperatures(device, self.table, decoded, batch.t, first_row)
        self.warmth = warmth if warmth.value.size else self.warmth
        return self._usable(self._joiner.feed(decoded, batch, first_row))

    def _usable(self, samples: Samples) -> Series:
        if not len(samples):
            return no_series(self.slot(-1).width)
        found = self._calibrated().apply(samples)
        self._judged = self._judged + found.counts
        values = found.values.copy()
        values[(found.flags & (STATUS | SATURATED)) != 0] = np.nan
        return Series(found.last_row, found.t, found.counter, values)

    def _new_joiner(self) -> Joiner:
        return joiner_for(self.config, self.table)

    def slot(self, joint: int) -> Slot:
        """Return where its values go; *joint* is the index of its joint, if it has one."""
        config = self.config
        if isinstance(config, SensorConfig):
            return Slot(config.name, 6, config.timeout, measures=_components(config))
        if not isinstance(config, JointConfig):
            return Slot(config.name, 3, config.timeout)
        drive = config.device.description.calibrate.drive
        signals = {POSITION: "position", CURRENT: "current", TORQUE: "torque"}
        measures = tuple(k for k, name in signals.items() if getattr(drive, name, None) is not None)
        return Slot(config.name, 3, config.timeout, joint, measures)

    def _calibrated(self) -> Calibration:
        values = self.told
        if self._calibration is None or values != self._made_with:
            self._calibration = _calibration(self.config, values)
            self._made_with = values
        return self._calibration


def _calibration(
    config: DeviceConfig, values: Mapping[str, float | tuple[float, ...] | str]
) -> Calibration:
    if isinstance(config, SensorConfig):
        return wrench_calibration(config, values)
    if isinstance(config, JointConfig):
        return drive_calibration(config, values)
    return imu_calibration(config)


def _components(config: SensorConfig) -> tuple[int, ...]:
    """Return the components that a sensor measures: three-axis ones leave the moments out."""
    rule = config.device.description.calibrate.force_torque
    if rule is None or rule.matrix != "none" or config.matrix is not None:
        return tuple(range(6))
    forces = any(axis in rule.channels for axis in ("fx", "fy", "fz"))
    moments = any(axis in rule.channels for axis in ("tx", "ty", "tz"))
    return (*(range(3) if forces else ()), *(range(3, 6) if moments else ()))
