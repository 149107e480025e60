# SPDX-License-Identifier: Apache-2.0
"""A recording in a process of its own, to be killed: ROBOT PLAN SESSION SOURCE STARTED.

SOURCE ``virtual`` runs the emulated robot in this process, too: a virtual bus has no other ends.
"""

from __future__ import annotations

import contextlib
import sys
from pathlib import Path

from bus_fault_robot import BUS, LENGTH, SEED

from comcal.cli.main import main
from comcal_drivers.emulator.opening import Options, RunningEmulator


def record(arguments: list[str]) -> int:
    """Record, and return the exit code."""
    robot_yaml, plan, session = map(Path, arguments[:3])
    source, started = arguments[3], bool(int(arguments[4]))
    with contextlib.ExitStack() as stack:
        if source == "virtual":
            options = Options(
                robot_yaml, plan=plan, seed=SEED, rate=0.0, length=LENGTH, slot=0, started=started
            )
            bus = stack.enter_context(RunningEmulator(options))[BUS]
            text = robot_yaml.read_text("utf-8").replace('"nowhere"', f'"{bus["channel"]}"')
            robot_yaml = robot_yaml.with_name("virtual.yaml")
            if not robot_yaml.exists():
                robot_yaml.write_text(text, "utf-8")
            source = "can"
        words = ["record", str(robot_yaml), "-s", str(session), "--source", source]
        words += ["--poses", str(plan), "--still-sd", "4", "--still-window", "0.2"]
        words += ["--timeout", "1.5"]
        if source == "can":
            words += ["--commander", "emulated", "--yes"]
        return main(words)


if __name__ == "__main__":
    sys.exit(record(sys.argv[1:]))
