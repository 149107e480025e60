# SPDX-License-Identifier: Apache-2.0
"""Question all drives of a bus before its stream is read."""

from __future__ import annotations

from collections.abc import Sequence

import can

from comcal.errors import HardwareError
from comcal_drivers.canopen_setup.conflicts import is_canopen, node_of
from comcal_drivers.canopen_setup.facts import (
    DriveFacts,
    check_layout,
    read_facts,
    require_rated,
)
from comcal_drivers.canopen_setup.fit import layout_of
from comcal_drivers.canopen_setup.layout import DriveLayout, TransmitPdo
from comcal_drivers.canopen_setup.objects import index_of_signal, object_text
from comcal_drivers.canopen_setup.sdo import TIMEOUT, Drive, open_network
from comcal_drivers.decode.dbc import read_dbc
from comcal_drivers.devices.configuration import JointConfig
from comcal_drivers.devices.description import Description, Device

FIRST_TPDOS = (1, 2, 3, 4)


def set_up_drives(
    bus: can.BusABC, joints: Sequence[JointConfig], timeout: float = TIMEOUT
) -> dict[str, DriveFacts]:
    """Ask every CANopen drive who it is, and require that it sends what will be decoded.

    Parameters
    ----------
    bus : can.BusABC
        Nothing else may read it meanwhile.
    joints : sequence of JointConfig
        Those of this bus, as robot.yaml has them; drives without CANopen are passed over.
    timeout : float
        For one answer [s].

    Returns
    -------
    dict from joint to DriveFacts
        To be stored with the recording.

    Raises
    ------
    HardwareError
        If a drive does not answer, fills its frames in another way than its EDS, DCF or device
        file says, or lacks the rated value that its readings are per mille of.
    ConfigError
        If an EDS or DCF cannot be used.
    """
    drives = [joint for joint in joints if is_canopen(joint.device)]
    facts: dict[str, DriveFacts] = {}
    with open_network(bus, [node_of(joint.device) for joint in drives]) as network:
        for joint in drives:
            drive = Drive(network, node_of(joint.device), joint.name, timeout)
            facts[joint.name] = _set_up(drive, joint)
    return facts


def nmt_start(node: int) -> can.Message:
    """Return the frame that makes a node OPERATIONAL (CiA 301, NMT): from then on it sends PDOs."""
    return can.Message(arbitration_id=0x000, data=bytes([0x01, node]), is_extended_id=False)


def rated_values(facts: DriveFacts) -> dict[str, float]:
    """Return the rated values that the drive told, as device values of its calibration."""
    told = {"rated_current": facts.rated_current, "rated_torque": facts.rated_torque}
    return {name: value for name, value in told.items() if value}


def check_device(device: Device, reported: DriveLayout, drive: Drive) -> None:
    """Require that a drive sends each value at the place where the device file has it.

    Raises
    ------
    HardwareError
        Naming both places.
    """
    description = device.description
    by_id = {pdo.cob_id: pdo for pdo in reported.enabled}
    for message in read_dbc(device.dbc).messages:
        if message.name not in description.parts:
            continue
        identifier = device.relocate(message.frame_id)
        pdo = by_id.get(identifier)
        has = f"{pdo.mapping_text()} in it" if pdo is not None else "no such TPDO"
        places = {} if pdo is None else _places(pdo)
        for signal in message.signals:
            found = index_of_signal(signal.name)
            if found is None or places.get(found) == (signal.start, signal.length):
                continue
            raise HardwareError(
                f"the device file {description.name} has {object_text(*found)} at bit "
                f"{signal.start} of frame 0x{identifier:X}, {signal.length} bits; the drive has "
                f"{has}",
                where=str(drive),
                next_step="map it so with the drive's own tool, or name the EDS or DCF of the "
                "drive as it is in robot.yaml",
            )


def _set_up(drive: Drive, joint: JointConfig) -> DriveFacts:
    expected = layout_of(joint)
    numbers = {pdo.number for pdo in expected.pdos} if expected is not None else set[int]()
    facts = read_facts(drive, tuple(sorted({*FIRST_TPDOS, *numbers})))
    if expected is not None:
        check_layout(expected, facts.layout, drive)
    else:
        check_device(joint.device, facts.layout, drive)
    for name in _rated(joint.device.description):
        if getattr(joint, name) is None:
            require_rated(facts, name)
    return facts


def _rated(description: Description) -> list[str]:
    """Return of which rated values the readings of a drive are per mille."""
    drive = description.calibrate.drive
    quantities = [] if drive is None else [drive.position, drive.current, drive.torque]
    return [q.per_mille_of for q in quantities if q is not None and q.per_mille_of is not None]


def _places(pdo: TransmitPdo) -> dict[tuple[int, int], tuple[int, int]]:
    """Return object -> (first bit, bits)."""
    places: dict[tuple[int, int], tuple[int, int]] = {}
    start = 0
    for entry in pdo.entries:
        places.setdefault((entry.index, entry.subindex), (start, entry.bits))
        start += entry.bits
    return places
