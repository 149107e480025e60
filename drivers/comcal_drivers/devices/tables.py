# SPDX-License-Identifier: Apache-2.0
"""The messages of a device, compiled for decoding."""

from __future__ import annotations

from comcal_drivers.decode.dbc import read_dbc
from comcal_drivers.decode.table import DecodeTable, table_from_dbc, table_from_messages
from comcal_drivers.devices.description import Device


def bus_table(device: Device) -> DecodeTable:
    """Return the messages that the device sends, by identifier on the bus.

    A message that only exists after frames were concatenated is not among them.

    Raises
    ------
    ConfigError
        If the DBC is missing or wrong, or an identifier does not exist on a bus.
    """
    whole = device.description.join.message
    messages = [m for m in read_dbc(device.dbc).messages if m.name != whole]
    return table_from_messages(messages, device.relocate)


def whole_table(device: Device) -> DecodeTable:
    """Return the one message that concatenated frames make, by its identifier in the DBC.

    Raises
    ------
    ConfigError
        If the DBC is missing or wrong.
    """
    table = table_from_dbc(read_dbc(device.dbc))
    number = table.id_of(device.description.join.message or "")
    return DecodeTable({number: table.messages[number]})
