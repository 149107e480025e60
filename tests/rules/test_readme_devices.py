# SPDX-License-Identifier: Apache-2.0
"""README's table of devices says what their files say, of every device and no other."""

from __future__ import annotations

import re
from pathlib import Path

from comcal_drivers.canopen_setup.conflicts import is_canopen
from comcal_drivers.devices.description import Device, device_names, load_device


def joined(device: Device) -> str:
    """How the parts of one sample are brought together."""
    join = device.description.join
    if join.rule == "counter":
        return "counter"
    if join.rule == "concatenate":
        return "bytes of two frames" + (", counter" if join.signal else "")
    if join.rule == "single":
        return "one frame"
    return "order, per request" if join.request is not None else "order"


def row(device: Device) -> str:
    """The row of a device."""
    description = device.description
    title = description.title.split(",")[0]
    ids = ", ".join(f"`{key}`" for key in description.ids)
    asked = ", ".join(name.replace("_", " ") for name in description.start) or "-"
    if is_canopen(device):
        asked = "identity, rated values, mapping (SDO)"
    return f"| `{description.name}` | {title} | {ids} | {joined(device)} | {asked} |"


def test_readme_lists_every_device_and_no_other(root: Path) -> None:
    section = re.split(r"^## On the robot$", (root / "README.md").read_text("utf-8"), flags=re.M)
    found = re.findall(r"^\| `\w+` \|.*$", section[1].split("\n## ")[0], re.MULTILINE)
    assert found == [row(load_device(name)) for name in device_names()]
