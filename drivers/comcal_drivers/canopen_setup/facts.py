# SPDX-License-Identifier: Apache-2.0
"""What a drive says about itself: identity, rated values, and how it fills its frames.

All of it is kept with the recording, so that its frames can be decoded again years later.
"""

from __future__ import annotations

from dataclasses import dataclass

from comcal.errors import HardwareError
from comcal_drivers.canopen_setup import objects
from comcal_drivers.canopen_setup.eds import (
    EVENT_DRIVEN,
    FIRST_COMMUNICATION,
    FIRST_MAPPING,
    entry_from_value,
    pdo_from_parameters,
)
from comcal_drivers.canopen_setup.layout import (
    MAX_BITS,
    DriveLayout,
    MappedObject,
    TransmitPdo,
)
from comcal_drivers.canopen_setup.sdo import Drive, MissingObjectError

MILLI = 1e-3


@dataclass(frozen=True)
class Identity:
    """Object 0x1018; None where the drive does not say."""

    vendor: int
    product: int | None = None
    revision: int | None = None
    serial: int | None = None


@dataclass(frozen=True)
class DriveFacts:
    """What one drive answered at the start of a recording.

    Parameters
    ----------
    joint : str
    node : int
    identity : Identity
    title : str
        Object 0x1008; empty where there is none.
    rated_current : float or None
        0x6075 [A]; None where the drive does not have it.
    rated_torque : float or None
        0x6076 [N m]; None where the drive does not have it.
    layout : DriveLayout
        The transmit PDOs as the drive reports them.
    """

    joint: str
    node: int
    identity: Identity
    title: str
    rated_current: float | None
    rated_torque: float | None
    layout: DriveLayout

    def as_mapping(self) -> dict[str, object]:
        """Return the facts as plain numbers and text, to be written beside the frames."""
        identity = self.identity
        return {
            "node": self.node,
            "title": self.title,
            "vendor": identity.vendor,
            "product": identity.product,
            "revision": identity.revision,
            "serial": identity.serial,
            "rated_current": self.rated_current,
            "rated_torque": self.rated_torque,
            "tpdos": [
                {
                    "number": pdo.number,
                    "id": pdo.cob_id,
                    "transmission": pdo.transmission,
                    "mapping": [(e.index << 16) | (e.subindex << 8) | e.bits for e in pdo.entries],
                }
                for pdo in self.layout.enabled
            ],
        }


def read_facts(drive: Drive, numbers: tuple[int, ...] = (1, 2, 3, 4)) -> DriveFacts:
    """Ask a drive for all of it.

    Parameters
    ----------
    drive : Drive
    numbers : tuple of int
        TPDOs to read, counted from 1.

    Raises
    ------
    HardwareError
        If the drive does not answer in time.
    """
    optional = drive.read_optional
    vendor = drive.read(objects.IDENTITY, 1)
    identity = Identity(vendor, *(optional(objects.IDENTITY, sub) for sub in (2, 3, 4)))
    current = optional(objects.RATED_CURRENT)
    torque = optional(objects.RATED_TORQUE)
    try:
        title = drive.read_bytes(objects.DEVICE_NAME).split(b"\0")[0].decode("latin-1")
    except MissingObjectError:
        title = ""
    return DriveFacts(
        joint=drive.name,
        node=drive.node,
        identity=identity,
        title=title,
        rated_current=None if current is None else current * MILLI,
        rated_torque=None if torque is None else torque * MILLI,
        layout=read_drive_layout(drive, numbers),
    )


def read_drive_layout(drive: Drive, numbers: tuple[int, ...]) -> DriveLayout:
    """Return the transmit PDOs as the drive itself reports them; those that it lacks are left out.

    Types of objects outside CiA 402 are unknown here: the drive tells lengths, not meanings.

    Raises
    ------
    HardwareError
        If the drive does not answer in time.
    """
    found = [_read_pdo(drive, number - 1) for number in numbers]
    return DriveLayout(drive.node, tuple(pdo for pdo in found if pdo is not None), str(drive))


def check_layout(expected: DriveLayout, reported: DriveLayout, drive: Drive) -> None:
    """Require that the drive fills the frames that are decoded as its file says.

    Parameters
    ----------
    expected : DriveLayout
        Of the EDS or DCF; only its enabled PDOs count.
    reported : DriveLayout
        Of :func:`read_drive_layout`.

    Raises
    ------
    HardwareError
        Naming both: every value decoded would otherwise be another one.
    """
    actual = {pdo.number: pdo for pdo in reported.pdos}
    for pdo in expected.enabled:
        says = _text(pdo)
        does = _text(actual.get(pdo.number))
        if says != does:
            raise HardwareError(
                f"{pdo.name} is not what its file says: the drive has {does}, "
                f"{expected.origin} has {says}",
                where=str(drive),
                next_step="load the file into the drive with its own tool, or export the drive's "
                "configuration as a DCF and name that in robot.yaml",
            )


def require_rated(facts: DriveFacts, per_mille_of: str) -> float:
    """Return the rated current [A] or torque [N m] that values are given in.

    Raises
    ------
    HardwareError
        If the drive does not have it, or it is zero.
    """
    value = {"rated_current": facts.rated_current, "rated_torque": facts.rated_torque}[per_mille_of]
    index = {"rated_current": objects.RATED_CURRENT, "rated_torque": objects.RATED_TORQUE}
    if not value:
        raise HardwareError(
            f"the drive does not tell its {per_mille_of.replace('_', ' ')} "
            f"({objects.object_text(index[per_mille_of], 0)} is "
            f"{'missing' if value is None else 'zero'}), of which its values are per mille",
            where=f"{facts.joint} (node {facts.node})",
            next_step=f"give {per_mille_of} in robot.yaml, from the data sheet of the motor",
        )
    return value


def _text(pdo: TransmitPdo | None) -> str:
    if pdo is None:
        return "no such TPDO"
    if not pdo.enabled:
        return "it disabled"
    return f"{pdo.mapping_text()} on 0x{pdo.cob_id:X} with transmission type {pdo.transmission}"


def _read_pdo(drive: Drive, k: int) -> TransmitPdo | None:
    try:
        cob_id = drive.read(FIRST_COMMUNICATION + k, 1)
    except MissingObjectError:
        return None
    transmission = drive.read_optional(FIRST_COMMUNICATION + k, 2)
    count = drive.read_optional(FIRST_MAPPING + k, 0) or 0
    entries: list[MappedObject] = []
    for sub in range(1, (count if count <= MAX_BITS else 0) + 1):
        value = drive.read(FIRST_MAPPING + k, sub)
        if value:
            entries.append(entry_from_value(None, value, f"{drive}, TPDO{k + 1}"))
    return pdo_from_parameters(
        k,
        cob_id,
        EVENT_DRIVEN if transmission is None else transmission,
        tuple(entries),
        str(drive),
    )
