# SPDX-License-Identifier: Apache-2.0
"""Force sensors that stop: all their channels repeat to the last digit while the robot moves.

A saturated converter or a lost bus message leaves the last reading standing. Its average looks
better than any other, so it must not be averaged; what else was measured meanwhile is good.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from comcal.measure.columns import Family, known_columns
from comcal.measure.logger_table import LoggerTable
from comcal.robot.model import Robot
from comcal.robot.tree import Array

FEWEST_REPEATS = 5
"""Samples that must repeat: coarse converters repeat a few by chance."""


@dataclass(frozen=True)
class Stuck:
    """When a sensor stood still in a log of a moving robot.

    Parameters
    ----------
    sensor : str
        Or plate.
    samples : array of bool, shape (n,)
    stretches : tuple of (start, end)
        [s].
    """

    sensor: str
    samples: npt.NDArray[np.bool_]
    stretches: tuple[tuple[float, float], ...]

    @property
    def note(self) -> str:
        """What was found, in one sentence."""
        lengths = [end - start for start, end in self.stretches]
        start, end = self.stretches[int(np.argmax(lengths))]
        times = "time" if len(lengths) == 1 else "times"
        return (
            f"{self.sensor} repeats its samples for {sum(lengths):.1f} s ({len(lengths)} {times}, "
            f"longest {start:.2f} s to {end:.2f} s): masked"
        )


def stuck_sensors(log: LoggerTable, robot: Robot, t: Array, least: float) -> tuple[Stuck, ...]:
    """Find the stretches in which all varying channels of a force sensor repeat.

    Parameters
    ----------
    log : LoggerTable
        Of a robot that moves.
    robot : Robot
    t : array, shape (n,)
        [s].
    least : float
        Shorter stretches are let pass [s].
    """
    found: list[Stuck] = []
    for sensor, channels in _varying_channels(log, robot).items():
        repeats = np.all(np.diff(channels, axis=0) == 0.0, axis=1)
        samples = np.zeros(t.size, dtype=np.bool_)
        stretches: list[tuple[float, float]] = []
        edges = np.flatnonzero(np.diff(np.concatenate([[False], repeats, [False]])))
        for a, b in list(pairwise(edges))[::2]:
            if b - a >= FEWEST_REPEATS and t[b] - t[a] >= least * (1.0 - 1e-9):
                samples[a : b + 1] = True
                stretches.append((float(t[a]), float(t[b])))
        if stretches:
            found.append(Stuck(sensor, samples, tuple(stretches)))
    return tuple(found)


def masked(log: LoggerTable, robot: Robot, stuck: tuple[Stuck, ...]) -> LoggerTable:
    """Return the log with empty cells where a force sensor stood still."""
    known = known_columns(robot)
    numbers = dict(log.numbers)
    for one in stuck:
        for name, values in log.numbers.items():
            if known[name].family is Family.WRENCH and known[name].target == one.sensor:
                numbers[name] = np.where(one.samples, np.nan, values)
    return replace(log, numbers=numbers)


def _varying_channels(log: LoggerTable, robot: Robot) -> Mapping[str, Array]:
    """Return the channels of each sensor that are not constant from end to end."""
    known = known_columns(robot)
    channels: dict[str, list[Array]] = {}
    for name, values in log.numbers.items():
        there = values[np.isfinite(values)]
        if known[name].family is Family.WRENCH and there.size and np.ptp(there) > 0.0:
            channels.setdefault(known[name].target, []).append(values)
    return {sensor: np.column_stack(found) for sensor, found in channels.items()}
