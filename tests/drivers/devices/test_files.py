# SPDX-License-Identifier: Apache-2.0
"""Every device file that is shipped: complete, consistent, and with its sources named."""

from __future__ import annotations

import pytest
from cantools.database.can import Database

from comcal_drivers.decode.dbc import read_dbc
from comcal_drivers.devices.commands import command_frames
from comcal_drivers.devices.description import Device, device_names, load_device
from comcal_drivers.devices.tables import bus_table

FORCE_TORQUE = {
    "ati_netcanoem", "ati_netbox_short", "ati_netbox_long", "iit_strain", "jr3_uc3m",
    "sunrise_m8123", "robotous_rft", "optoforce",
}  # fmt: skip


def database(device: Device) -> Database:
    return read_dbc(device.dbc)


def test_the_promised_sensors_are_there() -> None:
    sensors = {n for n in device_names() if load_device(n).description.kind == "force_torque"}
    assert sensors >= FORCE_TORQUE


@pytest.mark.parametrize("name", device_names())
def test_names_in_the_yaml_are_in_the_dbc(name: str) -> None:
    device = load_device(name)
    description = device.description
    assert description.name == name
    db = database(device)
    join = description.join
    read = [join.message] if join.message else list(description.parts)
    signals = [s.name for m in read for s in db.get_message_by_name(m).signals]
    wanted = [*description.values, *([join.signal] if join.signal else [])]
    if description.status and description.status.signal:
        wanted.append(description.status.signal)
    assert set(wanted) <= set(signals)
    assert set(description.parts) <= {m.name for m in db.messages}
    repeated = {s for s in signals if signals.count(s) > 1}
    assert repeated <= {join.signal}, "a signal that two parts have is ambiguous"
    if description.temperature:
        message = db.get_message_by_name(description.temperature.message)
        assert description.temperature.signal in {s.name for s in message.signals}
    for command in description.commands.values():
        told = set[str]()
        for step in command.steps:
            for reply in step.replies:
                names = {s.name for s in db.get_message_by_name(reply.message).signals}
                assert set(reply.match) <= names
                told |= names
        for gives in command.gives.values():
            assert set(gives.signals) <= told


@pytest.mark.parametrize("name", device_names())
def test_identifiers_exist_on_a_bus_at_the_defaults_and_at_the_largest_ids(name: str) -> None:
    device = load_device(name)
    largest = load_device(name, {k: v.maximum for k, v in device.description.ids.items()})
    for one in (device, largest):
        assert bus_table(one).messages
        for command in one.description.commands:
            for frame in command_frames(one, command):
                assert 0 <= frame.id <= (0x7FF if frame.id < 0x800 else 0x9FFFFFFF)
                assert len(frame.data) <= 8


@pytest.mark.parametrize("name", device_names())
def test_every_file_names_where_its_facts_come_from(name: str) -> None:
    description = load_device(name).description
    assert all(len(source) > 20 for source in description.source)
    assert description.title
