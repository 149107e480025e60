# SPDX-License-Identifier: Apache-2.0
"""What the adapter noted in a log is told again when the log is replayed."""

from __future__ import annotations

from pathlib import Path

import pytest

from comcal.measure.source import SourceRequest
from comcal.robot.description import load_robot
from comcal_drivers.bus.error_frames import BUS_OFF, error_frame, gap_marker
from comcal_drivers.frames.frame_log import FrameLog
from comcal_drivers.source.replay import open_replay
from comcal_sims.robots import table1

SOURCES = """
sources:
  can:
    buses: {can0: {interface: virtual, channel: x}}
    sensors: {l_foot: {bus: can0, device: iit_strain}}
"""


def test_bus_off_errors_and_gaps_of_a_log_are_counted(tmp_path: Path) -> None:
    yaml = table1.generate(tmp_path)
    yaml.write_text(yaml.read_text("utf-8") + SOURCES, "utf-8")
    log = tmp_path / "frames.log"
    with FrameLog(log) as file:
        for batch in (error_frame(1.0, BUS_OFF), error_frame(1.1, 0x8), gap_marker(1.2)):
            file.write(batch, "can0")
    robot = load_robot(yaml)
    request = SourceRequest(robot, 0, argument=str(log))
    with open_replay(request) as source:
        with pytest.raises(Exception, match="no samples"):
            source.read(1.0)
        lost = source.status().lost
    told = {name: count for name, count in lost.items() if name.startswith("can0 ")}
    assert told == {"can0 bus offs": 1, "can0 error frames": 3, "can0 gaps": 1}
