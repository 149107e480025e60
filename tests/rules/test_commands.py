# SPDX-License-Identifier: Apache-2.0
"""Rules about the command line: help with an example, and a row in README's table."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from comcal.cli.commands import SUBCOMMANDS, cli

NAMES = list(SUBCOMMANDS)


@pytest.mark.parametrize("name", NAMES)
def test_help_has_an_example(name: str) -> None:
    result = CliRunner().invoke(cli, [name, "--help"])
    assert result.exit_code == 0, result.output
    assert re.search(rf"Examples?:\n\n?\s+comcal {name}\b", result.output), result.output


@pytest.mark.parametrize("name", NAMES)
def test_every_option_says_what_it_does(name: str) -> None:
    command = cli.get_command(click.Context(cli), name)
    assert command is not None
    options = [p for p in command.params if isinstance(p, click.Option)]
    assert not [o.name for o in options if not o.help]


def test_example_in_the_overall_help_is_a_command() -> None:
    output = CliRunner().invoke(cli, ["--help"]).output
    assert set(re.findall(r"^\s+comcal (\w+)", output, re.MULTILINE)) <= set(NAMES)


def test_readme_lists_every_command_and_no_other(root: Path) -> None:
    section = re.split(r"^## Commands\b.*$", (root / "README.md").read_text("utf-8"), flags=re.M)
    if len(section) == 1:
        pytest.skip("README.md has no heading '## Commands' yet")
    table = section[1].split("\n## ")[0]
    assert set(re.findall(r"^\|\s*`comcal (\w+)", table, re.MULTILINE)) == set(NAMES)


def texts(file: Path) -> Iterator[tuple[int, str]]:
    """Yield the strings of a module with their lines, docstrings left out."""
    tree = ast.parse(file.read_text("utf-8"))
    docstrings = {id(n.value) for n in ast.walk(tree) if isinstance(n, ast.Expr)}
    for node in ast.walk(tree):
        if not isinstance(node, ast.Constant) or id(node) in docstrings:
            continue
        if isinstance(node.value, str):
            yield node.lineno, node.value


def test_messages_only_send_people_to_commands_that_exist(library_files: list[Path]) -> None:
    sent_nowhere = [
        f"{file}:{line} comcal {name}"
        for file in library_files
        for line, text in texts(file)
        for name in re.findall(r"`comcal (\w+)", text)
        if name not in NAMES
    ]
    assert not sent_nowhere, "\n".join(sent_nowhere)
