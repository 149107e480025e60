# SPDX-License-Identifier: Apache-2.0
"""The entry of the ``comcal`` command: whatever goes wrong becomes one line and an exit code."""

from __future__ import annotations

import io
import os
import sys
import traceback
from collections.abc import Sequence
from contextlib import suppress

import click
from click.shell_completion import shell_complete

from comcal.cli.commands import SUBCOMMANDS, VERBOSITY, cli
from comcal.cli.signals import signals_as_interrupt
from comcal.errors import ComcalError

EXIT_BUG = 1
EXIT_USAGE = 2
EXIT_INTERRUPTED = 130
EXIT_BROKEN_PIPE = 141
"""128 + SIGPIPE: what a shell sees of any program whose reader went away."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run ``comcal`` and return its exit code.

    Parameters
    ----------
    argv : sequence of str or None
        Arguments after the program's name; by default those of the process.

    Returns
    -------
    int
        As ``comcal --help`` lists them; 141 when the reader of a pipe went away. Nothing is
        raised: what went wrong stands in one line on standard error.
    """
    args = list(sys.argv[1:] if argv is None else argv)
    if instruction := os.environ.get("_COMCAL_COMPLETE"):
        return shell_complete(cli, {}, "comcal", "_COMCAL_COMPLETE", instruction)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            # A terminal that cannot show a letter gets a question mark, not an error.
            stream.reconfigure(errors="replace")
    meta: dict[str, object] = {}
    with signals_as_interrupt() as caught:
        try:
            code = _invoke(args or ["--help"], meta)
            sys.stdout.flush()
        except (KeyboardInterrupt, click.Abort):
            code = _interrupted(args)
        except BrokenPipeError:
            code = EXIT_BROKEN_PIPE
        except Exception as error:  # noqa: BLE001 - the outermost handler: nothing may pass it
            # After a hang-up saving and printing fail in many ways; they have one cause.
            code = _interrupted(args) if caught else _report(error, meta.get(VERBOSITY, 0))
    _flush_or_drop()
    return code


def _invoke(args: list[str], meta: dict[str, object]) -> int:
    """Parse and run; return the exit code that the command chose, and its context's *meta*."""
    try:
        with cli.make_context("comcal", args) as ctx:
            try:
                result = cli.invoke(ctx)
            finally:
                meta.update(ctx.meta)
    except click.exceptions.Exit as leave:
        return leave.exit_code
    return result if isinstance(result, int) else 0


def _report(error: Exception, verbosity: object) -> int:
    """Print one line about *error*, more if asked; return its exit code."""
    line, code = _explain(error)
    with suppress(OSError):
        sys.stderr.write(f"error: {line}\n")
        if verbosity == 1:
            sys.stderr.write("".join(f"caused by: {cause!r}\n" for cause in _causes(error)))
        elif verbosity:
            sys.stderr.write("".join(traceback.format_exception(error)))
    return code


def _explain(error: Exception) -> tuple[str, int]:
    """Return the line that says what *error* is about, and its exit code."""
    if isinstance(error, ComcalError):
        return str(error), error.exit_code
    if isinstance(error, click.UsageError) and error.ctx is not None:
        message = error.format_message().rstrip(".")
        return f"{message}; see: {error.ctx.command_path} --help", EXIT_USAGE
    if isinstance(error, click.ClickException):
        return error.format_message(), EXIT_USAGE
    if isinstance(error, OSError) and error.errno is not None:
        where = f"{error.filename}: " if error.filename is not None else ""
        return f"{where}{error.strerror}", EXIT_USAGE
    return (
        f"this is a bug of comcal ({type(error).__name__}: {error}); "
        "run the command again with -vv and report what it prints",
        EXIT_BUG,
    )


def _causes(error: BaseException) -> list[BaseException]:
    """Return what led to *error*, nearest first."""
    causes: list[BaseException] = []
    cause = error.__cause__ or error.__context__
    while cause is not None and cause not in causes:
        causes.append(cause)
        cause = cause.__cause__ or cause.__context__
    return causes


def _interrupted(args: list[str]) -> int:
    """Say that the run was interrupted, if there still is somebody to say it to."""
    saved = next((SUBCOMMANDS[word].saved for word in args if word in SUBCOMMANDS), "")
    with suppress(OSError):
        sys.stderr.write(f"interrupted{', ' if saved else ''}{saved}\n")
    return EXIT_INTERRUPTED


def _flush_or_drop() -> None:
    """Flush the standard streams; point those that nobody reads any more at nothing.

    The interpreter flushes them once more at exit, and would complain and change the exit code.
    """
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, stream.fileno())
            os.close(nowhere)
