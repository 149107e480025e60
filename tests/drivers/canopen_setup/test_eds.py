# SPDX-License-Identifier: Apache-2.0
"""Layouts from EDS and DCF files. Not covered: files of real drives, which are not ours to ship."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

import can
import numpy as np
import pytest
from cantools.database import load_string

from comcal.errors import ConfigError
from comcal_drivers.canopen_setup.eds import read_layout
from comcal_drivers.canopen_setup.layout import COB_EXTENDED, DriveLayout
from comcal_drivers.canopen_setup.messages import database_from_layout, dbc_text
from comcal_drivers.decode.table import decode, table_from_dbc
from comcal_drivers.frames.messages import pack

POSITION, CURRENT, TORQUE, STATUS = 0x60640020, 0x60780010, 0x60770010, 0x60410010


def decoded(layout: DriveLayout, identifier: int, payload: bytes) -> dict[str, float]:
    """Decode one frame on the path that every device takes."""
    message = can.Message(
        arbitration_id=identifier, data=payload, is_extended_id=identifier > 0x7FF
    )
    table = table_from_dbc(database_from_layout(layout))
    (found,) = [d for d in decode(table, pack([message])).values() if len(d)]
    return {name: float(values[0]) for name, values in found.values.items()}


def test_the_mapping_of_the_lab_decodes_a_frame_packed_by_hand(write_eds: Callable[..., Path]):
    layout = read_layout(write_eds([("$NODEID+0x180", 1, [POSITION, CURRENT, STATUS])]), 1)
    values = decoded(layout, 0x181, struct.pack("<ihH", -123456, -219, 0x0637))
    assert values == {"position": -123456.0, "current": -219.0, "statusword": 0x0637}


@pytest.mark.parametrize("node", [1, 5, 127])
def test_identifiers_follow_the_node(write_eds: Callable[..., Path], node: int):
    pdos = [("$NODEID+0x40000180", 1, [POSITION]), ("0x80000280+$NODEID", 1, [CURRENT])]
    layout = read_layout(write_eds(pdos), node)
    first, second = layout.pdos
    assert (first.cob_id, first.enabled, first.remote_allowed) == (0x180 + node, True, False)
    assert (second.cob_id, second.enabled) == (0x280 + node, False)
    assert [m.frame_id for m in database_from_layout(layout).messages] == [0x180 + node]


def test_odd_lengths_and_fillers_shift_what_follows(write_eds: Callable[..., Path]):
    # 12 bits, a flag of 1 bit, 3 bits of dummy UNSIGNED8, 24 bits, 8 bits of index 0, 16 bits.
    entries = [0x2027000C, 0x20310001, 0x00050003, 0x20320018, 0x00000008, CURRENT]
    layout = read_layout(write_eds([("0x181", 1, entries)]), 1)
    small, flag, long, current = -5, 1, -70000, 321
    bits = small & 0xFFF | flag << 12 | 0b101 << 13 | (long & 0xFFFFFF) << 16 | 0xEE << 40
    payload = (bits | current << 48).to_bytes(8, "little")
    assert decoded(layout, 0x181, payload) == {
        "o2027_00": small,
        "o2031_00": flag,
        "o2032_00": long,
        "current": current,
    }


def test_a_dummy_that_the_file_forbids_still_fills_its_bits(write_eds: Callable[..., Path]):
    # canopen's own PDO classes leave such an entry out: CURRENT would then be read 8 bits early.
    layout = read_layout(write_eds([("0x181", 1, [0x00010008, CURRENT])]), 1)
    assert decoded(layout, 0x181, b"\xff" + struct.pack("<h", -7))["current"] == -7


def test_entries_that_nobody_describes_are_skipped_and_keep_their_bits(
    write_eds: Callable[..., Path],
):
    layout = read_layout(write_eds([("0x181", 1, [0x29990010, 0x20330008, POSITION])]), 1)
    assert decoded(layout, 0x181, b"\xaa\xbb\xcc" + struct.pack("<i", 77)) == {"position": 77}


def test_cia402_tells_the_type_of_its_objects_where_the_file_does_not(
    write_eds: Callable[..., Path],
):
    path = write_eds([("0x181", 1, [CURRENT])], leave_out=[0x6078])
    assert decoded(read_layout(path, 1), 0x181, struct.pack("<h", -2)) == {"current": -2}


def test_floats_and_repeated_objects_are_signals_of_their_own(write_eds: Callable[..., Path]):
    layout = read_layout(write_eds([("0x181", 1, [0x20300020, CURRENT, CURRENT])]), 1)
    values = decoded(layout, 0x181, struct.pack("<fhh", 0.1, 1, 2))
    assert values == {"o2030_00": float(np.float32(0.1)), "current": 1, "current_2": 2}


def test_extended_identifiers_are_told_apart(write_eds: Callable[..., Path]):
    path = write_eds([(f"0x{COB_EXTENDED | 0x12345:X}", 1, [POSITION])])
    assert decoded(read_layout(path, 1), 0x12345, struct.pack("<i", 9)) == {"position": 9}


def test_a_dcf_counts_more_than_its_defaults(write_eds: Callable[..., Path], tmp_path: Path):
    path = write_eds([("$NODEID+0x180", 255, [STATUS, 0])], name="drive.dcf")
    text = path.read_text()
    for section, value in (
        ("1800sub1", "0x00000181"),
        ("1800sub2", "1"),
        ("1A00sub1", f"0x{POSITION:08X}"),
        ("1A00sub2", f"0x{CURRENT:08X}"),
    ):
        text = text.replace(f"[{section}]\n", f"[{section}]\nParameterValue={value}\n")
    path.write_text(text + "[DeviceComissioning]\nNodeID=1\nNodeName=EPOS\n")
    (pdo,) = read_layout(path, 1).pdos
    assert (pdo.transmission, pdo.mapping_text()) == (1, "0x6064/32, 0x6078/16")
    with pytest.raises(ConfigError, match="exported for node 1"):
        read_layout(path, 2)


def test_latin_1_and_a_byte_order_mark_are_read(write_eds: Callable[..., Path]):
    path = write_eds([("0x181", 1, [POSITION])])
    text = path.read_text().replace("Position Actual Value", "Läge")
    for coding in ("latin-1", "utf-8-sig", "utf-8"):
        path.write_bytes(text.encode(coding))
        (pdo,) = read_layout(path, 1).pdos
        assert pdo.entries[0].title == "Läge"


def test_unused_places_of_a_fixed_mapping_are_no_entries(write_eds: Callable[..., Path]):
    (pdo,) = read_layout(write_eds([("0x181", 1, [POSITION, 0, 0, 0])]), 1).pdos
    assert pdo.bits == 32


def test_a_multiplexed_pdo_is_not_decoded(write_eds: Callable[..., Path]):
    path = write_eds([("0x181", 1, [POSITION]), ("0x281", 1, [CURRENT])])
    text = path.read_text()
    at = text.index("[1A01sub0]")
    path.write_text(text[:at] + text[at:].replace("DefaultValue=1\n", "DefaultValue=0xFE\n", 1))
    assert [pdo.enabled for pdo in read_layout(path, 1).pdos] == [True, False]


@pytest.mark.parametrize(
    ("entries", "said"),
    [
        ([0x60410020], "0x6041/32 has an impossible length"),
        ([0x20300010], "0x2030/16 has an impossible length"),
        ([POSITION, POSITION, STATUS], "80 bits"),
        ([0x29990010], "no enabled TPDO carries a value"),
    ],
)
def test_a_mapping_that_cannot_be_is_refused(
    write_eds: Callable[..., Path], entries: list[int], said: str
):
    with pytest.raises(ConfigError, match=said):
        database_from_layout(read_layout(write_eds([("0x181", 1, entries)]), 1))


def test_two_pdos_with_one_identifier_are_refused(write_eds: Callable[..., Path]):
    path = write_eds([("0x181", 1, [POSITION]), ("0x181", 1, [CURRENT])])
    with pytest.raises(ConfigError, match="TPDO1 and TPDO2 of node 1"):
        database_from_layout(read_layout(path, 1))


@pytest.mark.parametrize("text", ["", "[1800]\n", "not an eds", "[A]\n[A]\n", "\0\0"])
def test_what_is_no_eds_is_refused_by_name(tmp_path: Path, text: str):
    path = tmp_path / "drive.eds"
    path.write_text("[DeviceInfo]\n" + text)
    with pytest.raises(ConfigError, match=r"drive\.eds"):
        read_layout(path, 1)


def test_a_missing_file_and_a_wrong_node_are_refused(tmp_path: Path):
    with pytest.raises(ConfigError, match=r"none\.eds"):
        read_layout(tmp_path / "none.eds", 1)
    with pytest.raises(ConfigError, match="1 to 127"):
        read_layout(tmp_path / "none.eds", 128)


def test_the_dbc_text_says_the_same_as_the_layout(write_eds: Callable[..., Path]):
    pdos = [("0x181", 1, [0x2027000C, POSITION, 0x20310001]), ("0x281", 1, [0x20300020, CURRENT])]
    layout = read_layout(write_eds(pdos), 1)
    ours, again = database_from_layout(layout), load_string(dbc_text(layout), "dbc")
    for message in ours.messages:
        other = again.get_message_by_name(message.name)
        assert (other.frame_id, other.length) == (message.frame_id, message.length)
        payload = bytes(range(17, 17 + message.length))
        assert other.decode(payload) == message.decode(payload)


def test_a_sample_takes_the_fewest_pdos(write_eds: Callable[..., Path]):
    # As in the lab: position stands in two TPDOs, everything wanted in the first alone.
    pdos = [
        ("0x181", 1, [POSITION, CURRENT, STATUS]),
        ("0x281", 1, [0x20320018]),
        ("0x381", 255, [STATUS, POSITION]),
    ]
    layout = read_layout(write_eds(pdos), 1)
    assert [p.number for p in layout.sample([0x6064, 0x6078, 0x6041])] == [1]
    assert [p.number for p in layout.sample([0x6064, 0x2032])] == [1, 2]


def test_a_sample_prefers_pdos_of_one_sync(write_eds: Callable[..., Path]):
    pdos = [("0x181", 255, [POSITION]), ("0x281", 1, [POSITION]), ("0x381", 1, [CURRENT])]
    layout = read_layout(write_eds(pdos), 1)
    assert [p.number for p in layout.sample([0x6064, 0x6078])] == [2, 3]


def test_a_sample_of_pdos_that_nothing_holds_together_is_refused(write_eds: Callable[..., Path]):
    for kinds in ((1, 255), (255, 255), (1, 2)):
        pdos = [("0x181", kinds[0], [POSITION]), ("0x281", kinds[1], [CURRENT])]
        with pytest.raises(ConfigError, match="transmission type"):
            read_layout(write_eds(pdos), 1).sample([0x6064, 0x6078])


def test_an_object_that_no_pdo_carries_is_named(write_eds: Callable[..., Path]):
    layout = read_layout(write_eds([("0x181", 1, [POSITION])]), 1)
    with pytest.raises(ConfigError, match="carries 0x6077"):
        layout.sample([0x6064, 0x6077])
