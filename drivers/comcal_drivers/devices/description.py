# SPDX-License-Identifier: Apache-2.0
"""A sensor or a drive as a file: ``NAME.yaml`` for its meaning, ``NAME.dbc`` for its bytes.

A DBC describes fields within one frame. What it cannot say stands in the YAML beside it: which
frames are one sample, how they find each other, the matrix, status bits, saturation, handedness,
and the frames that start, tare and question the device.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Literal

from pydantic import Field, model_validator

from comcal.errors import ConfigError
from comcal.robot.locate import read_yaml
from comcal.robot.validate import did_you_mean, validate_file
from comcal_drivers.devices.calibration_rules import AXES as AXES
from comcal_drivers.devices.calibration_rules import Calibrate
from comcal_drivers.devices.calibration_rules import Drive as Drive
from comcal_drivers.devices.calibration_rules import DriveSignal as DriveSignal
from comcal_drivers.devices.calibration_rules import ForceTorque as ForceTorque
from comcal_drivers.devices.calibration_rules import Imu as Imu
from comcal_drivers.devices.calibration_rules import Levels as Levels
from comcal_drivers.devices.command_rules import Command
from comcal_drivers.devices.command_rules import DataField as DataField
from comcal_drivers.devices.command_rules import DataSum as DataSum
from comcal_drivers.devices.command_rules import Gives as Gives
from comcal_drivers.devices.command_rules import Reply as Reply
from comcal_drivers.devices.command_rules import Step as Step
from comcal_drivers.devices.section import Byte, Number, Section

FILES = Path(__file__).parent / "files"
"""Folder of the devices that come with comcal."""
Kind = Literal["force_torque", "drive", "imu"]


class IdKey(Section):
    """A number that the user sets on the device; it moves all identifiers.

    The identifier on the bus is that of the DBC plus the sum of ``value << shift`` over the keys.
    """

    default: int
    shift: int = Field(0, ge=0, le=28)
    maximum: int = Field(0x7F, ge=0)
    """Largest value; the smallest is 0."""


class Request(Section):
    """The host's poll for one sample, told from the answer by its length, and by its bytes where
    other commands have the same identifier and length.
    """

    id: int
    """As in the DBC, before the keys of ``ids`` move it."""
    length: int = Field(ge=0, le=8)
    data: tuple[Byte, ...] = ()
    """First bytes of it."""

    @model_validator(mode="after")
    def _fits(self) -> Request:
        if len(self.data) > self.length:
            raise ConfigError("the request has more bytes than its length")
        return self


class Checksum(Section):
    """The last bytes of a message hold the sum of all bytes before them."""

    kind: Literal["sum16_be", "sum8"]


class Join(Section):
    """How the parts of one sample find each other.

    ``counter``: parts with the same value of ``signal``. ``fifo``: in order, by groups that close
    when everything is balanced. ``concatenate``: the bytes of the parts, in order, are one longer
    ``message`` of the DBC; with one part only, packets of ``length`` bytes are cut at the frames
    that begin with ``header``. ``single``: a frame is a sample.
    """

    rule: Literal["single", "counter", "fifo", "concatenate"]
    signal: str | None = None
    """The counter; with ``concatenate`` a signal of ``message``."""
    modulus: int | None = Field(None, gt=1)
    step: int = Field(1, ge=0)
    """What the counter grows by from sample to sample; 0 where nobody knows, then it only tells the
    time and gaps tell nothing."""
    request: Request | None = None
    timeout: float = Field(0.05, gt=0.0)
    """No two parts of a sample are further apart [s]."""
    depth: int = Field(4, ge=1, le=64)
    """No part comes more samples late than this."""
    message: str | None = None
    header: tuple[Byte, ...] = ()
    """First bytes of a concatenated sample; those that begin otherwise answer a command."""
    length: int | None = Field(None, gt=0, le=64)
    checksum: Checksum | None = None

    @model_validator(mode="after")
    def _complete(self) -> Join:
        if (self.signal is None) != (self.modulus is None):
            raise ConfigError("a counter needs both `signal` and `modulus`")
        if self.rule == "counter" and self.signal is None:
            raise ConfigError("joining by counter needs `signal` and `modulus`")
        if (self.rule == "concatenate") != (self.message is not None):
            raise ConfigError("`message` belongs to the rule concatenate, and only to it")
        if self.length is not None and not self.header:
            raise ConfigError("packets of `length` bytes are found by their `header`")
        return self


class Trailer(Section):
    """A status byte that is there only when the frame is longer than its message."""

    byte: int = Field(ge=0, le=63)


class StatusWord(Section):
    """Where the device complains.

    With ``trailer`` the status of part k (from 0) of the sample stands in bits 8k to 8k+7.
    """

    signal: str | None = None
    trailer: Trailer | None = None
    bits: Mapping[Number, str] = Field(default_factory=dict)
    """What bits mean. Each spoils a sample unless robot.yaml ignores it; bits that are not listed
    are counted, and spoil nothing."""
    saturated: tuple[int, ...] = ()
    """Bits that mean: a channel is at its limit."""
    channels: tuple[tuple[int, int], ...] = ()
    """For each value, the bits of its lower and its upper limit, where the device tells."""

    @model_validator(mode="after")
    def _one_place(self) -> StatusWord:
        if (self.signal is None) == (self.trailer is None):
            raise ConfigError("a status stands either in a `signal` or in a `trailer`")
        return self


class Select(Section):
    """Devices that share an identifier: only frames whose ``signal`` equals the id key ``key``.

    That key does not move identifiers.
    """

    signal: str
    key: str


class Temperature(Section):
    """A signal in its own, slower message."""

    message: str
    signal: str
    scale: float = 1.0


class Description(Section):
    """The content of a device file."""

    format: Literal["comcal-device/1"]
    name: str
    title: str
    kind: Kind
    source: tuple[str, ...] = Field(min_length=1)
    """Manual and section, or public file, that each fact was read in."""
    notes: tuple[str, ...] = ()
    bitrate: int | None = Field(None, gt=0)
    ids: Mapping[str, IdKey] = Field(default_factory=dict)
    settings: Mapping[str, float] = Field(default_factory=dict)
    """Values that commands use and robot.yaml may change, with their defaults."""
    select: Select | None = None
    parts: tuple[str, ...] = Field(min_length=1)
    """Messages of the DBC that are one sample, in order."""
    join: Join
    values: tuple[str, ...] = Field(min_length=1)
    """Signals, in the order of the raw vector."""
    status: StatusWord | None = None
    temperature: Temperature | None = None
    calibrate: Calibrate = Calibrate()
    commands: Mapping[str, Command] = Field(default_factory=dict)
    start: tuple[str, ...] = ()
    """Commands before the first sample, in order."""
    reserves: Mapping[Number, str] = Field(default_factory=dict)
    """Identifiers that must mean this, and nothing else, on the device's bus."""

    @model_validator(mode="after")
    def _consistent(self) -> Description:
        one_message = len(self.parts) == 1 and self.join.message is None
        if one_message != (self.join.rule == "single"):
            raise ConfigError("the rule single is for samples of one message, and they need it")
        if len(self.parts) == 1 and self.join.message is not None and self.join.length is None:
            raise ConfigError("packets of one message's frames need `header` and `length`")
        for name in self.start:
            if name not in self.commands:
                raise ConfigError(
                    f"there is no command {name!r} to start with",
                    next_step=did_you_mean(name, list(self.commands)),
                )
        if self.select is not None and self.select.key not in self.ids:
            raise ConfigError(f"select: {self.select.key!r} is not one of the ids")
        if getattr(self.calibrate, self.kind) is None:
            raise ConfigError(f"`calibrate` lacks the section {self.kind!r}")
        self._channels()
        return self

    def _channels(self) -> None:
        """Check that every channel has what it needs."""
        rule, n = self.calibrate.force_torque, len(self.values)
        if rule is not None:
            if rule.matrix == "none" and len(rule.channels) != n:
                raise ConfigError(f"without a matrix {n} values need {n} `channels`")
            if isinstance(rule.scale, tuple) and len(rule.scale) != n:
                raise ConfigError(f"{n} values need {n} numbers in `scale`, or one")
        drive = self.calibrate.drive
        if drive is not None:
            for quantity in (drive.position, drive.current, drive.torque):
                if quantity is not None and quantity.signal not in self.values:
                    raise ConfigError(
                        f"{quantity.signal!r} is not one of the values",
                        next_step=did_you_mean(quantity.signal, self.values),
                    )
        if self.kind == "imu" and n != 3:
            raise ConfigError("an IMU has three values: the specific force along x, y, z")


@dataclass(frozen=True)
class Device:
    """A description with the numbers that are set on one piece of hardware.

    Parameters
    ----------
    description : Description
    dbc : Path
        The DBC with identifiers before :meth:`relocate`.
    ids : mapping from id key to int
        Every key of ``description.ids``.
    """

    description: Description
    dbc: Path
    ids: Mapping[str, int]

    @cached_property
    def offset(self) -> int:
        """What is added to every identifier of the DBC."""
        select = self.description.select
        fixed = "" if select is None else select.key
        keys = self.description.ids
        return sum(v << keys[key].shift for key, v in self.ids.items() if key != fixed)

    def relocate(self, dbc_id: int) -> int:
        """Return the identifier on the bus of a message whose identifier in the DBC is *dbc_id*.

        Bit 31, which marks 29-bit identifiers, stays as it is.
        """
        return dbc_id + self.offset

    def step_id(self, step: Step) -> int:
        """Return the identifier on the bus of a command's frame."""
        if step.shift is None:
            return self.relocate(step.id)
        return step.id + sum(self.ids[key] << shift for key, shift in step.shift.items())


def device_names() -> tuple[str, ...]:
    """Return the names of the devices that come with comcal."""
    return tuple(sorted(path.stem for path in FILES.glob("*.yaml")))


def load_description(path: Path) -> Description:
    """Read and check one device file.

    Raises
    ------
    ConfigError
        With file and line.
    """
    return validate_file(read_yaml(path), Description)


def load_device(
    name: str, ids: Mapping[str, int] | None = None, *, folder: Path | None = None
) -> Device:
    """Return the device *name*, one that comes with comcal or a file ``NAME.yaml`` in *folder*.

    Parameters
    ----------
    name : str
        ``ati_netcanoem``, or the path of a YAML file with a DBC beside it.
    ids : mapping from str to int, optional
        Replaces the defaults of ``ids`` in the description.
    folder : Path, optional
        Where relative paths of own device files start.

    Raises
    ------
    ConfigError
        If there is no such device, no such id key, or its value is out of range.
    """
    path = FILES / f"{name}.yaml"
    if name.endswith((".yaml", ".yml")):
        path = (folder or Path()) / name
    elif not path.is_file():
        raise ConfigError(
            f"there is no device {name!r}", next_step=did_you_mean(name, device_names())
        )
    description = load_description(path)
    defaults = {key: entry.default for key, entry in description.ids.items()}
    return with_ids(Device(description, path.with_suffix(".dbc"), defaults), ids or {})


def with_ids(device: Device, ids: Mapping[str, int]) -> Device:
    """Return a device on which other *ids* are set; those not named stay.

    Raises
    ------
    ConfigError
        If there is no such id key, or its value is out of range.
    """
    known = device.description.ids
    for key, value in ids.items():
        if key not in known:
            raise ConfigError(
                f"device {device.description.name} has no id {key!r}",
                next_step=did_you_mean(key, list(known)) or "it has none: leave `ids` out",
            )
        if not 0 <= value <= known[key].maximum:
            raise ConfigError(
                f"id {key!r} of device {device.description.name} is out of range",
                measured=f"{value:#x}",
                limit=f"0 to {known[key].maximum:#x}",
            )
    return replace(device, ids={**device.ids, **ids})
