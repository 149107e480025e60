# SPDX-License-Identifier: Apache-2.0
"""Readings spoilt after the sensor: limits, grids and stuck values, and mistakes of wiring.

Order: saturation, grid, stuck; then swaps, signs, units, axes, left and right, as software sees
what the electronics deliver.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from comcal.measure.source import Block
from comcal.robot.changes import IMU, Change, channels_of, target_kind
from comcal.robot.changes_table import CHANNELS, IMU_CHANNELS
from comcal.robot.model import Robot
from comcal.robot.tree import Array

_LIMITS = ("saturation", "quantisation", "frozen_sensor")
_WIRING = ("channel_swap", "sign_flip", "unit_error", "frame_handedness", "left_right_swap")
_FIELDS = {"q": "q", "i": "currents", "tau": "torques"}

Place = tuple[str, str]
"""Target and channel."""


class Mistakes:
    """All of them, applied to the samples of one robot.

    Parameters
    ----------
    robot : Robot
    changes : sequence of Change
    """

    def __init__(self, robot: Robot, changes: Sequence[Change]) -> None:
        self._robot = robot
        self._kinds = {id(c): target_kind(c, robot) for c in changes}
        self._limits = [c for c in changes if c.effect in _LIMITS]
        self._wiring = [c for c in changes if c.effect in _WIRING]
        self._nonlinear_imu = sum(
            c.number("amplitude")
            for c in changes
            if c.effect == "unknown" and c.words("function") == ("imu_curvature",)
        )
        self._pose = 0
        self._stuck = dict[Place, float]()
        self._last = dict[Place, float]()

    def begin(self, pose: int) -> None:
        """Note that the samples of another pose follow.

        Parameters
        ----------
        pose : int
            Its id.
        """
        self._pose = pose
        self._stuck = dict(self._last)

    def spoil(self, block: Block) -> Block:
        """Return the samples as they are recorded."""
        values = self._unpacked(block)
        if self._nonlinear_imu:
            for channel in IMU_CHANNELS:
                here = (IMU, channel)
                values[here] = values[here] + self._nonlinear_imu * values[here] ** 2
        for change in self._limits:
            for place in self._places(change):
                if place in values:
                    values[place] = self._limited(change, place, values[place])
        for change in self._wiring:
            self._rewire(change, values)
        return self._packed(block, values)

    def _limited(self, change: Change, place: Place, samples: Array) -> Array:
        if change.effect == "saturation":
            level = change.number("level")
            return np.clip(samples, -level, level)
        if change.effect == "quantisation":
            step = change.number("step")
            return np.round(samples / step) * step
        poses = change.poses()
        if poses is None or self._pose in poses:
            samples = np.full_like(samples, self._stuck.setdefault(place, float(samples[0])))
        self._last[place] = float(samples[-1])
        return samples

    def _rewire(self, change: Change, values: dict[Place, Array]) -> None:
        effect, target = change.effect, change.target
        if effect in ("sign_flip", "unit_error"):
            factor = -1.0 if effect == "sign_flip" else change.number("factor")
            self._scale(values, self._places(change), factor)
        elif effect == "frame_handedness":
            axis = change.words("axis")[0]
            places = [place for place in self._places(change) if place[1].endswith(axis)]
            self._scale(values, places, -1.0)
        elif change.words("other"):
            for _, channel in self._places(change):
                _swap(values, (target, channel), (change.words("other")[0], channel))
        else:
            first, second = change.words("channels")
            _swap(values, (target, first), (target, second))

    def _places(self, change: Change) -> list[Place]:
        channels = change.words("channels") or channels_of(self._kinds[id(change)])
        return [(change.target, channel) for channel in channels]

    @staticmethod
    def _scale(values: dict[Place, Array], places: Sequence[Place], factor: float) -> None:
        for place in places:
            if place in values:
                values[place] = factor * values[place]

    def _unpacked(self, block: Block) -> dict[Place, Array]:
        """Return every channel that a change may concern by its place."""
        values = {
            (sensor, channel): wrench[:, i]
            for sensor, wrench in block.wrenches.items()
            for i, channel in enumerate(CHANNELS)
        }
        if block.imu is not None:
            values |= {(IMU, channel): block.imu[:, i] for i, channel in enumerate(IMU_CHANNELS)}
        for channel, name in _FIELDS.items():
            samples: Array | None = getattr(block, name)
            if samples is not None:
                names = self._robot.tree.joint_names
                values |= {(joint, channel): samples[:, i] for i, joint in enumerate(names)}
        return values

    def _packed(self, block: Block, values: Mapping[Place, Array]) -> Block:
        joints = {
            name: np.column_stack([values[j, channel] for j in self._robot.tree.joint_names])
            for channel, name in _FIELDS.items()
            if getattr(block, name) is not None
        }
        imu = None
        if block.imu is not None:
            imu = np.column_stack([values[IMU, channel] for channel in IMU_CHANNELS])
        wrenches = {
            sensor: np.column_stack([values[sensor, channel] for channel in CHANNELS])
            for sensor in block.wrenches
        }
        return replace(block, wrenches=wrenches, imu=imu, **joints)


def _swap(values: dict[Place, Array], one: Place, other: Place) -> None:
    if one in values and other in values:
        values[one], values[other] = values[other], values[one]
