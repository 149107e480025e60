# SPDX-License-Identifier: Apache-2.0
"""Consoles: plain text for files, colour for terminals that want it."""

from __future__ import annotations

import io

import pytest

from comcal.report.console import PLAIN_WIDTH, make_console, print_table


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
