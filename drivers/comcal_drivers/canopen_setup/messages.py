# SPDX-License-Identifier: Apache-2.0
"""Turn the PDOs of a drive into the messages that every other device is described with.

The stream of a drive then takes the same path as that of a sensor: the decode table, live and from
logs. Values stay raw; units are the business of the device description.
"""

from __future__ import annotations

from cantools.database.can import Database, Message, Signal
from cantools.database.conversion import BaseConversion

from comcal.errors import ConfigError
from comcal_drivers.canopen_setup.layout import DriveLayout, TransmitPdo


def message_from_pdo(pdo: TransmitPdo, node: int) -> Message:
    """Return the message of one PDO.

    Fillers and objects that nobody describes keep their bits and get no signal. An object that is
    mapped twice gets the number of its repetition: ``position``, ``position_2``.

    Raises
    ------
    ConfigError
        If nothing in the PDO can be read.
    """
    signals: list[Signal] = []
    start, seen = 0, dict[str, int]()
    for entry in pdo.entries:
        if entry.type is not None:
            seen[entry.signal] = seen.get(entry.signal, 0) + 1
            repeated = f"_{seen[entry.signal]}" if seen[entry.signal] > 1 else ""
            signals.append(
                Signal(
                    entry.signal + repeated,
                    start,
                    entry.bits,
                    byte_order="little_endian",
                    is_signed=entry.type.signed,
                    conversion=BaseConversion.factory(is_float=entry.type.is_float),
                    comment=_comment(str(entry), entry.title),
                )
            )
        start += entry.bits
    if not signals:
        raise ConfigError(
            f"nothing in {pdo.name} of node {node} can be read",
            measured=pdo.mapping_text(),
            next_step="give an EDS that describes these objects",
        )
    return Message(
        frame_id=pdo.cob_id,
        name=pdo.name,
        length=-(-start // 8),
        signals=signals,
        is_extended_frame=pdo.extended,
        comment=f"node {node}, transmission type {pdo.transmission}",
    )


def database_from_layout(layout: DriveLayout) -> Database:
    """Return all enabled PDOs of a drive that carry a value, as a database for a decode table.

    Identifiers are those of the node already.

    Raises
    ------
    ConfigError
        If no PDO carries a value, or two have the same identifier.
    """
    pdos = [p for p in layout.enabled if any(e.type is not None for e in p.entries)]
    owners: dict[int, TransmitPdo] = {}
    for pdo in pdos:
        if pdo.cob_id in owners:
            raise ConfigError(
                f"{owners[pdo.cob_id].name} and {pdo.name} of node {layout.node} have the same "
                "identifier",
                where=layout.origin,
                measured=f"0x{pdo.cob_id:X}",
                next_step="give every TPDO its own with the drive's own tool",
            )
        owners[pdo.cob_id] = pdo
    if not pdos:
        raise ConfigError(
            "no enabled TPDO carries a value that the file describes",
            where=layout.origin,
            measured="; ".join(f"{p.name}: {p.mapping_text()}" for p in layout.enabled),
            next_step="map position and current with the drive's own tool",
        )
    return Database(messages=[message_from_pdo(p, layout.node) for p in pdos])


def dbc_text(layout: DriveLayout, offset: int = 0) -> str:
    """Return the layout as the text of a DBC file, to be kept with a recording.

    Parameters
    ----------
    layout : DriveLayout
    offset : int
        Taken from every identifier: what a device description adds again for its node.
    """
    database = database_from_layout(layout)
    for message in database.messages:
        message.frame_id -= offset
    return database.as_dbc_string()


def _comment(mapping: str, title: str) -> str:
    return f"{mapping}: {title}" if title else mapping
