# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import sys
from pathlib import Path

import pytest

from comcal.errors import ConfigError, MissingExtraError
from comcal_drivers.decode.dbc import read_dbc

GOOD = 'VERSION ""\nBU_: X\nBO_ 1 M: 1 X\n SG_ s : 0|8@1+ (1,0) [0|0] "°C" X\n'


def test_messages_of_a_file_are_read(tmp_path: Path) -> None:
    path = tmp_path / "good.dbc"
    path.write_text(GOOD, "cp1252")
    message = read_dbc(path).get_message_by_name("M")
    assert message.get_signal_by_name("s").unit == "°C"


def test_errors_name_the_file_and_the_line(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"none\.dbc: .*No such file"):
        read_dbc(tmp_path / "none.dbc")
    path = tmp_path / "bad.dbc"
    path.write_text(GOOD.replace("SG_", "XX_"), "cp1252")
    with pytest.raises(ConfigError, match=r"bad\.dbc: .*line 4"):
        read_dbc(path)
    path.write_text(GOOD + ' SG_ t : 0|8@1+ (1,0) [0|0] "" X\n', "cp1252")
    with pytest.raises(ConfigError, match="overlapping"):
        read_dbc(path)


def test_without_cantools_the_line_to_type_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "cantools.database", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'comcal\[can\]'"):
        read_dbc(tmp_path / "any.dbc")
