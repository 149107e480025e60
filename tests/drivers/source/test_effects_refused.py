# SPDX-License-Identifier: Apache-2.0
"""Effects are hidden in simulated robots only: what has really been measured is left alone."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from comcal.errors import UsageError
from comcal.measure.source import SourceRequest
from comcal.robot.description import load_robot
from comcal_drivers.bags.source import open_bag
from comcal_drivers.source.live import open_can
from comcal_drivers.source.replay import open_replay
from comcal_sims.robots import table1


@pytest.mark.parametrize("open_source", [open_can, open_replay, open_bag])
def test_sources_of_real_measurements_hide_nothing(
    open_source: Callable[[SourceRequest], object], tmp_path: Path
) -> None:
    robot = load_robot(table1.generate(tmp_path))
    request = SourceRequest(robot, 0, argument="x", effects=("payload@torso:mass=1",))
    with pytest.raises(UsageError, match=r"--effect.*simulated"):
        open_source(request)
