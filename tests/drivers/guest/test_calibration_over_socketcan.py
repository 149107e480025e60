# SPDX-License-Identifier: Apache-2.0
"""A biped calibrated over a real SocketCAN gives what the simulation gives, up to the last bit.

Once over the kernel's slcan, with an adapter on a pseudo-terminal, and once over vcan.
"""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

MOVED = ("--commander", "emulated", "--yes")
STEP = {"ft": 0.5, "q": 2 * np.pi / 65536 / 80, "i": 1e-3}
"""Largest steps of the devices: forces and moments [N, N m], angles [rad], currents [A]."""
LONGEST_WAIT = 20.0


@contextmanager
def slcan_driver(port: str, interface: str) -> Iterator[None]:
    """Let the kernel drive a serial-line adapter at 1 Mbit/s."""
    with subprocess.Popen(["slcand", "-F", "-o", "-c", "-s8", port, interface]) as driver:
        try:
            ends = time.monotonic() + LONGEST_WAIT
            while interface not in {name for _, name in socket.if_nameindex()}:
                assert time.monotonic() < ends, "the kernel made no interface of the adapter"
                time.sleep(0.01)
            subprocess.run(["ip", "link", "set", interface, "up"], check=True, timeout=10)
            yield
        finally:
            driver.terminate()
            driver.wait(LONGEST_WAIT)


def check_like(found, wanted) -> None:
    """See that two sessions hold the same, up to the devices' steps."""
    (header, over_bus), (names, direct) = found, wanted
    shared = [name for name in names if name in header and name.startswith(tuple(STEP))]
    assert {name.partition(".")[0] for name in shared} == set(STEP)
    for name in shared:
        a, b = over_bus[:, header.index(name)], direct[:, names.index(name)]
        step = STEP[name.partition(".")[0]]
        np.testing.assert_allclose(a, b, atol=0.51 * step, err_msg=name)
        assert name.startswith("q") or not np.array_equal(a, b), f"{name} was not quantised"


def check_replayed(robot, session: Path, robot_yaml: Path, numbers) -> None:
    """See that the log of a session gives the session, to the last bit."""
    replay = robot.record(f"{session.name}_replay", f"replay:{session}", robot_yaml)
    header, live = numbers(session)
    names, again = numbers(replay)
    assert names == header
    np.testing.assert_array_equal(again, live)


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("slcand") is None, reason="no slcand here; see can-utils")
def test_a_calibration_through_the_slcan_driver_of_the_kernel(robot, direct, numbers) -> None:
    there = robot.on("slcan0")
    with (
        robot.emulated(there, "slcan") as adapter,
        slcan_driver(os.path.realpath(str(adapter["channel"])), "slcan0"),
    ):
        session = robot.record("slcan", "can", there, *MOVED)
    check_like(numbers(session), numbers(direct))
    check_replayed(robot, session, there, numbers)


@pytest.mark.slow
def test_a_calibration_over_a_virtual_bus_of_the_kernel(robot, direct, numbers) -> None:
    there = robot.on("vcan0")
    with robot.emulated(there, "socketcan") as node:
        assert node == {"interface": "socketcan", "channel": "vcan0"}
        session = robot.record("vcan", "can", there, *MOVED)
    check_like(numbers(session), numbers(direct))
    check_replayed(robot, session, there, numbers)
