# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from comcal.errors import ComcalError
from comcal.measure.poses_csv import read_poses
from comcal.measure.table import PoseTable
from comcal.robot.model import Robot

Rows = list[dict[str, Any]]
Write = Callable[..., Path]
FAST = settings(
    deadline=None,
    max_examples=80,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
CHANNELS = ("fx", "fy", "fz", "tx", "ty", "tz")


def test_a_byte_order_mark_and_other_line_ends_change_nothing(
    biped: Robot, rows: Rows, write_table: Write
) -> None:
    path = write_table(rows)
    plain = read_poses(path, biped)
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes().replace(b"\n", b"\r\n"))
    table = read_poses(path, biped)
    assert table.row_lines == plain.row_lines
    assert_same(table, plain)


def assert_same(a: PoseTable, b: PoseTable) -> None:
    assert a.pose == b.pose
    assert a.support == b.support
    np.testing.assert_array_equal(a.q, b.q)
    for name in b.wrench:
        np.testing.assert_array_equal(a.wrench[name], b.wrench[name])


@FAST
@given(st.binary(max_size=300))
def test_rubbish_is_refused_in_our_own_words(biped: Robot, tmp_path: Path, rubbish: bytes) -> None:
    path = tmp_path / "poses.csv"
    path.write_bytes(rubbish)
    with pytest.raises(ComcalError):
        read_poses(path, biped)


@FAST
@given(data=st.data())
def test_a_damaged_file_is_refused_or_read_as_it_stands(
    biped: Robot, rows: Rows, write_table: Write, data: st.DataObject
) -> None:
    path = write_table(rows)
    content = bytearray(path.read_bytes())
    place = data.draw(st.integers(0, len(content) - 1))
    length = data.draw(st.integers(0, 3))
    content[place : place + length] = data.draw(st.binary(max_size=3))
    path.write_bytes(bytes(content))
    try:
        table = read_poses(path, biped)
    except ComcalError:
        return
    assert_table_says_what_the_file_says(table, path)


@FAST
@given(
    i=st.integers(0, 3),
    column=st.sampled_from(["pose", "support", "q.l_hip", "ft.l.fz", "ft.r.tx", "tau.l_hip"]),
    text=st.text(max_size=8)
    | st.floats().map(repr)
    | st.integers().map(str)
    | st.sampled_from(["1,5", "--1", "+-2", "0x10", "1e5", " 2 ", "1 2", '"3"', "1.", ".5", "1e"]),
)
def test_any_cell_is_refused_or_read_as_it_stands(
    biped: Robot, rows: Rows, write_table: Write, i: int, column: str, text: str
) -> None:
    rows[i] = dict(rows[i]) | {column: text}
    try:
        path = write_table(rows)
    except UnicodeEncodeError:
        return
    try:
        table = read_poses(path, biped)
    except ComcalError:
        return
    assert_table_says_what_the_file_says(table, path)


def assert_table_says_what_the_file_says(table: PoseTable, path: Path) -> None:
    """Read the file anew, without the code under test: every number must be in the table."""
    import csv

    with path.open(encoding="utf-8-sig", newline="") as file:
        header, *lines = [line for line in csv.reader(file) if line]
    index = {name.strip(): k for k, name in enumerate(header)}
    lines = [line for line in lines if any(cell.strip() for cell in line)]
    assert len(lines) == len(table)
    for i, line in enumerate(lines):
        assert int(float(line[index["pose"]])) == table.pose[i]
        assert line[index["support"]].strip() == table.support[i]
        for k, joint in enumerate(("l_hip", "l_ankle", "r_hip", "r_ankle")):
            assert float(line[index[f"q.{joint}"]]) == table.q[i, k]
        for sensor in ("l", "r"):
            for k, c in enumerate(CHANNELS):
                name = f"ft.{sensor}.{c}"
                if name in index and line[index[name]].strip():
                    assert float(line[index[name]]) == table.wrench[sensor][i, k]
                else:
                    value = table.wrench.get(sensor, np.full((len(table), 6), np.nan))[i, k]
                    assert np.isnan(value)
        named = [name for name in index if name not in KNOWN]
        assert not named or any(name[:30] in note for name in named for note in table.notes)


KNOWN = {
    "pose",
    "support",
    "tau.l_hip",
    *(f"q.{j}" for j in ("l_hip", "l_ankle", "r_hip", "r_ankle")),
    *(f"ft.{s}.{c}" for s in ("l", "r") for c in CHANNELS),
}
