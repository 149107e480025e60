# SPDX-License-Identifier: Apache-2.0
"""Consoles: plain text for files, colour for terminals that want it."""

from __future__ import annotations

import io

import pytest

from comcal.report.console import PLAIN_WIDTH, make_console, print_lines, print_table


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture(autouse=True)
def bare_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("NO_COLOR", "FORCE_COLOR", "COLUMNS", "TTY_COMPATIBLE", "TTY_INTERACTIVE"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("TERM", "xterm-256color")


def test_text_for_a_file_is_plain_and_of_fixed_width() -> None:
    console = make_console(file=io.StringIO())
    assert console.width == PLAIN_WIDTH
    console.print("[bold] 1.5 :smile:", style="red")
    assert console.file.getvalue() == "[bold] 1.5 :smile:\n"  # pyright: ignore[reportAttributeAccessIssue]


def test_columns_overrides_the_width_of_plain_text(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "60")
    assert make_console(file=io.StringIO()).width == 60


def test_colour_is_for_terminals_without_no_color(monkeypatch: pytest.MonkeyPatch) -> None:
    colourful, plain = Terminal(), Terminal()
    make_console(file=colourful).print("x", style="red")
    monkeypatch.setenv("NO_COLOR", "1")
    make_console(file=plain).print("x", style="red")
    assert "\x1b[" in colourful.getvalue()
    assert "\x1b[" not in plain.getvalue()


def test_table_in_a_file_has_no_trailing_blanks() -> None:
    file = io.StringIO()
    print_table(make_console(file=file), [("a", "1"), ("long", "[2]")], header=("name", "n"))
    assert file.getvalue() == "name  n\na     1\nlong  [2]\n"


@pytest.mark.parametrize(("width", "between"), [("29", " +/- "), ("28", "±")])
def test_value_and_sigma_move_together_before_they_are_torn_apart(
    width: str, between: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", width)
    file = io.StringIO()
    print_table(make_console(file=file), [("1.25 +/- 0.12", "-3.50 +/- 0.14")], header=("x", "y"))
    lines = file.getvalue().splitlines()
    assert lines[1].split("  ") == [f"1.25{between}0.12", f"-3.50{between}0.14"]
    assert all(len(line) <= int(width) for line in lines)


def test_a_table_that_is_too_narrow_loses_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "20")
    file = io.StringIO()
    print_table(make_console(file=file), [("left_shoulder_pitch_link", "12.5", "kg")])
    assert "".join(file.getvalue().split()).replace("12.5kg", "") == "left_shoulder_pitch_link"


def test_long_lines_are_wrapped_between_words_and_indented_further() -> None:
    file = io.StringIO()
    line = "  note: " + " ".join(["word"] * 30)
    print_lines(make_console(file=file), [line, "", "short"])
    *wrapped, empty, short = file.getvalue().splitlines()
    assert len(wrapped) == 2
    assert all(len(piece) <= PLAIN_WIDTH and piece == piece.rstrip() for piece in wrapped)
    assert wrapped[1].startswith("    word")
    assert " ".join(piece.strip() for piece in wrapped) == line.strip()
    assert (empty, short) == ("", "short")
