# SPDX-License-Identifier: Apache-2.0
"""Asking somebody whether a robot may be moved."""

from __future__ import annotations

import sys

import click


def ask_on_terminal(text: str) -> bool:
    """Show *text* and ask for a yes; False where there is no terminal to ask on.

    Parameters
    ----------
    text : str
    """
    if not (sys.stdin.isatty() and sys.stderr.isatty()):
        return False
    click.echo(text, err=True)
    click.echo("Stop it with space, q or Ctrl-C.", err=True)
    answer = click.prompt("Type yes to let it move", default="no", show_default=False, err=True)
    return str(answer).strip().lower() == "yes"
