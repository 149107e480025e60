# SPDX-License-Identifier: Apache-2.0
"""Whatever goes wrong in a command becomes one line on stderr and the right exit code."""

from __future__ import annotations

import os
import pty
import signal
import subprocess
import sys
import types
from collections.abc import Callable

import click
import pytest

from comcal import errors
from comcal.cli.commands import SUBCOMMANDS, Subcommand
from comcal.cli.main import main

Install = Callable[[Callable[[], object]], None]


@pytest.fixture
def do(monkeypatch: pytest.MonkeyPatch) -> Install:
    """Make ``comcal do`` call a function."""

    def install(action: Callable[[], object]) -> None:
        module = types.ModuleType("made_up_commands")
        module.command = click.Command("do", callback=action)  # pyright: ignore[reportAttributeAccessIssue]
        monkeypatch.setitem(sys.modules, "made_up_commands", module)
        monkeypatch.setitem(
            SUBCOMMANDS, "do", Subcommand("made_up_commands:command", "Do.", saved="all saved")
        )

    return install


def raising(error: BaseException) -> Callable[[], object]:
    def action() -> object:
        raise error

    return action


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (errors.ConfigError("bad"), 2),
        (errors.UrdfError("bad"), 2),
        (errors.MissingColumnError("bad"), 2),
        (errors.NotStillError("bad"), 3),
        (errors.RankError("bad"), 3),
        (errors.HardwareError("bad"), 4),
        (errors.MissingExtraError("bad"), 6),
        (PermissionError(13, "Permission denied", "/data"), 2),
        (OSError(28, "No space left on device"), 2),
        (click.UsageError("bad"), 2),
        (click.FileError("x", "bad"), 2),
        (ZeroDivisionError("bad"), 1),
        (KeyboardInterrupt(), 130),
        (click.Abort(), 130),
        (BrokenPipeError(32, "Broken pipe"), 141),
    ],
    ids=lambda value: type(value).__name__ if isinstance(value, BaseException) else str(value),
)
def test_every_error_has_its_exit_code_and_no_trace(
    do: Install, capfd: pytest.CaptureFixture[str], error: BaseException, code: int
) -> None:
    do(raising(error))
    assert main(["do"]) == code
    out, err = capfd.readouterr()
    assert out == ""
    assert "Traceback" not in err
    assert len(err.splitlines()) == (0 if code == 141 else 1)


def test_error_line_says_where_what_measured_limit_and_next(
    do: Install, capsys: pytest.CaptureFixture[str]
) -> None:
    do(
        raising(
            errors.NotStillError(
                "the robot moved",
                where="poses.csv:7 (pose 3)",
                measured="CoP sd 2.1 mm",
                limit="1 mm",
                next_step="record the pose again",
            )
        )
    )
    main(["do"])
    assert capsys.readouterr().err == (
        "error: poses.csv:7 (pose 3): the robot moved (CoP sd 2.1 mm, limit 1 mm); "
        "record the pose again\n"
    )


def test_bug_is_called_a_bug(do: Install, capsys: pytest.CaptureFixture[str]) -> None:
    do(raising(ZeroDivisionError("division by zero")))
    main(["do"])
    err = capsys.readouterr().err
    assert "bug of comcal (ZeroDivisionError: division by zero)" in err
    assert "-vv" in err


@pytest.mark.parametrize("words", [["-vv", "do"], ["do", "-vv"], ["-v", "do", "-v", "-v"]])
def test_trace_comes_with_vv_wherever_it_stands(
    do: Install, capsys: pytest.CaptureFixture[str], words: list[str]
) -> None:
    do(raising(errors.ConfigError("bad")))
    assert main(words) == 2
    assert "Traceback (most recent call last)" in capsys.readouterr().err


def test_cause_comes_with_one_v(do: Install, capsys: pytest.CaptureFixture[str]) -> None:
    def action() -> None:
        try:
            int("x")
        except ValueError as cause:
            raise errors.ConfigError("bad number") from cause

    do(action)
    main(["do", "-v"])
    err = capsys.readouterr().err
    assert err.startswith("error: bad number\ncaused by: ValueError(")
    assert "Traceback" not in err


def test_interrupt_says_what_is_saved(do: Install, capsys: pytest.CaptureFixture[str]) -> None:
    do(raising(KeyboardInterrupt()))
    main(["do"])
    assert capsys.readouterr().err == "interrupted, all saved\n"


@pytest.mark.parametrize(("returned", "code"), [(None, 0), (0, 0), (5, 5)])
def test_command_chooses_its_exit_code(do: Install, returned: object, code: int) -> None:
    do(lambda: returned)
    assert main(["do"]) == code


def test_command_can_leave_with_a_code(do: Install) -> None:
    do(raising(click.exceptions.Exit(5)))
    assert main(["do"]) == 5


def test_wrong_usage_names_what_would_have_worked(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["chekc"]) == 2
    assert "did you mean 'check'?" in capsys.readouterr().err
    assert main(["xyzzy"]) == 2
    assert ", ".join(SUBCOMMANDS) in capsys.readouterr().err


def test_nothing_typed_is_help(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 0
    assert capsys.readouterr().out.startswith("Usage: comcal")


def test_signal_handlers_are_put_back(do: Install) -> None:
    before = [signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGHUP)]
    do(lambda: None)
    main(["do"])
    assert [signal.getsignal(n) for n in (signal.SIGTERM, signal.SIGHUP)] == before


# A command that works until it is stopped, and then takes its time to save.
WORKING = """
import sys, time, types, click
from comcal.cli import commands, main
def work():
    try:
        print("working", flush=True)
        time.sleep(30)
    finally:
        time.sleep(0.3)
        print("saved", flush=True)
module = types.ModuleType("made_up")
module.command = click.Command("work", callback=work)
sys.modules["made_up"] = module
commands.SUBCOMMANDS["work"] = commands.Subcommand("made_up:command", "", "session saved")
sys.exit(main.main(["work"]))
"""


def working(prefix: str = "", **options: object) -> subprocess.Popen[str]:
    process = subprocess.Popen(
        [sys.executable, "-c", prefix + WORKING],
        text=True,
        **{"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, **options},
    )
    if process.stdout is not None:
        assert process.stdout.readline() == "working\n"
    return process


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_signal_saves_and_exits_130(number: signal.Signals) -> None:
    process = working()
    process.send_signal(number)
    out, err = process.communicate(timeout=20)
    assert (process.returncode, out, err) == (130, "saved\n", "interrupted, session saved\n")


def test_second_signal_does_not_disturb_the_saving() -> None:
    process = working()
    process.send_signal(signal.SIGHUP)
    process.send_signal(signal.SIGTERM)
    out, _ = process.communicate(timeout=20)
    assert (process.returncode, out) == (130, "saved\n")


def test_ignored_hang_up_stays_ignored() -> None:
    process = working("import signal; signal.signal(signal.SIGHUP, signal.SIG_IGN)\n")
    process.send_signal(signal.SIGHUP)
    with pytest.raises(subprocess.TimeoutExpired):
        process.wait(timeout=0.5)
    process.send_signal(signal.SIGTERM)
    process.communicate(timeout=20)
    assert process.returncode == 130


def test_terminal_that_hangs_up_is_an_interrupt() -> None:
    """The real thing: the terminal goes away, and writing to it fails from then on."""
    master, slave = pty.openpty()
    owner = "import fcntl, termios; fcntl.ioctl(0, termios.TIOCSCTTY, 0)\n"
    process = working(owner, stdin=slave, stdout=slave, stderr=slave, start_new_session=True)
    os.close(slave)
    assert b"working" in os.read(master, 100)
    os.close(master)
    assert process.wait(timeout=20) == 130


def test_reader_that_goes_away_is_met_with_silence() -> None:
    code = "import sys; from comcal.cli.main import main; sys.exit(main(['--help']))"
    process = subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    assert process.stdout is not None
    process.stdout.close()
    assert process.wait(timeout=20) == 141
    assert process.stderr is not None
    with process.stderr as stderr:
        assert stderr.read() == b""


def test_letter_that_the_terminal_lacks_is_no_error() -> None:
    code = "import sys; from comcal.cli.main import main; main(['x\\u00e4']); print('\\u03b1')"
    run = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "PYTHONIOENCODING": "ascii:strict"},
        capture_output=True,
        timeout=20,
    )
    assert (run.returncode, run.stdout) == (0, b"?\n")
    assert b"'x?'" in run.stderr


def test_module_is_the_same_program() -> None:
    run = subprocess.run(
        [sys.executable, "-m", "comcal", "--version"], capture_output=True, text=True, timeout=20
    )
    assert (run.returncode, run.stderr) == (0, "")
    assert run.stdout.startswith("comcal ")
