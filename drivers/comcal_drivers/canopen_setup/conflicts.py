# SPDX-License-Identifier: Apache-2.0
"""Which identifiers a bus with CANopen drives cannot share.

A sensor that takes 0x80 for a command (the M8123 board of Sunrise does) would be started and
stopped by every SYNC, and its start command would make all drives sample. An ATI NETCANOEM board
with its default base sends on 0x201, which the drive of node 1 takes for its control word.
"""

from __future__ import annotations

from collections.abc import Iterator

from comcal.errors import ConfigError
from comcal_drivers.decode.dbc import read_dbc
from comcal_drivers.devices.configuration import CanConfig, DeviceConfig
from comcal_drivers.devices.description import Device

NMT, SYNC = 0x000, 0x080
_SERVICES = {
    0x080: "EMCY",
    0x200: "RPDO 1",
    0x300: "RPDO 2",
    0x400: "RPDO 3",
    0x500: "RPDO 4",
    0x580: "SDO answer",
    0x600: "SDO request",
    0x700: "heartbeat",
}
"""Added to the node. A drive takes RPDO as its control word and target: readings of a sensor with
such an identifier would move it."""


def is_canopen(device: Device) -> bool:
    """Whether a device is a CANopen node: its description reserves the identifier of SYNC."""
    return SYNC in device.description.reserves


def node_of(device: Device) -> int:
    """Return the node number of a CANopen device."""
    return device.ids["node"]


def sync_conflict(config: CanConfig) -> ConfigError | None:
    """Find a device that uses an identifier which CANopen uses on the same bus.

    Parameters
    ----------
    config : CanConfig

    Returns
    -------
    ConfigError or None
        The first conflict: NMT, SYNC, and EMCY, RPDO, SDO and heartbeat of the nodes configured.
        None where there is none.
    """
    for bus in config.buses:
        devices = _devices(config, bus)
        nodes = [each for each in devices if is_canopen(each.device)]
        if not nodes:
            continue
        reserved = _reserved(nodes)
        for each in devices:
            if is_canopen(each.device):
                continue
            for identifier, use in _identifiers(each.device):
                if identifier in reserved:
                    service, owner = reserved[identifier]
                    return ConfigError(
                        f"{each.name} ({each.device.description.name}) uses an identifier that "
                        f"means {service} to {owner}",
                        where=f"bus {bus}",
                        measured=f"0x{identifier:03X}: {use}",
                        next_step="put the sensor and the CANopen drives on two buses, or change "
                        "the sensor's identifier if it can",
                    )
    return None


def _devices(config: CanConfig, bus: str) -> list[DeviceConfig]:
    imu = [] if config.imu is None else [config.imu]
    every: list[DeviceConfig] = [*config.sensors.values(), *config.joints.values(), *imu]
    return [each for each in every if each.bus == bus]


def _reserved(nodes: list[DeviceConfig]) -> dict[int, tuple[str, str]]:
    """Return identifier -> (service, whose)."""
    every = "every CANopen node, " + ", ".join(each.name for each in nodes)
    reserved = {NMT: ("NMT", every), SYNC: ("SYNC", every)}
    for each in nodes:
        node = node_of(each.device)
        for base, service in _SERVICES.items():
            reserved[base + node] = (service, f"{each.name} (node {node})")
    return reserved


def _identifiers(device: Device) -> Iterator[tuple[int, str]]:
    """Yield the 11-bit identifiers of a device, with what it uses them for."""
    description = device.description
    for name, command in description.commands.items():
        for step in command.steps:
            yield device.step_id(step), f"command {name!r}"
    if description.join.request is not None:
        yield device.relocate(description.join.request.id), "poll"
    for message in read_dbc(device.dbc).messages:
        if not message.is_extended_frame:
            yield device.relocate(message.frame_id), f"message {message.name}"
