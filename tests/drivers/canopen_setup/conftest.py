# SPDX-License-Identifier: Apache-2.0
"""EDS files that tests write themselves, and drives that answer SDO as such a file says."""

from __future__ import annotations

import uuid
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path

import can
import canopen
import pytest

HEADER = """[FileInfo]
FileName=test.eds
[DeviceInfo]
VendorName=Test
ProductName=Drive
[DummyUsage]
Dummy0001=0
Dummy0002=1
Dummy0003=1
Dummy0004=1
Dummy0005=1
Dummy0006=1
Dummy0007=1
"""

OBJECTS = {
    # index: (name, data type, default)
    0x1000: ("Device Type", 7, "0x00020192"),
    0x1017: ("Producer Heartbeat Time", 6, "0"),
    0x6041: ("StatusWord", 6, "0x0637"),
    0x6064: ("Position Actual Value", 4, "-5"),
    0x6075: ("Motor Rated Current", 7, "5000"),
    0x6076: ("Motor Rated Torque", 7, "88000"),
    0x6077: ("Torque Actual Value", 3, "0"),
    0x6078: ("Current Actual Value", 3, "0"),
    0x2027: ("Twelve Bits", 3, "0"),
    0x2030: ("A Float", 8, "0"),
    0x2031: ("A Flag", 1, "0"),
    0x2032: ("Twenty-four Bits", 0x10, "0"),
    0x2033: ("A Domain", 0x0F, ""),
}

Pdo = tuple[str, int, Sequence[int]]
"""COB-ID as the file writes it, transmission type, mapping entries."""


def variable(section: str, name: str, kind: int, value: str, extra: str = "") -> str:
    return (
        f"[{section}]\nParameterName={name}\nObjectType=0x7\nDataType=0x{kind:04X}\n"
        f"AccessType=rw\nDefaultValue={value}\nPDOMapping=1\n{extra}"
    )


def record(index: int, name: str, members: Sequence[tuple[int, str]]) -> str:
    """A record of (data type, default) members; with the count in front."""
    text = f"[{index:04X}]\nParameterName={name}\nObjectType=0x9\nSubNumber={len(members)}\n"
    for sub, (kind, value) in enumerate(members):
        text += variable(f"{index:04X}sub{sub:X}", f"{name} {sub}", kind, value)
    return text


def eds_text(pdos: Sequence[Pdo], leave_out: Sequence[int] = ()) -> str:
    text = HEADER
    for index, (name, kind, value) in OBJECTS.items():
        if index not in leave_out:
            text += variable(f"{index:04X}", name, kind, value)
    text += record(
        0x1018, "Identity", [(5, "4"), (7, "0xFB"), (7, "0x62110000"), (7, "2"), (7, "0x09007003")]
    )
    for k, (cob_id, transmission, entries) in enumerate(pdos):
        text += record(0x1800 + k, f"TPDO{k + 1}", [(5, "2"), (7, cob_id), (5, str(transmission))])
        mapping = [(5, str(len(entries)))] + [(7, f"0x{entry:08X}") for entry in entries]
        text += record(0x1A00 + k, f"TPDO{k + 1} mapping", mapping)
    return text


@pytest.fixture
def write_eds(tmp_path: Path) -> Callable[..., Path]:
    """Write an EDS with the given TPDOs; return its path."""

    def write(pdos: Sequence[Pdo], *, name: str = "drive.eds", extra: str = "", **more) -> Path:
        path = tmp_path / name
        path.write_text(eds_text(pdos, **more) + extra, encoding="utf-8")
        return path

    return write


@pytest.fixture
def channel() -> str:
    """A virtual bus of this test alone."""
    return f"test-{uuid.uuid4()}"


@pytest.fixture
def opened() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


@pytest.fixture
def start_drive(channel: str, opened: ExitStack) -> Callable[[Path, int], canopen.LocalNode]:
    """Start a drive that answers as its EDS says, on a thread of its own."""

    def start(eds: Path, node: int) -> canopen.LocalNode:
        bus = can.Bus(interface="virtual", channel=channel)
        network = canopen.Network(bus)
        network.NOTIFIER_CYCLE = 0.01
        network.connect()
        opened.callback(network.disconnect)
        local = network.create_node(node, str(eds))
        local.nmt.state = "PRE-OPERATIONAL"
        return local

    return start


@pytest.fixture
def bus(channel: str, opened: ExitStack) -> can.BusABC:
    """The end of the computer."""
    return opened.enter_context(can.Bus(interface="virtual", channel=channel))
