# SPDX-License-Identifier: Apache-2.0
"""``python -m comcal_drivers.emulator ROBOT.yaml``: an emulated robot as a process of its own.

The first line on stdout is a JSON object that says how to reach it; then nothing more is printed
there. It ends on SIGTERM, and when the process that started it is gone.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from comcal.errors import ComcalError
from comcal_drivers.emulator.faults import EXAMPLE, KINDS, fault_from
from comcal_drivers.emulator.opening import ADAPTERS, Options, opened
from comcal_drivers.emulator.parent import Leash

PROCESS_ADAPTERS = tuple(name for name in ADAPTERS if name != "virtual")


def serve(arguments: Sequence[str], leash: Leash) -> int:
    """Emulate until called off; return the exit code.

    Parameters
    ----------
    arguments : sequence of str
        Of the command line, without the program.
    leash : Leash
    """
    try:
        options = options_from(arguments)
        leash.hold()
        with opened(options, _complain) as emulator:
            ready = {"buses": emulator.connections, "pid": os.getpid()}
            sys.stdout.write(json.dumps(ready) + "\n")
            sys.stdout.flush()
            emulator.server.run(lambda: leash.is_called)
    except ComcalError as error:
        _complain(str(error))
        return error.exit_code
    return 0


def options_from(arguments: Sequence[str]) -> Options:
    """Return what the command line says.

    Raises
    ------
    ConfigError
        If a fault cannot be understood.
    """
    given = _parser().parse_args(arguments)
    # Who watches should not be told that thousands of samples were lost at every pose.
    slot = given.slot if given.slot is not None else 0 if given.rate > 0.0 else Options.slot
    return Options(
        robot_yaml=given.robot_yaml,
        adapter=given.adapter,
        source=given.source,
        plan=given.plan,
        seed=given.seed,
        noise=not given.no_noise,
        effects=tuple(given.effect),
        rate=given.rate,
        length=given.length,
        slot=slot,
        started=given.started,
        pose=given.pose,
        move_time=given.move_time,
        fifo=given.fifo,
        ports=given.ports,
        faults=tuple(fault_from(text) for text in given.fault),
        truth=given.truth,
    )


def _parser() -> argparse.ArgumentParser:
    default = Options(Path())
    parser = argparse.ArgumentParser(
        prog="python -m comcal_drivers.emulator",
        description="Emulate the robot of a robot.yaml behind a CAN adapter. Prints one line of "
        "JSON that says how to reach it; ends on SIGTERM or with its parent.",
        epilog="example: python -m comcal_drivers.emulator robot.yaml --adapter socketcand "
        f"--rate 0 --fault {EXAMPLE} --truth truth.jsonl",
    )
    add = parser.add_argument
    add("robot_yaml", type=Path, metavar="ROBOT.yaml")
    add("--adapter", choices=PROCESS_ADAPTERS, default=default.adapter)
    add("--source", default=default.source, help="what is measured: builtin, pybullet, mujoco")
    add("--plan", type=Path, help="poses it knows; default: plan.csv beside ROBOT.yaml")
    add("--seed", type=int, default=default.seed, help="of the simulated noise")
    add("--no-noise", action="store_true", help="leave out the noise of the simulated source")
    add("--effect", action="append", default=[], help="hide an effect, as comcal record does")
    add("--rate", type=float, default=default.rate, help="times real time; 0: as fast as it goes")
    add("--length", type=float, help="seconds of a pose that are sent; default: no end, or 5")
    add(
        "--slot",
        type=int,
        help=f"samples between the counters of two poses; default: they go on, or {default.slot} "
        "if unpaced",
    )
    add("--started", action="store_true", help="devices are started and polled already")
    add(
        "--pose",
        type=int,
        help="where it stands at first; default: the first, or nowhere if unpaced",
    )
    add("--move-time", type=float, default=default.move_time, help="seconds that a move takes")
    add("--fifo", type=int, default=default.fifo, help="frames an slcan adapter holds, then loses")
    add("--ports", type=Path, metavar="DIR", help="where slcan ports appear; default: a new folder")
    add("--fault", action="append", default=[], help=f"{', '.join(KINDS)}; such as {EXAMPLE}")
    add("--truth", type=Path, help="write down what the faults did, as JSON lines")
    return parser


def _complain(text: str) -> None:
    sys.stderr.write(f"emulator: {text}\n")
    sys.stderr.flush()
