# SPDX-License-Identifier: Apache-2.0
"""Thirty drives that lose alike are one phrase, and nothing is left unsaid."""

from __future__ import annotations

from comcal.cli.grouped import losses_text, rates_text
from comcal.measure.source import SourceStatus

JOINTS = [f"joint_{k}" for k in range(14)]


def test_devices_with_equal_numbers_are_one_phrase() -> None:
    lost = {"l_foot lost": 3, "r_foot lost": 3, "can0 silences": 1, "torso": 2}
    lost |= {f"{name} gaps": 7 for name in JOINTS} | {"hand gaps": 0}
    assert losses_text(SourceStatus({}, lost, ())) == (
        "l_foot, r_foot lost 3, can0 silences 1, torso 2, joint_0 and 13 more gaps 7"
    )
    assert losses_text(SourceStatus({}, {"l_foot lost": 0}, ())) == ""


def test_rates_that_differ_by_little_are_one_phrase() -> None:
    rates = {name: 84.0 + 0.05 * k for k, name in enumerate(JOINTS)} | {"can0": 1672.0, "imu": 0.0}
    text = rates_text(SourceStatus(rates, {}, ()))
    assert text == "joint_0 and 13 more 84/s, can0 1672/s, imu 0/s"
