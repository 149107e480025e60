# SPDX-License-Identifier: Apache-2.0
"""Read the layout of a drive's frames from its EDS or DCF file (CiA 306).

The mapping is taken from the parameters 0x1A00 + k themselves, not through ``canopen``'s PDO
classes: those leave out entries of index 0 and of data types that [DummyUsage] does not allow, and
every later value would then be read from the wrong bits.
"""

from __future__ import annotations

import configparser
import io
from pathlib import Path
from typing import Any

from canopen.objectdictionary import ObjectDictionary, datatypes
from canopen.objectdictionary.eds import import_eds

from comcal.errors import ConfigError
from comcal_drivers.canopen_setup.layout import (
    COB_EXTENDED,
    COB_INVALID,
    COB_NO_REMOTE,
    MAX_BITS,
    DriveLayout,
    MappedObject,
    TransmitPdo,
    mapped_object,
)
from comcal_drivers.canopen_setup.objects import ValueType, standard_type

FIRST_COMMUNICATION, FIRST_MAPPING, MAX_PDOS = 0x1800, 0x1A00, 512

DEFAULT_COB_IDS = (0x180, 0x280, 0x380, 0x480)
"""Added to the node: what CiA 301 gives the first four TPDOs of a drive that states nothing."""

EVENT_DRIVEN = 255
LAST_NODE = 127


def read_dictionary(path: Path, node: int) -> ObjectDictionary:
    """Read an EDS or DCF for one node.

    Raises
    ------
    ConfigError
        If the file cannot be read, or is a DCF that was exported for another node.
    """
    if not 1 <= node <= LAST_NODE:
        raise ConfigError(
            "the node of a CANopen drive is out of range",
            where=str(path),
            measured=str(node),
            limit=f"1 to {LAST_NODE}",
            next_step="correct `ids: {node: ...}`",
        )
    text = _read(path)
    try:
        dictionary: Any = import_eds(io.StringIO(text), None)
        made_for = dictionary.node_id
        if made_for != node:
            dictionary = import_eds(io.StringIO(text), node)
    except (configparser.Error, KeyError, ValueError, AttributeError) as error:
        raise ConfigError(
            f"this is not a readable EDS or DCF: {error}",
            where=str(path),
            next_step="export it again with the drive's own tool",
        ) from error
    if made_for not in (None, node) and _has_own_cob_ids(dictionary):
        raise ConfigError(
            f"this DCF was exported for node {made_for}, so its identifiers are those of that node",
            where=str(path),
            measured=f"used for node {node}",
            next_step=f"export it for node {node}, or give the EDS of the drive instead",
        )
    return dictionary


def read_layout(path: Path, node: int) -> DriveLayout:
    """Return the transmit PDOs that an EDS or DCF states for a node.

    Parameters
    ----------
    path : Path
        A DCF states how the drive was configured, an EDS how it leaves the factory.
    node : int
        1 to 127; ``$NODEID`` in the file becomes this.

    Raises
    ------
    ConfigError
        If the file is not readable, belongs to another node or contradicts itself.
    """
    dictionary = read_dictionary(path, node)
    numbers = [k for k in range(MAX_PDOS) if FIRST_COMMUNICATION + k in dictionary]
    pdos = tuple(_pdo(dictionary, k, node, str(path)) for k in numbers)
    if not any(pdo.enabled for pdo in pdos):
        raise ConfigError(
            "the drive would send nothing: no TPDO is enabled",
            where=str(path),
            measured=f"{len(pdos)} TPDOs",
            next_step="enable and map one with the drive's own tool and export a DCF",
        )
    return DriveLayout(node, pdos, str(path))


def entry_from_value(dictionary: ObjectDictionary | None, value: int, where: str) -> MappedObject:
    """Return the entry that a mapping parameter means, with what the file says of its object.

    Raises
    ------
    ConfigError
        If its length contradicts the type of the object.
    """
    index, subindex = value >> 16, (value >> 8) & 0xFF
    return mapped_object(
        value,
        _type(dictionary, index, subindex),
        _title(dictionary, index, subindex),
        where,
    )


def _type(dictionary: ObjectDictionary | None, index: int, sub: int) -> ValueType | None:
    """Return the type of an object by the file, else by CiA 402; None where neither tells."""
    variable = dictionary.get_variable(index, sub) if dictionary is not None else None
    if variable is None:
        return standard_type(index, sub)
    kind = variable.data_type
    if kind == datatypes.BOOLEAN:
        return ValueType(1)
    if kind in datatypes.FLOAT_TYPES:
        return ValueType(len(variable), is_float=True)
    if kind in datatypes.INTEGER_TYPES:
        # canopen says 32 for 24 bits and 64 for 40 to 56: how it stores them, not their length.
        return ValueType(_INTEGER_BITS.get(kind, len(variable)), kind in datatypes.SIGNED_TYPES)
    return None


_INTEGER_BITS = {0x10: 24, 0x12: 40, 0x13: 48, 0x14: 56, 0x16: 24, 0x18: 40, 0x19: 48, 0x1A: 56}


def _title(dictionary: ObjectDictionary | None, index: int, sub: int) -> str:
    """Return the name of an object in the file; empty where it has none."""
    variable = dictionary.get_variable(index, sub) if dictionary is not None else None
    return "" if variable is None else str(variable.name)


def pdo_from_parameters(
    k: int, cob_id: int, transmission: int, entries: tuple[MappedObject, ...], where: str
) -> TransmitPdo:
    """Put one PDO together, from a file or from the drive.

    Parameters
    ----------
    k : int
        0 for 0x1800.
    cob_id : int
        With the flags of bits 29 to 31.

    Raises
    ------
    ConfigError
        If an enabled PDO is longer than a frame.
    """
    extended = bool(cob_id & COB_EXTENDED)
    pdo = TransmitPdo(
        number=k + 1,
        cob_id=cob_id & (0x1FFFFFFF if extended else 0x7FF),
        enabled=not cob_id & COB_INVALID and bool(entries),
        transmission=transmission,
        entries=entries,
        extended=extended,
        remote_allowed=not cob_id & COB_NO_REMOTE,
    )
    if pdo.enabled and pdo.bits > MAX_BITS:
        raise ConfigError(
            f"{pdo.name} maps more than fits into a frame",
            where=where,
            measured=f"{pdo.bits} bits: {pdo.mapping_text()}",
            limit=f"{MAX_BITS} bits",
            next_step="export the file again with the drive's own tool",
        )
    return pdo


def _read(path: Path) -> str:
    """Read the text; tools on Windows write names in Latin-1."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise ConfigError(
            f"the EDS or DCF cannot be read: {error.strerror or error}",
            where=str(path),
            next_step="correct `eds:` or `dcf:`; paths are relative to robot.yaml",
        ) from error
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def _has_own_cob_ids(dictionary: Any) -> bool:
    """Whether identifiers stand in the file as numbers set for one node."""
    records = [
        dictionary[FIRST_COMMUNICATION + k]
        for k in range(MAX_PDOS)
        if FIRST_COMMUNICATION + k in dictionary
    ]
    return any(1 in record and record[1].value is not None for record in records)


def _value(dictionary: Any, index: int, sub: int) -> int | None:
    """Return what the drive was configured to (DCF), else its default; None without either."""
    item = dictionary[index]
    # Membership first: an array of canopen makes up what it does not hold, from its first entry.
    if sub not in item:
        return None
    variable = item[sub]
    value = variable.value if variable.value is not None else variable.default
    return int(value) if value is not None else None


def _pdo(dictionary: Any, k: int, node: int, path: str) -> TransmitPdo:
    where = f"{path}, object 0x{FIRST_MAPPING + k:04X}"
    cob_id = _value(dictionary, FIRST_COMMUNICATION + k, 1)
    if cob_id is None:
        cob_id = DEFAULT_COB_IDS[k] + node if k < len(DEFAULT_COB_IDS) else COB_INVALID
    transmission = _value(dictionary, FIRST_COMMUNICATION + k, 2)
    count = _value(dictionary, FIRST_MAPPING + k, 0) if FIRST_MAPPING + k in dictionary else 0
    # 0xFE and 0xFF announce a multiplexed PDO, which has no mapping.
    used = count if count is not None and count <= MAX_BITS else 0
    return pdo_from_parameters(
        k,
        cob_id,
        EVENT_DRIVEN if transmission is None else transmission,
        tuple(
            entry_from_value(dictionary, value, where)
            for sub in range(1, used + 1)
            if (value := _mapping(dictionary, k, sub, where))
        ),
        where,
    )


def _mapping(dictionary: Any, k: int, sub: int, where: str) -> int:
    """Return one entry of a mapping; 0 where drives with a fixed number leave it unused."""
    value = _value(dictionary, FIRST_MAPPING + k, sub)
    if value is None:
        raise ConfigError(
            f"entry {sub} of the mapping has no value",
            where=where,
            next_step="give the DCF of the configured drive instead of its EDS",
        )
    return value
