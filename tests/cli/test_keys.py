# SPDX-License-Identifier: Apache-2.0
"""Keys as wishes. A real terminal is in test_record_guided.py."""

from __future__ import annotations

import io
import threading
from collections.abc import Callable

import pytest

from comcal.cli.keys import Keyboard, terminal_operator
from comcal.measure.operator import Nobody, Wish


def wishes(*typed: str, stop: Callable[[], None] | None = None) -> list[Wish]:
    """Return what a keyboard wishes on which *typed* is typed, piece by piece."""
    pieces = iter(typed)
    is_over = threading.Event()

    def read(seconds: float) -> str | None:
        piece = next(pieces, None)
        if piece is None:
            is_over.set()
        return piece

    keyboard = Keyboard(read)
    with keyboard.attend(stop):
        assert is_over.wait(5.0)
    found: list[Wish] = []
    while (wish := keyboard.wish()) is not None:
        found.append(wish)
    return found


@pytest.mark.parametrize(
    ("typed", "expected"),
    [
        ("s", [Wish.SKIP]),
        ("R", [Wish.REDO]),
        ("sq", [Wish.SKIP, Wish.QUIT]),
        ("x y\n", []),
        ("\x1b[A\x1b[1;5C\x1bOQ\x1bs", []),
        ("\x1b[As", [Wish.SKIP]),
        ("\x1b[15~r", [Wish.REDO]),
    ],
)
def test_keys_are_wishes_and_other_keys_are_none(typed: str, expected: list[Wish]) -> None:
    assert wishes(typed) == expected


def test_wishes_keep_their_order_and_pauses_mean_nothing() -> None:
    assert wishes("s", "", "", "r", "") == [Wish.SKIP, Wish.REDO]


@pytest.mark.parametrize("key", [" ", "q", "Q"])
def test_a_commanded_robot_is_stopped_by_the_thread_of_the_keyboard(key: str) -> None:
    threads: list[str] = []
    found = wishes(key, stop=lambda: threads.append(threading.current_thread().name))
    assert found == [Wish.QUIT]
    assert threads == ["keys"]


def test_a_stop_that_fails_still_ends_the_recording() -> None:
    def fail() -> None:
        raise OSError("the bus is gone")

    assert wishes(" ", "s", stop=fail) == [Wish.QUIT, Wish.SKIP]


def test_without_a_terminal_there_is_nobody(tmp_path: object) -> None:
    assert isinstance(terminal_operator(io.StringIO()), Nobody)
    with open("/dev/null") as stream:
        assert isinstance(terminal_operator(stream), Nobody)
