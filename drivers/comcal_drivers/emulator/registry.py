# SPDX-License-Identifier: Apache-2.0
"""Which class emulates which device of robot.yaml."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from comcal.robot.model import Robot
from comcal_drivers.devices.configuration import (
    CanConfig,
    DeviceConfig,
    ImuConfig,
    JointConfig,
    SensorConfig,
)
from comcal_drivers.emulator.device import EmulatedDevice
from comcal_drivers.emulator.meters import DriveMeter, Hardware, ImuMeter, WrenchMeter
from comcal_drivers.emulator.models import ati_netbox, ati_netcanoem, iit_strain, jr3_uc3m
from comcal_drivers.emulator.models.canopen_drive import CanopenDrive
from comcal_drivers.emulator.models.drives import MitMotor, Odrive, Vesc
from comcal_drivers.emulator.models.optoforce import Optoforce
from comcal_drivers.emulator.models.robotous_rft import RobotousRft
from comcal_drivers.emulator.models.sunrise_m8123 import SunriseM8123

SENSORS: Mapping[str, tuple[type[EmulatedDevice], Callable[[], Hardware]]] = {
    "ati_netcanoem": (ati_netcanoem.AtiNetcanoem, ati_netcanoem.default_hardware),
    "ati_netbox_long": (ati_netbox.AtiNetbox, ati_netbox.default_hardware),
    "ati_netbox_short": (ati_netbox.AtiNetbox, ati_netbox.default_hardware),
    "iit_strain": (iit_strain.IitStrain, iit_strain.default_hardware),
    "jr3_uc3m": (jr3_uc3m.Jr3Uc3m, jr3_uc3m.default_hardware),
    "sunrise_m8123": (SunriseM8123, Hardware),
    "robotous_rft": (RobotousRft, Hardware),
    "optoforce": (Optoforce, Hardware),
}
"""Force/torque sensors by the name of their description, and what stands in their memory."""

DRIVES: Mapping[str, type[EmulatedDevice]] = {
    "odrive_cansimple": Odrive,
    "vesc_status": Vesc,
    "mit_ak": MitMotor,
}
"""Drives that are no CANopen nodes."""

CANOPEN_PARTS = "TPDO"
"""How the messages of CANopen drives are named."""


def emulate(config: DeviceConfig, robot: Robot, *, started: bool) -> EmulatedDevice:
    """Return a device as robot.yaml describes it.

    A device of its own file, without a class of its own, streams and obeys nothing.

    Parameters
    ----------
    config : DeviceConfig
    robot : Robot
        For the column of a joint and the constant of its motor.
    started : bool
        See :class:`~comcal_drivers.emulator.device.EmulatedDevice`.
    """
    description = config.device.description
    if isinstance(config, SensorConfig):
        made, hardware = SENSORS.get(description.name, (EmulatedDevice, Hardware))
        memory = hardware()
        channels = len(description.values)
        if memory.full_scale is None and config.full_scale is None:
            memory = Hardware(
                memory.matrix,
                np.ones(channels),
                memory.counts_per_force,
                memory.counts_per_torque,
            )
        return made(config, WrenchMeter(config, memory), started=started)
    if isinstance(config, ImuConfig):
        return EmulatedDevice(config, ImuMeter(config), started=started)
    meter = _drive_meter(config, robot)
    if all(part.startswith(CANOPEN_PARTS) for part in description.parts):
        return CanopenDrive(config, meter, started=started)
    return DRIVES.get(description.name, EmulatedDevice)(config, meter, started=started)


def emulate_all(
    config: CanConfig, robot: Robot, *, started: bool
) -> dict[str, list[EmulatedDevice]]:
    """Return all devices by bus, in the order in which they send: the clock device last.

    Its sample closes a moment: a reader that makes rows of them finds everything else there.
    """
    imu = () if config.imu is None else (config.imu,)
    every: list[DeviceConfig] = [*config.sensors.values(), *config.joints.values(), *imu]
    buses = dict[str, list[EmulatedDevice]]()
    for bus in config.buses:
        devices = [emulate(each, robot, started=started) for each in every if each.bus == bus]
        buses[bus] = sorted(devices, key=lambda device: device.name == config.clock)
    return buses


def _drive_meter(config: JointConfig, robot: Robot) -> DriveMeter:
    column = robot.tree.joint_names.index(config.name)
    motor = robot.motors.get(config.name)
    per_current = 1.0 if motor is None else motor.torque_constant * motor.gear * motor.sign
    return DriveMeter(config, column, torque_per_current=per_current)
