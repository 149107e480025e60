# SPDX-License-Identifier: Apache-2.0
"""From a still window to the cells of its row in ``poses.csv``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from comcal.measure.average import WindowMean, average
from comcal.measure.columns import CHANNELS
from comcal.measure.plan import PlannedPose
from comcal.measure.source import Block
from comcal.robot.model import Robot
from comcal.robot.tree import Array

NOT_MOVED = 1e-6
"""Planned positions closer than this [rad] or [m] are the same."""

DIGITS = 6
"""Significant digits of standard errors, deviations and slopes."""

IMU_AXES = ("ax", "ay", "az")


def cut(block: Block, window: slice) -> Block:
    """Return some consecutive samples of *block*."""
    temperatures = block.temperatures
    return replace(
        block,
        t=block.t[window],
        q=block.q[window],
        wrenches={name: w[window] for name, w in block.wrenches.items()},
        torques=None if block.torques is None else block.torques[window],
        currents=None if block.currents is None else block.currents[window],
        imu=None if block.imu is None else block.imu[window],
        temperatures=None
        if temperatures is None
        else {k: v[window] for k, v in temperatures.items()},
    )


def join(blocks: Sequence[Block]) -> Block:
    """Return consecutive blocks of one source as one block."""
    first = blocks[0]

    def channels(name: str) -> Array | None:
        parts = [getattr(block, name) for block in blocks]
        return None if any(part is None for part in parts) else np.concatenate(parts)

    temperatures = first.temperatures
    return Block(
        t=np.concatenate([block.t for block in blocks]),
        q=np.concatenate([block.q for block in blocks]),
        wrenches={n: np.concatenate([b.wrenches[n] for b in blocks]) for n in first.wrenches},
        torques=channels("torques"),
        currents=channels("currents"),
        imu=channels("imu"),
        temperatures=temperatures
        and {n: np.concatenate([(b.temperatures or {})[n] for b in blocks]) for n in temperatures},
    )


def approaches(
    pose: PlannedPose, previous: PlannedPose | None, joint_names: Sequence[str]
) -> dict[str, int | None]:
    """Return from which side each joint came: +1 q was increasing, -1, 0 not moved, None unknown.

    Parameters
    ----------
    pose, previous : PlannedPose
        Where the robot was sent now and before; None when it stood somewhere unknown. What the
        plan demands of the commander counts more than the difference of the two.
    joint_names : sequence of str
        In the order of ``q``.
    """
    found: dict[str, int | None] = {}
    for k, joint in enumerate(joint_names):
        if joint in pose.approach:
            found[joint] = pose.approach[joint]
        elif previous is None:
            found[joint] = None
        else:
            step = float(pose.q[k] - previous.q[k])
            found[joint] = 0 if abs(step) < NOT_MOVED else int(np.sign(step))
    return found


def pose_row(
    pose: PlannedPose,
    window: Block,
    robot: Robot,
    approach: Mapping[str, int | None],
    *,
    with_floor: bool,
    with_revisit: bool = False,
) -> dict[str, object]:
    """Return the row of one pose.

    Parameters
    ----------
    pose : PlannedPose
    window : Block
        The samples of the still window only.
    robot : Robot
    approach : mapping from joint name to int or None
    with_floor : bool
        Whether the plan has slopes, hence the table the columns ``floor.roll``, ``floor.pitch``.
    with_revisit : bool
        Whether the plan has repeats, hence the table the column ``revisit``.

    Returns
    -------
    dict from column name to cell
        The same columns, in the same order, for every pose of one robot, plan and source. A
        channel with a sample that is not finite has empty cells.
    """
    joints = robot.tree.joint_names
    row: dict[str, object] = {
        "pose": pose.pose,
        "configuration": pose.configuration,
        "tilt": pose.tilt,
        "support": pose.support,
    }
    if with_revisit:
        row["revisit"] = pose.revisit
    if with_floor:
        row |= {"floor.roll": pose.floor_roll, "floor.pitch": pose.floor_pitch}
    row |= {f"approach.{joint}": approach[joint] for joint in joints}
    instruments = _instruments(window, robot)
    means = {names: average(window.t, values) for names, values in instruments.items()}
    row["t"] = float(window.t.mean())
    row["n"] = _effective_samples(means)
    for names, mean in means.items():
        row |= _cells("", names, mean.mean)
    for names, mean in means.items():
        row |= _cells("se.", names, _rounded(mean.standard_error))
    for prefix, field in (("sd.", "sd"), ("slope.", "slope")):
        for names, mean in means.items():
            if names[0].startswith("ft."):
                row |= _cells(prefix, names, _rounded(getattr(mean, field)))
    return row


def _instruments(window: Block, robot: Robot) -> dict[tuple[str, ...], Array]:
    """Return the samples of each instrument, shape (n, k), by the names of its columns."""
    joints = robot.tree.joint_names
    found: dict[tuple[str, ...], Array] = {
        (f"temperature.{name}",): degrees[:, None]
        for name, degrees in (window.temperatures or {}).items()
    }
    found[tuple(f"q.{joint}" for joint in joints)] = window.q
    for name, wrench in window.wrenches.items():
        found[tuple(f"ft.{name}.{channel}" for channel in CHANNELS)] = wrench
    if window.torques is not None:
        found[tuple(f"tau.{joint}" for joint in joints)] = window.torques
    if window.currents is not None:
        found[tuple(f"i.{joint}" for joint in joints)] = window.currents
    if window.imu is not None:
        found[tuple(f"imu.{axis}" for axis in IMU_AXES)] = window.imu
    return found


def _effective_samples(means: Mapping[tuple[str, ...], WindowMean]) -> int:
    """Return the effective number of samples of the wrenches, of everything without any."""
    wrenches = [m.effective_n for names, m in means.items() if names[0].startswith("ft.")]
    return round(min(wrenches or [mean.effective_n for mean in means.values()]))


def _cells(prefix: str, names: Sequence[str], values: Array) -> dict[str, object]:
    return {f"{prefix}{name}": float(x) for name, x in zip(names, values, strict=True)}


def _rounded(values: Array) -> Array:
    return np.array([float(f"{x:.{DIGITS}g}") for x in values])
