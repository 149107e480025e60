# SPDX-License-Identifier: Apache-2.0
"""``comcal check`` says what ``sources:`` means before anybody goes to the robot."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from comcal.cli.main import main
from comcal_sims.robots import table1

SOURCES = """
sources:
  can:
    buses:
      can0: {interface: slcan, channel: /dev/serial/by-id/usb-a, bitrate: 250000}
    sensors:
      l_foot: {bus: can0, device: DEVICE, ids: {id: 0x70}}
    joints: {}
    clock: l_foot
  bag: {topics: {l_foot: /ft/left, imu: null}}
"""


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    return table1.generate(tmp_path)


def described(robot: Path, sources: str) -> Path:
    robot.write_text(robot.read_text("utf-8") + sources, "utf-8")
    return robot


def test_sources_are_told_without_opening_them(
    robot: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    described(robot, SOURCES.replace("DEVICE", "jr3_uc3m"))
    assert main(["check", str(robot), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["sources"] == {
        "can": [
            "can0 (slcan /dev/serial/by-id/usb-a, 250 kbit/s): l_foot jr3_uc3m",
            "rows are the samples of l_foot",
        ],
        "bag": [
            "l_foot: /ft/left",
            "imu: not read",
            "other channels are found by type and name",
        ],
    }
    assert main(["check", str(robot)]) == 0
    assert "l_foot jr3_uc3m" in capsys.readouterr().out


def test_a_device_that_does_not_exist_is_refused_with_its_line(
    robot: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    described(robot, SOURCES.replace("DEVICE", "jr3_uc3n"))
    line = (
        robot.read_text("utf-8")
        .splitlines()
        .index("      l_foot: {bus: can0, device: jr3_uc3n, ids: {id: 0x70}}")
        + 1
    )
    assert main(["check", str(robot)]) == 2
    error = capsys.readouterr().err
    assert f"robot.yaml:{line}" in error
    assert "jr3_uc3m" in error


def test_a_source_that_nobody_knows_is_a_warning(
    robot: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    described(robot, "\nsources: {cam: {}}\n")
    assert main(["check", str(robot)]) == 0
    said = capsys.readouterr().out
    assert "sources.cam: there is no source 'cam'; did you mean can?" in said
