# SPDX-License-Identifier: Apache-2.0
"""Is every channel of a live source alive, and as quiet as robot.yaml states?"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum

import numpy as np

from comcal.measure.average import average
from comcal.measure.columns import CHANNELS, FORCES
from comcal.measure.pose_row import IMU_AXES
from comcal.measure.reading import mean_of
from comcal.measure.source import Block
from comcal.measure.still import StillCriterion
from comcal.robot.model import Robot
from comcal.robot.tree import Array, JointType

NOISIER = 3.0
"""A channel is noisy when its standard error is this times what robot.yaml states."""

GAPS = 0.01
"""A channel has gaps when more than this part of its samples is missing."""


class State(Enum):
    """What is wrong with a channel."""

    OK = "ok"
    SILENT = "silent"
    """Not one sample."""
    GAPS = "gaps"
    """Samples are missing."""
    FROZEN = "frozen"
    """An analogue channel that always reads the same."""
    NOISY = "noisy"
    """Noisier than robot.yaml states."""


@dataclass(frozen=True)
class Channel:
    """What one channel read.

    Parameters
    ----------
    name : str
        As its column in poses.csv.
    unit : str
    mean, sd : float
        NaN for a silent channel.
    standard_error : float
        Of the mean of a still window of the usual length, from the scatter seen.
    stated : float
        The same by ``noise`` of robot.yaml; 0: nothing is stated.
    missing : float
        Part of the samples that is not there.
    state : State
    """

    name: str
    unit: str
    mean: float
    sd: float
    standard_error: float
    stated: float
    missing: float
    state: State


def channels_of(block: Block, robot: Robot) -> tuple[Channel, ...]:
    """Judge every channel of a few seconds in which the robot did not move.

    Parameters
    ----------
    block : Block
    robot : Robot
        Its sensors that *block* does not have are silent.
    """
    duration = float(block.t[-1] - block.t[0]) if block.t.size > 1 else 0.0
    return tuple(
        _channel(name, unit, values, block.t, duration, stated, is_analogue)
        for name, unit, values, stated, is_analogue in _signals(block, robot)
    )


def _signals(block: Block, robot: Robot) -> Iterator[tuple[str, str, Array, float, bool]]:
    """Yield name, unit, samples (n,), stated standard error, and whether it must never repeat."""
    n = block.t.size
    noise = robot.noise
    absent = np.full((n, 6), np.nan)
    names = [*robot.sensors, *(name for name in block.wrenches if name not in robot.sensors)]
    for sensor in names:
        for k, channel in enumerate(CHANNELS):
            is_force = channel in FORCES
            stated = noise.ft_force if is_force else noise.ft_moment
            values = block.wrenches.get(sensor, absent)[:, k]
            yield f"ft.{sensor}.{channel}", "N" if is_force else "N m", values, stated, True
    tree = robot.tree
    for k, joint in enumerate(tree.joint_names):
        slides = tree.joints[tree.joint_index[joint]].kind is JointType.PRISMATIC
        yield f"q.{joint}", "m" if slides else "rad", block.q[:, k], noise.encoder, False
    for k, joint in enumerate(tree.joint_names):
        if block.currents is not None and joint in robot.motors:
            yield f"i.{joint}", "A", block.currents[:, k], noise.current, False
        if block.torques is not None and np.isfinite(block.torques[:, k]).any():
            yield f"tau.{joint}", "N m", block.torques[:, k], noise.torque, False
    if robot.imu_link is not None:
        imu = np.full((n, 3), np.nan) if block.imu is None else block.imu
        for k, axis in enumerate(IMU_AXES):
            yield f"imu.{axis}", "m/s^2", imu[:, k], noise.imu, True
    for sensor, values in (block.temperatures or {}).items():
        yield f"temperature.{sensor}", "degC", values, 0.0, False


def _channel(
    name: str, unit: str, values: Array, t: Array, duration: float, stated: float, analogue: bool
) -> Channel:
    is_there = np.isfinite(values)
    missing = 1.0 - float(is_there.mean()) if values.size else 1.0
    if missing >= 1.0:
        nothing = float("nan")
        return Channel(name, unit, nothing, nothing, nothing, stated, missing, State.SILENT)
    there = values[is_there]
    found = average(t[is_there], there[:, None])
    window = StillCriterion().window
    # The scatter of a short window, from the whole time that was read.
    error = float(found.standard_error[0]) * float(np.sqrt(max(duration / window, 1.0)))
    sd = float(found.sd[0])
    state = State.OK
    if analogue and there.size > 1 and float(np.ptp(there)) == 0.0:
        state = State.FROZEN
    elif missing > GAPS:
        state = State.GAPS
    elif stated > 0.0 and error > NOISIER * stated:
        state = State.NOISY
    return Channel(
        name, unit, float(mean_of(values[:, None])[0]), sd, error, stated, missing, state
    )
