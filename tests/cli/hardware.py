# SPDX-License-Identifier: Apache-2.0
"""A robot on the bench, in a process of its own: ``python hardware.py comcal-arguments...``.

Its source ``bench:PACE,PAUSE`` only measures; a hand moves the robot to whatever pose is asked for,
PAUSE seconds later, with a clock that runs PACE times as fast as ours. Its commander ``motor``
moves it as told.
"""

from __future__ import annotations

import fcntl
import sys
import termios
import time
from importlib.metadata import entry_points
from typing import Any

import numpy as np

from comcal.cli.main import main
from comcal.measure.plan import PlannedPose
from comcal.measure.source import Block, CommanderRequest, SourceRequest, SourceStatus
from comcal.workflow import extensions

RATE = 125.0


class Bench:
    """Both feet carry half of the weight each, while the robot moves more than that."""

    name = "bench 1.0"

    def __init__(self, request: SourceRequest) -> None:
        self.robot, self.plan = request.robot, request.plan
        pace, _, pause = request.argument.partition(",")
        self.pace, self.pause = float(pace or 0.0), float(pause or 0.0)
        self.wanted: tuple[float, np.ndarray] | None = None
        self.t, self.lost = 0.0, 0
        first = self.plan[0].q if self.plan else np.zeros(len(request.robot.tree.joint_names))
        self.q = first - 0.1
        self.goal = self.q.copy()
        self.speed = 1.0
        self.is_commanded = False
        self.rng = np.random.default_rng(2)

    def begin_pose(self, pose: int) -> None:
        wanted = next((p for p in self.plan if p.pose == pose), None)
        if wanted is not None and not self.is_commanded:
            self.wanted = (self.t + self.pause, wanted.q)

    def read(self, duration: float) -> Block:
        if self.pace:
            time.sleep(duration / self.pace)
        if self.wanted is not None and self.t >= self.wanted[0]:
            self.goal, self.wanted = self.wanted[1], None
        n = round(duration * RATE)
        q = np.empty((n, self.q.size))
        for i in range(n):
            way = self.goal - self.q
            longest = float(np.abs(way).max())
            self.q = self.q + way * (min(1.0, self.speed / RATE / longest) if longest else 0.0)
            q[i] = self.q
        t = self.t + np.arange(1, n + 1) / RATE
        self.t = float(t[-1])
        weight = self.robot.tree.total_mass * self.robot.gravity
        wrenches = {}
        for name in self.robot.sensors:
            w = np.zeros((n, 6))
            w[:, 2] = weight / 2
            w[:, 3] = 0.3 * np.abs(q - self.goal).max(axis=1) * weight / 2
            noise = self.rng.standard_normal((n, 6)) * np.repeat([0.3, 0.03], 3)
            wrenches[name] = w + noise
        self.lost += 1
        return Block(t, q, wrenches, temperatures={n: 30.0 + 0.05 * t for n in wrenches})

    def status(self) -> SourceStatus:
        return SourceStatus({"l_foot": RATE}, {"l_foot": self.lost}, ())

    def close(self) -> None:
        self.t = float("nan")


class Motor:
    """Moves the bench at the speed that it was given."""

    def __init__(self, request: CommanderRequest) -> None:
        if not isinstance(request.source, Bench):
            raise TypeError("only the bench has this motor")
        self.bench = request.source
        self.bench.speed, self.bench.is_commanded = request.speed, True

    def move_to(self, pose: PlannedPose) -> None:
        self.bench.goal = pose.q

    def stop(self) -> None:
        self.bench.goal = self.bench.q.copy()

    def close(self) -> None:
        self.stop()


class _Entry:
    def __init__(self, name: str, made: Any) -> None:
        self.name, self.made = name, made

    def load(self) -> Any:
        return self.made


OURS = {"comcal.sources": {"bench": Bench}, "comcal.commanders": {"motor": Motor}}


def found(*, group: str, name: str | None = None) -> list[Any]:
    """Return the bench beside what is really installed."""
    ours = [_Entry(n, made) for n, made in OURS[group].items() if name in (None, n)]
    theirs = entry_points(group=group) if name is None else entry_points(group=group, name=name)
    return [*ours, *theirs]


if __name__ == "__main__":
    if sys.stdin.isatty():  # started in a session of its own: this becomes its terminal
        fcntl.ioctl(0, termios.TIOCSCTTY, 0)
    extensions.entry_points = found  # type: ignore[assignment]
    sys.exit(main())
