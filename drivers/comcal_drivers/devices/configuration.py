# SPDX-License-Identifier: Apache-2.0
"""Which devices hang on which bus of a robot: what ``sources.can`` of robot.yaml says, checked."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from comcal.errors import ComcalError, ConfigError
from comcal.robot.frames import rotation_from_rpy
from comcal.robot.locate import Key, LocatedYaml, read_yaml
from comcal.robot.model import Robot
from comcal.robot.validate import did_you_mean, validate_file
from comcal_drivers.devices.clashes import check_identifiers
from comcal_drivers.devices.configured import (
    BusConfig,
    CanConfig,
    ImuConfig,
    JointConfig,
    SensorConfig,
)
from comcal_drivers.devices.configured import DeviceConfig as DeviceConfig
from comcal_drivers.devices.description import Description, Device, Kind, load_device, with_ids
from comcal_drivers.devices.schema import (
    CanSection,
    DeviceSection,
    ImuSection,
    JointSection,
    OptionsFile,
    SensorSection,
)

Array = npt.NDArray[np.float64]
Result = TypeVar("Result")

_HERE: tuple[Key, ...] = ("sources", "can")

ASKED = 0.2
"""How old a sample may be that this computer has to ask for [s]."""


def read_configuration(options: Mapping[str, object], robot: Robot) -> CanConfig:
    """Check ``sources.can`` of robot.yaml against the robot and the devices' descriptions.

    Parameters
    ----------
    options : mapping
        ``sources.can`` as robot.yaml has it.
    robot : Robot
        ``robot.yaml_path`` serves to name lines, and as the start of relative paths.

    Returns
    -------
    CanConfig

    Raises
    ------
    ConfigError
        With file, line, and the name that was probably meant: unknown keys, buses, devices, joints,
        sensors or settings; ids out of range, or used twice on one bus; a matrix of another shape.
    """
    return _Reader(_located(options, robot), robot).read()


class _Reader:
    """The cross checks; each refusal names the line."""

    def __init__(self, located: LocatedYaml, robot: Robot) -> None:
        self.located = located
        self.robot = robot
        self.folder = located.path.parent
        self.section: CanSection = validate_file(located, OptionsFile).sources.can

    def read(self) -> CanConfig:
        section, robot = self.section, self.robot
        wrenches = (*robot.sensors, *robot.plates)
        sensors = {
            name: self.sensor(name, s)
            for name, s in section.sensors.items()
            if self.known("sensor", name, wrenches, "sensors", name)
        }
        joints = {
            name: self.joint(name, s)
            for name, s in section.joints.items()
            if self.known("joint", name, robot.tree.joint_names, "joints", name)
        }
        config = CanConfig(
            {
                name: BusConfig(name, b.interface, b.channel, b.bitrate, b.model_extra or {})
                for name, b in section.buses.items()
            },
            sensors,
            joints,
            self.imu(section.imu) if section.imu else None,
            self.clock((*sensors, *joints)),
        )
        for name in config.buses:
            check_identifiers(
                [(d.name, d.device) for d in config.devices(name)], self.where("buses", name)
            )
        return config

    def sensor(self, name: str, section: SensorSection) -> SensorConfig:
        """Return one force/torque sensor."""
        here = ("sensors", name)
        common = self.common(name, section, "force_torque", here)
        description = common["device"].description
        channels = len(description.values)
        matrix = self.matrix(section.matrix, channels, (*here, "matrix"))
        calibrate = description.calibrate.force_torque
        if matrix is None and calibrate is not None and calibrate.matrix == "given":
            raise self.error(
                f"device {section.device} needs a `matrix`",
                *here,
                next_step=f"give the 6 x {channels} matrix of its calibration sheet, or a file",
            )
        return SensorConfig(
            **common,
            matrix=matrix,
            bias=self.vector(section.bias, channels, *here, "bias"),
            scale=self.vector(section.scale, channels, *here, "scale"),
            full_scale=self.vector(section.full_scale, channels, *here, "full_scale"),
            counts_per_force=section.counts_per_force,
            counts_per_torque=section.counts_per_torque,
            signs=np.array(section.signs, np.float64),
            R_sensor_device=rotation_from_rpy(np.array(section.rotate)),
        )

    def joint(self, name: str, section: JointSection) -> JointConfig:
        """Return one drive."""
        here = ("joints", name)
        common = self.common(name, section, "drive", here)
        drive = common["device"].description.calibrate.drive
        motor = self.robot.motors.get(name)
        gear = section.gear if section.gear is not None else motor.gear if motor else 1.0
        position = drive.position if drive else None
        if position is not None and position.unit == "counts" and section.counts_per_turn is None:
            raise self.error(
                f"device {section.device} sends positions in counts: `counts_per_turn` is missing",
                *here,
                next_step="give the counts of the encoder per turn of the motor, quadrature "
                "included: four times its pulses",
            )
        ranged = {
            quantity
            for quantity in ("position", "current", "torque")
            if drive and getattr(getattr(drive, quantity), "linear", None)
        }
        for quantity in section.ranges:
            self.known("range", quantity, sorted(ranged), *here, "ranges", quantity)
        return JointConfig(
            **common,
            counts_per_turn=section.counts_per_turn,
            gear=gear,
            sign=section.sign,
            zero=section.zero,
            rated_current=section.rated_current,
            rated_torque=section.rated_torque,
            ranges=section.ranges,
            eds=self.file(section.eds, *here, "eds"),
            dcf=self.file(section.dcf, *here, "dcf"),
            sync_period=section.sync_period,
        )

    def imu(self, section: ImuSection) -> ImuConfig:
        """Return the IMU."""
        if self.robot.imu_link is None:
            raise self.error("the robot has no IMU", "imu", next_step="add `imu: {link: NAME}`")
        common = self.common(self.robot.imu_link, section, "imu", ("imu",))
        return ImuConfig(**common, R_link_device=rotation_from_rpy(np.array(section.rotate)))

    def common(
        self, name: str, section: DeviceSection, kind: Kind, here: tuple[Key, ...]
    ) -> dict[str, Any]:
        """Return the arguments that every device has."""
        self.known("bus", section.bus, list(self.section.buses), *here, "bus")
        folder = self.folder
        plain = self.at((*here, "device"), lambda: load_device(section.device, folder=folder))
        description = plain.description
        if description.kind != kind:
            raise self.error(
                f"{section.device} is a device of kind {description.kind}, not {kind}",
                *here,
                "device",
            )
        device = self.at((*here, "ids"), lambda: with_ids(plain, section.ids))
        settings = dict(description.settings)
        for setting, value in section.settings.items():
            self.known("setting", setting, list(settings), *here, "settings", setting)
            settings[setting] = value
        start = description.start if section.start is None else section.start
        for command in start:
            self.known("command", command, list(description.commands), *here, "start")
        self.status_bits(section, device, *here)
        timeout = section.timeout or _timeout(description, section)
        longest = section.timeout or description.join.timeout
        return {
            "name": name,
            "bus": section.bus,
            "device": device,
            "period": section.period,
            "timeout": timeout,
            "apart": section.apart or _apart(description, section.period, longest),
            "counter_step": section.counter_step,
            "ignore_status": section.ignore_status,
            "ignore_where": self.where(*here, "ignore_status") if section.ignore_status else "",
            "settings": settings,
            "start": tuple(start),
        }

    def status_bits(self, section: DeviceSection, device: Device, *here: Key) -> None:
        """Refuse to ignore a bit that the device does not have."""
        status = device.description.status
        known = {*status.bits, *status.saturated} if status else set[int]()
        for bit in section.ignore_status:
            if bit not in known:
                names = ", ".join(map(str, sorted(known))) or "none"
                raise self.error(
                    f"device {section.device} has no status bit {bit} that spoils a sample",
                    *here,
                    "ignore_status",
                    next_step=f"its bits are {names}",
                )

    def clock(self, names: Sequence[str]) -> str:
        """Return whose samples make the rows of a Block."""
        if not names:
            raise self.error(
                "no sensor and no joint is configured",
                next_step="add `sensors:` or `joints:`",
            )
        if self.section.clock is None:
            return names[0]
        self.known("device", self.section.clock, names, "clock")
        return self.section.clock

    def matrix(
        self, given: list[list[float]] | str | None, channels: int, here: tuple[Key, ...]
    ) -> Array | None:
        """Return a matrix, from a file where a path is given."""
        if given is None:
            return None
        if isinstance(given, str):
            path = self.file(given, *here)
            matrix = self.at(here, lambda: _read_matrix(path or Path(given)))
        else:
            matrix = self.at(here, lambda: _matrix(given))
        if matrix.shape != (6, channels) or not np.isfinite(matrix).all():
            raise self.error(
                "the matrix has not the shape of this sensor, or holds no finite numbers",
                *here,
                measured=" x ".join(map(str, matrix.shape)),
                limit=f"6 x {channels}",
            )
        return matrix

    def vector(
        self, given: Sequence[float] | float | None, channels: int, *here: Key
    ) -> Array | None:
        """Return one number per channel; one number stands for all."""
        if given is None:
            return None
        vector = np.array(given, np.float64)
        if vector.ndim and vector.size != channels:
            raise self.error(
                "one number for each channel is needed",
                *here,
                measured=f"{vector.size} numbers",
                limit=f"{channels}",
            )
        return np.broadcast_to(vector, (channels,)).copy()

    def file(self, given: str | None, *here: Key) -> Path | None:
        """Return the path of a file that exists, from the folder of robot.yaml."""
        if given is None:
            return None
        path = self.folder / given
        if not path.is_file():
            raise self.error(
                f"there is no file {given!r}",
                *here,
                next_step="a relative path starts at the folder of this file",
            )
        return path

    def known(self, kind: str, name: str, names: Sequence[str], *here: Key) -> bool:
        """Return True; refuse a name that is none of *names*."""
        if name not in names:
            raise self.error(
                f"there is no {kind} {name!r}", *here, next_step=did_you_mean(name, names)
            )
        return True

    def at(self, here: tuple[Key, ...], make: Callable[[], Result]) -> Result:
        """Return what *make* returns; its refusals name the line."""
        try:
            return make()
        except ComcalError as error:
            if error.where:
                raise
            raise self.error(
                error.what,
                *here,
                measured=error.measured,
                limit=error.limit,
                next_step=error.next_step,
            ) from error

    def where(self, *here: Key) -> str:
        """Return ``file:line`` of a key below ``sources.can``."""
        return self.located.where(*_HERE, *here)

    def error(
        self, what: str, *here: Key, measured: str = "", limit: str = "", next_step: str = ""
    ) -> ConfigError:
        """Return the error *what* at the place of a key."""
        return ConfigError(
            what, where=self.where(*here), measured=measured, limit=limit, next_step=next_step
        )


class _Unlocated(LocatedYaml):
    """Options that stand in no file: their place is their path of keys."""

    def where(self, *path: Key) -> str:
        return ".".join(map(str, path)) or ".".join(map(str, _HERE))


def _located(options: Mapping[str, object], robot: Robot) -> LocatedYaml:
    """Return the options with the lines on which they stand in robot.yaml."""
    data = {"sources": {"can": dict(options)}}
    if robot.yaml_path is not None and robot.yaml_path.is_file():
        file = read_yaml(robot.yaml_path)
        sources = file.data.get("sources")
        if isinstance(sources, dict) and sources.get("can") == data["sources"]["can"]:
            return LocatedYaml(file.path, data, file.lines)
    folder = robot.yaml_path.parent if robot.yaml_path else Path()
    return _Unlocated(folder / "options", data, dict.fromkeys(_paths(data, ()), 1))


def _paths(data: object, here: tuple[Key, ...]) -> list[tuple[Key, ...]]:
    """Return the paths of all keys and items."""
    if isinstance(data, Mapping):
        items: list[tuple[Key, object]] = [(str(k), v) for k, v in data.items()]
    elif isinstance(data, list | tuple):
        items = list(enumerate(data))
    else:
        return []
    return [p for key, value in items for p in ((*here, key), *_paths(value, (*here, key)))]


def _matrix(rows: Sequence[Sequence[float]]) -> Array:
    if len({len(row) for row in rows}) > 1:
        raise ConfigError("the rows of the matrix are not equally long")
    return np.array(rows, np.float64)


def _read_matrix(path: Path) -> Array:
    """Read rows of numbers, separated by blanks or commas; ``#`` begins a remark."""
    try:
        lines = [line.split("#")[0] for line in path.read_text("utf-8").splitlines()]
        rows = [[float(x) for x in line.replace(",", " ").split()] for line in lines]
    except (OSError, ValueError) as error:
        raise ConfigError(
            f"this is no matrix of numbers: {error}",
            where=str(path),
            next_step="write six rows of numbers, separated by blanks or commas",
        ) from error
    return _matrix([row for row in rows if row])


def _timeout(description: Description, section: DeviceSection) -> float:
    """Return how old a sample may be, where robot.yaml does not say.

    What this computer asks for comes as late as its own busy threads let it ask.
    """
    is_asked = description.join.request is not None and section.period is not None
    is_synced = isinstance(section, JointSection) and section.sync_period is not None
    least = description.join.timeout
    return max(least, ASKED) if is_asked or is_synced else least


def _apart(description: Description, period: float | None, timeout: float) -> float:
    """Return how far apart the parts of a sample may be, where robot.yaml does not say.

    Halves of a wrench that only their order tells apart have nothing but the pause between them to
    show that one was lost. A drive's position and current may well come one after the other.
    """
    join = description.join
    has_proof = join.signal is not None or join.request is not None or join.checksum is not None
    if description.kind != "force_torque" or len(description.parts) < 2 or has_proof or not period:
        return timeout
    return min(timeout, 0.5 * period)
