# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import click
import pytest

from comcal.cli.pose_list import pose_numbers


@pytest.mark.parametrize(
    ("text", "poses"), [("", []), ("4", [4]), ("4, 7-9,2", [4, 7, 8, 9, 2]), ("3-3", [3])]
)
def test_numbers_and_ranges_are_understood(text: str, poses: list[int]) -> None:
    assert pose_numbers(text, "--held-out") == poses


@pytest.mark.parametrize("text", ["a", "4;5", "-3", "1-2-3", "4.5"])
def test_anything_else_is_refused(text: str) -> None:
    with pytest.raises(click.UsageError, match="--held-out"):
        pose_numbers(text, "--held-out")
