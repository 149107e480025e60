# SPDX-License-Identifier: Apache-2.0
"""Tares: what unloaded sensors read, and how they stand in session.yaml."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from comcal.errors import DataError, NotBalancedError, NotFiniteError, NotStillError, UsageError
from comcal.measure.average import average
from comcal.measure.hanging import hanging_wrench, up_of
from comcal.measure.observe import temperatures_of
from comcal.measure.plan import NONE
from comcal.measure.pose_row import cut, join
from comcal.measure.session import Session
from comcal.measure.session_yaml import as_mapping
from comcal.measure.source import Block, Source
from comcal.measure.still import StillCriterion, judge_stillness
from comcal.measure.waiting import STEP, read_samples
from comcal.robot.model import Robot
from comcal.robot.tree import Array

LOADED = 0.15
"""A force that is left of more than this part of the robot's weight is a load, no offset."""
LOADED_WITHOUT_WEIGHT = 100.0
"""The same where the weight is not known [N]."""
DIGITS = 9
"""Significant digits in session.yaml."""


@dataclass(frozen=True)
class Tare:
    """The unloaded reading of one sensor.

    Parameters
    ----------
    sensor : str
    value, sigma : array, shape (6,)
        Force, moment [N, N m] in and about the sensor frame, in the sensor's own sense; sigma is
        the standard error of ``value``.
    t : float
        Middle of the window, in the clock of the source [s].
    temperature : float or None
        Of the sensor [deg C].
    hangs : array, shape (6,) or None
        The weight that was given back; None: nothing hung below the cut.
    up : str
        How up was known; empty where it did not matter.
    """

    sensor: str
    value: Array
    sigma: Array
    t: float
    temperature: float | None = None
    hangs: Array | None = None
    up: str = ""


def still_window(
    robot: Robot, source: Source, sensors: Sequence[str], seconds: float, timeout: float
) -> Block:
    """Read until joints and some sensors were still for a while.

    Parameters
    ----------
    robot : Robot
    source : Source
    sensors : sequence of str
        Others may be loaded, and do as they like.
    seconds : float
        Length of the window [s].
    timeout : float
        How long to wait for it [s].

    Raises
    ------
    NotStillError
        If there is none.
    DataError
        If a sensor sends nothing.
    """
    criterion = StillCriterion(window=seconds, settle=seconds, timeout=timeout)
    blocks: list[Block] = []
    start = float("nan")
    while True:
        block = read_samples(source, STEP)
        silent = [name for name in sensors if name not in block.wrenches]
        if silent:
            raise DataError(
                f"the source has no readings of {', '.join(silent)}",
                where=source.name,
                next_step="name the others with --sensor, or add it to `sources` of robot.yaml",
            )
        blocks.append(replace(block, wrenches={name: block.wrenches[name] for name in sensors}))
        start = float(block.t[0]) if len(blocks) == 1 else start
        newest = float(block.t[-1])
        blocks = [b for b in blocks if float(b.t[-1]) > newest - seconds - 2.0 * STEP]
        joined = join(blocks)
        judged = judge_stillness(joined, robot, NONE, criterion)
        if judged.window is not None:
            return cut(joined, judged.window)
        if newest - start >= timeout:
            raise NotStillError(
                f"the robot was not still for {seconds:g} s",
                where=source.name,
                measured=judged.reason,
                next_step="let it hang until it no longer swings, and touch nothing; or average "
                "less with --seconds",
            )


def tares_of(
    window: Block, robot: Robot, support: str, *, hanging: bool, limit: float | None = None
) -> tuple[Tare, ...]:
    """Return the tare of every sensor in *window*.

    Parameters
    ----------
    window : Block
        Still, and only of sensors that are unloaded.
    robot : Robot
    support : str
        ``none`` or the foot that stands.
    hanging : bool
        Whether the links below the cuts hang from the sensors, to be given back their weight.
    limit : float or None
        Largest force that may be left [N]; None: a part of the robot's weight.

    Raises
    ------
    NotFiniteError
        If a channel has no value.
    NotBalancedError
        If a sensor is loaded.
    DataError
        If the IMU does not read gravity.
    UsageError
        If the base is below a cut.
    """
    q = window.q.mean(axis=0)
    up = up_of(robot, q, None if window.imu is None else window.imu.mean(axis=0), support)
    temperatures = temperatures_of(window)
    found: list[Tare] = []
    for sensor, samples in window.wrenches.items():
        mean = average(window.t, samples)
        if not np.isfinite(mean.mean).all():
            raise NotFiniteError(
                "some channels have no value",
                where=f"sensor {sensor}",
                next_step="look at what it sends with comcal check --live",
            )
        value, variance = mean.mean, mean.standard_error**2
        hangs: Array | None = None
        if hanging:
            hangs, sigma = hanging_wrench(robot, sensor, q, up)
            value, variance = value - hangs, variance + sigma**2
        _refuse_load(robot, sensor, value, limit)
        found.append(
            Tare(
                sensor,
                value,
                np.sqrt(variance),
                float(window.t.mean()),
                temperatures.get(sensor),
                hangs,
                up.source if hanging else "",
            )
        )
    return tuple(found)


def _refuse_load(robot: Robot, sensor: str, value: Array, limit: float | None) -> None:
    weight = robot.tree.total_mass * robot.gravity
    if limit is None:
        limit = LOADED * weight if np.isfinite(weight) else LOADED_WITHOUT_WEIGHT
    size = float(np.linalg.norm(value[:3]))
    if size > limit:
        raise NotBalancedError(
            "is loaded, or its offset is larger than any that is believed without asking",
            where=f"sensor {sensor}",
            measured=f"{size:.1f} N",
            limit=f"{limit:.1f} N",
            next_step="lift the foot off the ground; if it hangs free already, give --limit "
            f"{np.ceil(1.2 * size):.0f}",
        )


def store_tares(session: Session, tares: Sequence[Tare], *, again: bool) -> None:
    """Write tares into session.yaml; what stood there goes to ``tare_history``.

    Parameters
    ----------
    session : Session
    tares : sequence of Tare
    again : bool
        Whether older tares may be replaced.

    Raises
    ------
    UsageError
        If there are older ones, which must not.
    """
    with session.lock():
        known = session.metadata
        before = {str(k): v for k, v in as_mapping(known.get("tare")).items()}
        older = [tare.sensor for tare in tares if tare.sensor in before]
        if older and not again:
            raise UsageError(
                f"there is a tare of {', '.join(older)} already",
                where=str(session.session_yaml),
                next_step="give --again to use the new one for all poses of this session; the old "
                "one is kept in tare_history",
            )
        history = known.get("tare_history")
        past = list(cast("list[object]", history)) if isinstance(history, list) else []
        poses = len(session.finished_poses())
        for sensor in older:
            past.append({"sensor": sensor, "until_pose_count": poses, **_entry(before[sensor])})
        entries: dict[str, object] = {"tare": {**before, **{t.sensor: _data(t) for t in tares}}}
        if past:
            entries["tare_history"] = past
        session.update(**entries)


def _entry(value: object) -> dict[str, object]:
    return {str(k): v for k, v in as_mapping(value).items()}


def _data(tare: Tare) -> Mapping[str, object]:
    data: dict[str, object] = {
        "value": _rounded(tare.value),
        "sigma": _rounded(tare.sigma),
        "t": float(f"{tare.t:.{DIGITS}g}"),
    }
    if tare.temperature is not None:
        data["temperature"] = float(f"{tare.temperature:.6g}")
    if tare.hangs is not None:
        data["given_back"] = _rounded(tare.hangs)
        data["up"] = tare.up
    return data


def _rounded(values: Array) -> list[float]:
    return [float(f"{x:.{DIGITS}g}") for x in values.tolist()]
