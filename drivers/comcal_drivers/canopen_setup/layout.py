# SPDX-License-Identifier: Apache-2.0
"""What a drive puts into which frame: its transmit PDOs."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import combinations

from comcal.errors import ConfigError
from comcal_drivers.canopen_setup.objects import ValueType, object_text, signal_name

MAX_BITS = 64
"""A PDO is one frame of classic CAN."""

LAST_DUMMY = 0x0007
"""Indices 1 to 7 are data types: a mapping entry with one of them only fills bits."""

COB_INVALID = 1 << 31
COB_NO_REMOTE = 1 << 30
COB_EXTENDED = 1 << 29
LAST_SYNCHRONOUS = 240
"""Transmission types 1 to 240: on every n-th SYNC."""


@dataclass(frozen=True)
class MappedObject:
    """One entry of a PDO mapping.

    Parameters
    ----------
    index, subindex : int
        The object; index 0 to 7 only fills bits.
    bits : int
        Length in the frame.
    type : ValueType or None
        How to read it; None where nobody describes the object (its bits are skipped).
    title : str
        Its name in the EDS.
    """

    index: int
    subindex: int
    bits: int
    type: ValueType | None = None
    title: str = ""

    @property
    def signal(self) -> str:
        """Name of its signal."""
        return signal_name(self.index, self.subindex)

    def __str__(self) -> str:
        return f"{object_text(self.index, self.subindex)}/{self.bits}"


@dataclass(frozen=True)
class TransmitPdo:
    """One transmit PDO: communication parameter 0x1800 + k and mapping 0x1A00 + k.

    Parameters
    ----------
    number : int
        Counted from 1.
    cob_id : int
        Identifier of the frame, without flag bits.
    enabled, extended, remote_allowed : bool
    transmission : int
        1 to 240: on every n-th SYNC; 0: on SYNC after a change; 254, 255: by event or timer.
    entries : tuple of MappedObject
        In the order of their bits, from bit 0 on.
    """

    number: int
    cob_id: int
    enabled: bool
    transmission: int
    entries: tuple[MappedObject, ...]
    extended: bool = False
    remote_allowed: bool = True

    @property
    def name(self) -> str:
        """Name of its message: ``TPDO1``."""
        return f"TPDO{self.number}"

    @property
    def bits(self) -> int:
        """Length of all entries together."""
        return sum(entry.bits for entry in self.entries)

    @property
    def is_synchronous(self) -> bool:
        """Whether it comes after every n-th SYNC, whatever its values are."""
        return 1 <= self.transmission <= LAST_SYNCHRONOUS

    def mapping_text(self) -> str:
        """Return the entries as error messages write them."""
        return ", ".join(map(str, self.entries)) or "nothing"


@dataclass(frozen=True)
class DriveLayout:
    """All transmit PDOs of one node, as a file or the drive itself states them.

    Parameters
    ----------
    node : int
        1 to 127.
    pdos : tuple of TransmitPdo
        In the order of their numbers, disabled ones included.
    origin : str
        Where this was read: the path of the file, or the bus.
    """

    node: int
    pdos: tuple[TransmitPdo, ...]
    origin: str

    @property
    def enabled(self) -> tuple[TransmitPdo, ...]:
        """The PDOs that the drive sends."""
        return tuple(pdo for pdo in self.pdos if pdo.enabled)

    def sample(self, wanted: Iterable[int]) -> tuple[TransmitPdo, ...]:
        """Return the fewest enabled PDOs that carry all objects *wanted*, in order of number.

        Parameters
        ----------
        wanted : iterable of int
            Indices of objects, such as 0x6064 and 0x6078.

        Raises
        ------
        ConfigError
            If an object is in no enabled PDO, or the PDOs needed do not come on the same SYNC:
            nothing would then prove which frames belong to one sample.
        """
        needed = frozenset(wanted)
        chosen = _fewest(self.enabled, needed)
        if chosen is None:
            carried = {e.index for pdo in self.enabled for e in pdo.entries if e.type is not None}
            missing = ", ".join(f"0x{i:04X}" for i in sorted(needed - carried))
            raise ConfigError(
                f"no enabled TPDO of node {self.node} carries {missing}",
                where=self.origin,
                measured="; ".join(f"{p.name}: {p.mapping_text()}" for p in self.enabled)
                or "no TPDO is enabled",
                next_step="map it into a TPDO with the drive's own tool and export the file again",
            )
        kinds = {pdo.transmission for pdo in chosen}
        if len(chosen) > 1 and (len(kinds) > 1 or not chosen[0].is_synchronous):
            raise ConfigError(
                "the values of one sample come in TPDOs that nothing holds together",
                where=f"{self.origin}, node {self.node}",
                measured=", ".join(f"{p.name}: transmission type {p.transmission}" for p in chosen),
                limit="one type from 1 to 240 for all of them",
                next_step="map all values into one TPDO, or give these TPDOs transmission type 1",
            )
        return chosen


def _fewest(
    pdos: tuple[TransmitPdo, ...], needed: frozenset[int]
) -> tuple[TransmitPdo, ...] | None:
    """Choose the fewest that cover *needed*, of one transmission type where possible.

    A drive has at most a handful of enabled PDOs that matter, so trying all choices is cheap.
    """
    carried = {
        pdo.number: needed & {e.index for e in pdo.entries if e.type is not None} for pdo in pdos
    }
    useful = [pdo for pdo in pdos if carried[pdo.number]]
    for count in range(1, len(needed) + 1):
        covering = [
            choice
            for choice in combinations(useful, count)
            if frozenset[int]().union(*(carried[p.number] for p in choice)) == needed
        ]
        if covering:
            return min(covering, key=_preference)
    return None


def _preference(choice: tuple[TransmitPdo, ...]) -> tuple[bool, bool, tuple[int, ...]]:
    """Sort synchronous PDOs of one type first, then by number."""
    kinds = {pdo.transmission for pdo in choice}
    synchronous = all(pdo.is_synchronous for pdo in choice)
    return len(kinds) > 1, not synchronous, tuple(pdo.number for pdo in choice)


def mapped_object(value: int, type_: ValueType | None, title: str, where: str) -> MappedObject:
    """Return the entry that a mapping parameter (index << 16 | subindex << 8 | bits) means.

    Raises
    ------
    ConfigError
        If its length contradicts the type of the object.
    """
    index, subindex, bits = value >> 16, (value >> 8) & 0xFF, value & 0xFF
    entry = MappedObject(index, subindex, bits, None if index <= LAST_DUMMY else type_, title)
    wrong = entry.type is not None and (
        bits > entry.type.bits or (entry.type.is_float and bits != entry.type.bits)
    )
    if bits == 0 or bits > MAX_BITS or wrong:
        known = f"{entry.type.bits} bits" if entry.type is not None else f"1 to {MAX_BITS} bits"
        raise ConfigError(
            f"the mapping entry {entry} has an impossible length",
            where=where,
            measured=f"{bits} bits",
            limit=known,
            next_step="export the file again with the drive's own tool",
        )
    return entry
