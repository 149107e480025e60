# SPDX-License-Identifier: Apache-2.0
"""The wrench columns of ``poses.csv``: tares subtracted, senses resolved, covariances assembled."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import numpy.typing as npt

from comcal.errors import ConfigError, DataError, MissingColumnError, NotFiniteError
from comcal.measure.columns import CHANNELS, Family, channel_noise, near_miss, wrench_names
from comcal.measure.plan import DOUBLE
from comcal.measure.pose_cells import PoseCells
from comcal.measure.uncertainty import Variances, variances
from comcal.measure.variance import assemble_covariance
from comcal.robot.model import Robot, Sense
from comcal.robot.tree import Array

Tares = Mapping[str, tuple[npt.ArrayLike, npt.ArrayLike]]
"""Sensor name to value (6,) and standard error (6,) [N, N m], as the sensor reports them."""


@dataclass(frozen=True)
class WrenchColumns:
    """Wrenches, ground on robot, with their covariances and the shared one of the tare.

    Parameters
    ----------
    wrench : mapping from name to array, shape (N, 6)
    cov : mapping from name to array, shape (N, 6, 6)
    tare_cov : mapping from name to array, shape (6, 6)
    notes : tuple of str
    """

    wrench: Mapping[str, Array]
    cov: Mapping[str, Array]
    tare_cov: Mapping[str, Array]
    notes: tuple[str, ...]


def read_wrenches(
    cells: PoseCells, support: tuple[str, ...], repeats: tuple[str, ...], tares: Tares
) -> WrenchColumns:
    """Read the wrench of every sensor and plate that has columns.

    Parameters
    ----------
    cells : PoseCells
    support : tuple of str, length N
    repeats : tuple of str, length N
        Labels of comparable repeats in poses whose load sharing is determined.
    tares : mapping from sensor name to (value, sigma)

    Raises
    ------
    ConfigError
        If a tare is of no sensor of this robot or has not six finite numbers.
    MissingColumnError
        If a loaded foot has no column although its sensor exists.
    NotFiniteError
        If a loaded sensor has an empty cell, or any sensor only some of its cells.
    DataError
        If covariances are impossible.
    """
    robot = cells.robot
    names = [
        n for n in wrench_names(robot) if any(f"ft.{n}.{c}" in cells.header.index for c in CHANNELS)
    ]
    _require_sensors(cells, support, names)
    raw = {name: _channels(cells, name, support) for name in names}
    by_channel, notes = _channel_variances(cells, raw, repeats)
    tare_values, tare_cov = _tares(tares, robot)
    untared = [name for name in names if name not in tares]
    if untared:
        notes.append(f"no tare for {', '.join(untared)}: an offset of the sensor counts as load")
    wrench: dict[str, Array] = {}
    cov: dict[str, Array] = {}
    for name in names:
        w = raw[name] - tare_values.get(name, np.zeros(6))
        is_reversed = name in robot.sensors and robot.sensors[name].sense is Sense.ON_GROUND
        wrench[name] = -w if is_reversed else w
        cov[name] = _covariance(cells, name, by_channel)
    if names and not cells.header.of(Family.COVARIANCE):
        notes.append("no cov.* columns: the channels of a sensor are taken as uncorrelated")
    shared = {name: tare_cov[name] for name in names if name in tare_cov}
    return WrenchColumns(wrench, cov, shared, tuple(notes))


def _require_sensors(cells: PoseCells, support: tuple[str, ...], names: list[str]) -> None:
    """Refuse a table in which a foot that stands has no sensor columns while others have."""
    known_otherwise = cells.header.of(Family.COM) or cells.header.of(Family.COP)
    if not names or known_otherwise:
        return
    on_plate = {
        foot
        for name in names
        if name in cells.robot.plates
        for foot in cells.robot.plates[name].feet
    }
    for foot in cells.robot.feet.values():
        stands = any(s in (DOUBLE, foot.name) for s in support)
        if foot.sensor and foot.sensor not in names and stands and foot.name not in on_plate:
            near = [
                f"{name} -> {meant}"
                for name, meant in cells.header.unknown.items()
                if meant.startswith(f"ft.{foot.sensor}.")
            ]
            raise MissingColumnError(
                f"no column ft.{foot.sensor}.* although foot {foot.name} stands",
                where=cells.file.path.name,
                next_step=f"did you mean {near[0]}?"
                if near
                else "add fx fy fz tx ty tz of that sensor",
            )


def _channels(cells: PoseCells, name: str, support: tuple[str, ...]) -> Array:
    """Return the readings of one sensor, shape (N, 6), with no gaps but whole rows or columns."""
    values = cells.columns([f"ft.{name}.{c}" for c in CHANNELS])
    given = [k for k, c in enumerate(CHANNELS) if f"ft.{name}.{c}" in cells.header.index]
    empty = np.isnan(values[:, given])
    other = cells.columns(["com.x", "com.y", "com.z", "cop.x", "cop.y"])
    needs_it = np.isnan(other).all(axis=1) & _is_loaded(cells.robot, name, support)
    for i in np.flatnonzero(empty.any(axis=1) & (needs_it | ~empty.all(axis=1))):
        column = CHANNELS[given[int(np.flatnonzero(empty[i])[0])]]
        raise NotFiniteError(
            f"column ft.{name}.{column} is empty",
            where=cells.where(int(i)),
            next_step="fill the cell, or drop the pose with use = 0",
        )
    return values


def _is_loaded(robot: Robot, name: str, support: tuple[str, ...]) -> npt.NDArray[np.bool_]:
    """Return in which poses a sensor or plate carries the robot, shape (N,)."""
    if name in robot.plates:
        feet = set(robot.plates[name].feet)
    else:
        feet = {foot.name for foot in robot.feet.values() if foot.sensor == name}
    return np.array([bool(feet) and (s == DOUBLE or s in feet) for s in support])


def _channel_variances(
    cells: PoseCells, raw: Mapping[str, Array], repeats: tuple[str, ...]
) -> tuple[dict[tuple[str, str], tuple[Variances, int]], list[str]]:
    """Return where the variances of each (sensor, channel) stand, and notes.

    Forces of all sensors form one family and moments another: they share the revisit scatter.
    """
    found: dict[tuple[str, str], tuple[Variances, int]] = {}
    notes: list[str] = []
    for family in ("ft_force", "ft_moment"):
        keys = [(name, c) for name in raw for c in CHANNELS if channel_noise(c) == family]
        if not keys:
            continue
        values = np.column_stack([raw[name][:, CHANNELS.index(c)] for name, c in keys])
        errors = np.column_stack([cells.standard_error(f"se.ft.{n}.{c}") for n, c in keys])
        result = variances(values, errors, family, cells.robot.noise, repeats)
        notes += result.notes
        found |= {key: (result, k) for k, key in enumerate(keys)}
    return found, notes


def _covariance(
    cells: PoseCells, name: str, by_channel: Mapping[tuple[str, str], tuple[Variances, int]]
) -> Array:
    window = np.full((len(cells.rows), 6, 6), np.nan)
    for a, b in combinations(range(6), 2):
        spellings = [
            f"cov.{name}.{CHANNELS[a]}.{CHANNELS[b]}",
            f"cov.{name}.{CHANNELS[b]}.{CHANNELS[a]}",
        ]
        present = [column for column in spellings if column in cells.header.index]
        if len(present) == 2:
            raise DataError(
                f"columns {present[0]} and {present[1]} are the same covariance",
                where=cells.file.path.name,
                next_step="delete one of the two",
            )
        for column in present:
            _require_standard_errors(cells, column, name, (CHANNELS[a], CHANNELS[b]))
            window[:, a, b] = window[:, b, a] = cells.optional(column)
    picked = [by_channel[name, c] for c in CHANNELS]
    for k, channel in enumerate(CHANNELS):
        window[:, k, k] = cells.standard_error(f"se.ft.{name}.{channel}") ** 2
    cov = assemble_covariance(
        np.column_stack([v.window[:, k] for v, k in picked]),
        window,
        np.column_stack([v.own[:, k] for v, k in picked]),
        f"{cells.file.path.name} (sensor {name})",
    )
    for k, (v, _) in enumerate(picked):
        cov[:, k, k] += v.revisit
    return cov


def _require_standard_errors(
    cells: PoseCells, column: str, name: str, channels: tuple[str, str]
) -> None:
    for channel in channels:
        if f"se.ft.{name}.{channel}" not in cells.header.index:
            raise MissingColumnError(
                f"column {column} needs se.ft.{name}.{channel}, which is absent",
                where=cells.file.path.name,
                next_step="give the standard errors that belong to the covariances",
            )


def _tares(tares: Tares, robot: Robot) -> tuple[dict[str, Array], dict[str, Array]]:
    values: dict[str, Array] = {}
    covariances: dict[str, Array] = {}
    for name, (value, sigma) in tares.items():
        if name not in wrench_names(robot):
            near = near_miss(name, wrench_names(robot))
            raise ConfigError(
                f"there is a tare for {name}, which is no sensor of {robot.name}",
                next_step=f"did you mean {near}?" if near else "take the tare with this robot.yaml",
            )
        v, s = np.asarray(value, dtype=np.float64), np.asarray(sigma, dtype=np.float64)
        if v.shape != (6,) or s.shape != (6,) or not np.isfinite([v, s]).all() or (s < 0).any():
            raise ConfigError(
                f"the tare of {name} is not six finite numbers with six standard errors",
                next_step="take the tare again",
            )
        values[name], covariances[name] = v, np.diag(s**2)
    return values, covariances
