# SPDX-License-Identifier: Apache-2.0
"""An emulated robot behind each of the ways on which its frames come."""

from __future__ import annotations

import contextlib
import json
import threading
from collections.abc import Callable, Generator, Mapping
from pathlib import Path

from bus_fault_draw import Scenario
from bus_fault_robot import BUS, LENGTH, SEED, SmallRobot, packed, ticks

from comcal.errors import HardwareError
from comcal_drivers.bus.error_frames import BUS_OFF, error_frame, gap_marker
from comcal_drivers.emulator.faults import fault_from
from comcal_drivers.emulator.frame import Frame
from comcal_drivers.emulator.injector import Injector
from comcal_drivers.emulator.opening import Options, opened
from comcal_drivers.emulator.robot import state_frame
from comcal_drivers.emulator.truth import TruthLog
from comcal_drivers.frames.frame_log import FrameLog

OPENING_TIME = 30.0
JOIN_TIME = 10.0
DAY = 1.7e9
"""When a log was written [s since 1970]."""

Truths = list[dict[str, object]]


@contextlib.contextmanager
def emulated(
    robot: SmallRobot, adapter: str, scenario: Scenario, truth: Path
) -> Generator[Mapping[str, object]]:
    """Run the emulator in a thread; yield how its bus is reached."""
    options = Options(
        robot.yaml,
        adapter=adapter,
        plan=robot.plan_path,
        seed=SEED,
        rate=scenario.rate,
        length=LENGTH,
        slot=0,
        started=not scenario.asked,
        faults=tuple(fault_from(text) for text in scenario.faults),
        truth=truth,
    )
    over, ready = threading.Event(), threading.Event()
    found: list[Mapping[str, object]] = []
    errors: list[BaseException] = []

    def run() -> None:
        try:
            with opened(options, lambda text: None) as emulator:
                found.append(emulator.connections[BUS])
                ready.set()
                emulator.server.run(over.is_set)
        except BaseException as error:  # noqa: BLE001 - raised in the thread that waits
            errors.append(error)
        finally:
            ready.set()

    thread = threading.Thread(target=run, name="emulator", daemon=True)
    thread.start()
    try:
        ready.wait(OPENING_TIME)
        if errors:
            raise errors[0]
        yield found[0]
    finally:
        over.set()
        thread.join(JOIN_TIME)
    if errors:
        raise errors[0]
    if thread.is_alive():
        raise HardwareError("the emulated robot does not stop", where=adapter)


def write_faulty_log(robot: SmallRobot, scenario: Scenario, log: Path, truth: Path) -> None:
    """Write what a reader gets of one tour through the poses in which the faults strike.

    Parameters
    ----------
    robot : SmallRobot
    scenario : Scenario
    log : Path
        New.
    truth : Path
        Takes what was done.
    """
    emulated_robot = robot.emulated()
    layouts = {device.name: device.layout for device in emulated_robot.devices}
    noted = TruthLog(truth)
    faults = [fault_from(text) for text in scenario.faults]
    injector = Injector(BUS, faults, layouts, noted)
    log.parent.mkdir(parents=True, exist_ok=True)
    with FrameLog(log) as file:
        for pose in robot.plan:
            move = emulated_robot.take(pose.pose)
            injector.begin(pose.pose)
            t = 0.0
            arrived = state_frame(pose.pose, move.state, injector.announced("l_foot", move.count))
            waiting = [arrived]
            for tick in ticks(emulated_robot):
                t = tick.t
                for item in injector.inject(tick.frames[BUS]):
                    if isinstance(item, Frame):
                        waiting.append(item)
                        continue
                    file.write(packed(_stamped(waiting, t)), BUS)
                    waiting = []
                    if item.kind == "bus_off":
                        file.write(error_frame(t + DAY, BUS_OFF), BUS)
                    elif item.kind == "disconnect":
                        file.write(gap_marker(t + DAY), BUS)
            waiting += injector.release()
            file.write(packed(_stamped(waiting, t)), BUS)
    noted.close()


def _stamped(frames: list[Frame], t: float) -> list[Frame]:
    """Give frames without a stamp that of a moment, and all of them a date."""
    first = next((frame.t for frame in frames if frame.t), t)
    return [frame._replace(t=(frame.t or first) + DAY) for frame in frames]


def truths(path: Path) -> Truths:
    """Return what the faults did."""
    if not path.exists():
        return []
    return [json.loads(line) for line in path.read_text("utf-8").splitlines()]


@contextlib.contextmanager
def stepping_clock(module: object, by: float, after: Callable[[], bool]) -> Generator[None]:
    """Let the time of day of a module jump once something has happened."""
    import time as real
    from types import SimpleNamespace

    has_jumped = threading.Event()

    def now() -> float:
        if not has_jumped.is_set() and after():
            has_jumped.set()
        return real.time() + by * has_jumped.is_set()

    replaced = SimpleNamespace(**{**vars(real), "time": now})
    original = module.time  # pyright: ignore[reportAttributeAccessIssue]
    module.time = replaced  # pyright: ignore[reportAttributeAccessIssue]
    try:
        yield
    finally:
        module.time = original  # pyright: ignore[reportAttributeAccessIssue]
