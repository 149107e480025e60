# SPDX-License-Identifier: Apache-2.0
"""Identifiers that two devices of one bus would both send with."""

from __future__ import annotations

from collections.abc import Sequence

from comcal.errors import ConfigError
from comcal_drivers.decode.dbc import read_dbc
from comcal_drivers.devices.description import Device


def check_identifiers(devices: Sequence[tuple[str, Device]], where: str) -> None:
    """Refuse devices of one bus that cannot be told apart.

    Parameters
    ----------
    devices : sequence of (name, Device)
    where : str
        For the message.

    Raises
    ------
    ConfigError
        If two devices send their samples with one identifier.
    """
    senders: dict[tuple[int, int], str] = {}
    for name, device in devices:
        for number in _part_ids(device):
            key = (number, _selected(device))
            other = senders.setdefault(key, name)
            if other != name:
                raise ConfigError(
                    f"{other} and {name} both send with the identifier {number:#x}",
                    where=where,
                    next_step="give one of them other `ids`, on the device and here",
                )


def _part_ids(device: Device) -> list[int]:
    """Return the identifiers of the parts on the bus."""
    database = read_dbc(device.dbc)
    parts = [m for m in database.messages if m.name in device.description.parts]
    return [device.relocate(m.frame_id) | m.is_extended_frame << 31 for m in parts]


def _selected(device: Device) -> int:
    """Return the number by which devices with one identifier are told apart; -1 without."""
    select = device.description.select
    return -1 if select is None else device.ids[select.key]
