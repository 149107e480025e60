# SPDX-License-Identifier: Apache-2.0
"""Give a drive of robot.yaml the layout of its EDS or DCF instead of the one that comes with it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from comcal.errors import ConfigError
from comcal_drivers.canopen_setup.conflicts import is_canopen, node_of
from comcal_drivers.canopen_setup.eds import read_layout
from comcal_drivers.canopen_setup.layout import DriveLayout
from comcal_drivers.canopen_setup.messages import dbc_text
from comcal_drivers.canopen_setup.objects import index_of_signal
from comcal_drivers.devices.configuration import JointConfig
from comcal_drivers.devices.description import Description, Device, Join


def fit_joint(joint: JointConfig, folder: Path) -> JointConfig:
    """Return the joint with a device that is laid out as its ``eds`` or ``dcf`` says.

    Parameters
    ----------
    joint : JointConfig
        Returned as it is where it names neither.
    folder : Path
        Where the layout is written, as ``JOINT.dbc``; it must live as long as the device is used.

    Raises
    ------
    ConfigError
        If both are named, the device is no CANopen drive, or the file does not carry its values.
    """
    layout = layout_of(joint)
    if layout is None:
        return joint
    return replace(joint, device=fit_device(joint.device, layout, folder / f"{joint.name}.dbc"))


def layout_of(joint: JointConfig) -> DriveLayout | None:
    """Return the PDOs of one sample by the joint's ``eds`` or ``dcf``; None without either.

    Raises
    ------
    ConfigError
        As of :func:`fit_joint`.
    """
    path = joint.dcf or joint.eds
    if path is None:
        return None
    where = f"sources.can.joints.{joint.name}"
    if joint.dcf is not None and joint.eds is not None:
        raise ConfigError(
            "both `eds` and `dcf` are given",
            where=where,
            next_step="keep `dcf`: it says how this very drive is configured",
        )
    if not is_canopen(joint.device):
        raise ConfigError(
            f"{joint.device.description.name} is no CANopen drive, so it has no EDS or DCF",
            where=where,
            next_step="choose device: cia402, cia402_torque or maxon_epos, or leave the file out",
        )
    return sample_layout(read_layout(path, node_of(joint.device)), joint.device.description)


def sample_layout(layout: DriveLayout, description: Description) -> DriveLayout:
    """Return the layout with only those PDOs that carry the values of a description.

    Raises
    ------
    ConfigError
        If a value is in no enabled PDO, or nothing holds the PDOs together.
    """
    objects = [index_of_signal(name) for name in description.values]
    wanted = [found[0] for found in objects if found is not None]
    return replace(layout, pdos=layout.sample(wanted))


def fit_device(device: Device, layout: DriveLayout, path: Path) -> Device:
    """Return a device whose messages are the PDOs of *layout*, written to *path* as a DBC.

    The values and their units stay those of the description. Its status is kept where the status
    word comes with the values.

    Parameters
    ----------
    device : Device
    layout : DriveLayout
        Of :func:`sample_layout`.
    path : Path
    """
    path.write_text(dbc_text(layout, device.offset), encoding="utf-8")
    description = device.description
    signals = {entry.signal for pdo in layout.pdos for entry in pdo.entries}
    status = description.status
    rule, timeout = ("single" if len(layout.pdos) == 1 else "fifo"), description.join.timeout
    fitted = description.model_copy(
        update={
            "parts": tuple(pdo.name for pdo in layout.pdos),
            "join": Join.model_validate({"rule": rule, "timeout": timeout}),
            "status": status if status is not None and status.signal in signals else None,
        }
    )
    return Device(fitted, path, device.ids)
