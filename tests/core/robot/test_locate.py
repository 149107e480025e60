# SPDX-License-Identifier: Apache-2.0
"""YAML is read as data with lines, and everything else is refused with its line."""

from __future__ import annotations

import math

import pytest

from comcal.errors import ConfigError
from comcal.robot.locate import read_yaml


def test_scalars_follow_yaml_1_2_and_lines_are_known(write):
    text = (
        "a: 1e-3\nb: [1, on, ~]\nc:\n  d: 0x1f\n  e: 26.32 mm\nf: .inf\ng: true\nh: '5'\ni: 1_000\n"
    )
    located = read_yaml(write("x.yaml", text))
    assert located.data == {
        "a": 0.001,
        "b": [1, "on", None],
        "c": {"d": 31, "e": "26.32 mm"},
        "f": math.inf,
        "g": True,
        "h": "5",
        "i": 1000,
    }
    assert located.where("c", "e") == "x.yaml:5"
    assert located.where("c", "missing") == "x.yaml:3"
    assert located.where("b", 1) == "x.yaml:2"


def test_octal_looking_numbers_are_decimal_even_under_an_old_directive(write):
    assert read_yaml(write("x.yaml", "%YAML 1.1\n---\na: 017\n")).data == {"a": 17}


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        (b"", 1, "empty"),
        (b"# only a remark\n", 1, "empty"),
        (b"- 1\n- 2\n", 1, "key: value"),
        (b"hello", 1, "key: value"),
        (b"a: 1\nb: 2\na: 3\n", 3, "twice, first in line 1"),
        (b"a:\n  b: 1\n  c: 2\n  b: 3\n", 4, "twice, first in line 2"),
        (b"a:\n\tb: 1\n", 2, "tab"),
        (b"a: 'open\n", 2, "not valid YAML"),
        (b"a: 1\nb: \xff\xfe\n", 2, "not UTF-8"),
        (b"\x00\x01\x02", 1, "YAML forbids"),
        (b"a: 1\nb: \x07\n", 2, "YAML forbids"),
        (b"a: &x [*x]\n", 1, "alias"),
        (b"a: 1\n---\nb: 2\n", 2, "another document"),
        (b"a: 1\nb: !!python/name:os.system x\n", 2, "no meaning"),
        (b"a: !!int abc\n", 1, "not a number"),
        (b"a: 1\n? [1, 2]\n: 3\n", 2, "key must be a word"),
        (b"[" * 600, 1, "nested too deeply"),
        (b"<robot name='x'/>", 1, "XML"),
    ],
)
def test_what_is_not_a_map_is_refused_with_file_and_line(write, text, line, message):
    with pytest.raises(ConfigError, match=message) as caught:
        read_yaml(write("x.yaml", text))
    assert caught.value.where == f"x.yaml:{line}"


def test_many_aliases_of_aliases_are_refused_quickly(write):
    levels = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    levels += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 9)]
    with pytest.raises(ConfigError, match="too long"):
        read_yaml(write("x.yaml", "\n".join(levels)))


def test_missing_files_and_folders_are_named(tmp_path):
    with pytest.raises(ConfigError, match="no such file"):
        read_yaml(tmp_path / "absent.yaml")
    with pytest.raises(ConfigError, match="is a folder"):
        read_yaml(tmp_path)


def test_a_byte_order_mark_is_harmless(write):
    assert read_yaml(write("x.yaml", b"\xef\xbb\xbfa: 1\n")).data == {"a": 1}
