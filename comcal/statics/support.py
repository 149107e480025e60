# SPDX-License-Identifier: Apache-2.0
"""Which sensors carry the robot in a kind of support, and which links they carry."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from comcal.errors import ConfigError, DataError, MissingColumnError, NotFiniteError
from comcal.measure.columns import CHANNELS
from comcal.measure.plan import DOUBLE, NONE
from comcal.measure.table import PoseTable
from comcal.robot.model import Robot
from comcal.robot.tree import Array


@dataclass(frozen=True)
class Carrier:
    """What holds the robot up in one kind of support.

    Parameters
    ----------
    support : str
        ``double`` or the name of a foot.
    feet : tuple of str
        Standing feet, left before right.
    sensors : tuple of str
        Sensors (or plates) whose wrenches add up to the whole ground reaction above their cuts.
    frames : tuple of int or None
        Link in whose frame each of them measures; None: the stance frame P (a plate in the world).
    carried : array of bool, shape (n_links,)
        Links above every loaded cut. alpha..delta, m_2 and m_u speak of these only.
    """

    support: str
    feet: tuple[str, ...]
    sensors: tuple[str, ...]
    frames: tuple[int | None, ...]
    carried: npt.NDArray[np.bool_]


def carrier_of(robot: Robot, support: str) -> Carrier:
    """Return what carries *robot* in *support*.

    Foot sensors win over plates. A plate serves where a standing foot has no sensor of its own; it
    then speaks for all of its feet, since it cannot tell which of them loads it.

    Raises
    ------
    ConfigError
        If the support names no foot of the robot, or a standing foot has neither sensor nor plate.
    """
    if support == NONE:
        raise ConfigError("a hanging robot is carried by no sensor", where=f"support {support!r}")
    feet = standing_feet(robot, support)
    plates = _plates_in_use(robot, support, feet)
    sensors: list[str] = []
    frames: list[int | None] = []
    carried = np.ones(len(robot.tree.links), dtype=np.bool_)
    for foot in feet:
        plate = next(
            (robot.plates[name] for name in plates if foot in robot.plates[name].feet), None
        )
        sensor = robot.feet[foot].sensor
        if plate is None and sensor is not None:
            sensors.append(sensor)
            frames.append(robot.tree.joint_index[robot.sensors[sensor].joint] + 1)
            carried &= ~robot.below_cut[sensor]
        elif plate is not None and plate.name not in sensors:
            sensors.append(plate.name)
            in_world = plate.frame == "world"
            frames.append(None if in_world else robot.tree.link_index[plate.frame])
    return Carrier(support, feet, tuple(sensors), tuple(frames), carried)


def hanging_carrier(robot: Robot) -> Carrier:
    """Return what carries a robot that something unknown holds: no sensor."""
    return Carrier(NONE, (), (), (), np.ones(len(robot.tree.links), dtype=np.bool_))


def _plates_in_use(robot: Robot, support: str, feet: tuple[str, ...]) -> tuple[str, ...]:
    """Return the plates under standing feet that have no sensor of their own."""
    plates: list[str] = []
    for foot in feet:
        if robot.feet[foot].sensor is not None:
            continue
        plate = next((p for p in robot.plates.values() if foot in p.feet), None)
        if plate is None:
            raise ConfigError(
                f"foot {foot!r} stands but has neither a sensor nor a plate",
                where=f"support {support!r}",
                next_step="add feet.*.sensor or plates to robot.yaml",
            )
        plates.append(plate.name)
    return tuple(plates)


def standing_feet(robot: Robot, support: str) -> tuple[str, ...]:
    """Return the feet that stand, from left to right as they stand at q = 0.

    Raises
    ------
    ConfigError
        If *support* names no foot.
    """
    if support == DOUBLE:
        if not robot.feet:
            raise ConfigError("double support of a robot without feet", where=robot.name)
        return robot.feet_from_left
    if support not in robot.feet:
        raise ConfigError(
            f"support {support!r} is neither 'double', 'none' nor a foot",
            where=robot.name,
            next_step=f"feet of this robot: {', '.join(robot.feet) or 'none'}",
        )
    return (support,)


def measured_supports(
    robot: Robot, table: PoseTable
) -> Iterator[tuple[Carrier, npt.NDArray[np.intp]]]:
    """Yield what carries the robot in each support of *table*, and the rows whose load is measured.

    Left out are hanging poses, and poses without a wrench whose CoM or CoP is given instead.

    Raises
    ------
    ConfigError
        As of :func:`carrier_of`.
    MissingColumnError
        If the table holds no wrench of a loaded sensor, nor anything instead.
    NotFiniteError
        If a loaded sensor lacks a channel in a pose that has nothing instead.
    DataError
        If a loaded sensor is said to have no error at all: nothing could be weighed against it.
    """
    given = np.concatenate([table.com, table.cop], axis=1)
    otherwise = np.asarray(np.isfinite(given).any(axis=1), np.bool_)
    for support in sorted(set(table.support) - {NONE}):
        stands = np.array([s == support for s in table.support])
        try:
            carrier = carrier_of(robot, support)
        except ConfigError:
            if np.all(otherwise[stands]):  # no force sensor is needed then
                continue
            raise
        if not np.all(otherwise[stands]):
            _refuse_absent(table, carrier)
        measured = stands.copy()
        for sensor in carrier.sensors:
            whole = np.isfinite(table.wrench.get(sensor, np.full((len(table), 6), np.nan)))
            measured &= whole.all(axis=1)
        _refuse_missing(table, carrier, np.flatnonzero(stands & ~measured & ~otherwise))
        _refuse_exact(table, carrier, np.flatnonzero(measured))
        if measured.any():
            yield carrier, np.flatnonzero(measured)


def _refuse_absent(table: PoseTable, carrier: Carrier) -> None:
    for sensor in carrier.sensors:
        if sensor not in table.wrench:
            raise MissingColumnError(
                f"no wrench of sensor {sensor!r}, which is loaded in support {carrier.support!r}",
                where=str(table.source or "pose table"),
                next_step=f"add columns ft.{sensor}.fx .. tz",
            )


def _refuse_missing(table: PoseTable, carrier: Carrier, rows: npt.NDArray[np.intp]) -> None:
    for i in rows:
        gaps = [
            f"ft.{sensor}.{channel}"
            for sensor in carrier.sensors
            for channel, value in zip(CHANNELS, table.wrench[sensor][i], strict=True)
            if not np.isfinite(value)
        ]
        raise NotFiniteError(
            f"the wrench of a loaded sensor is not whole: {', '.join(gaps)} missing",
            where=table.where(int(i)),
            next_step="all six channels of every loaded sensor are needed, or com.* instead",
        )


def _refuse_exact(table: PoseTable, carrier: Carrier, rows: npt.NDArray[np.intp]) -> None:
    for sensor in carrier.sensors if rows.size else ():
        variance = np.einsum("nii->ni", table.wrench_cov[sensor][rows])
        for i, channel in np.argwhere(~(variance > 0.0)):
            family = "ft_force" if channel < 3 else "ft_moment"
            column = f"ft.{sensor}.{CHANNELS[channel]}"
            raise DataError(
                f"the standard error of {column} is zero or unknown, so its pose has no weight",
                where=table.where(int(rows[i])),
                measured=f"variance {variance[i, channel]:g}",
                limit="above 0",
                next_step=f"give se.{column}, or noise.{family} in robot.yaml, above zero",
            )


def loaded_wrenches(carrier: Carrier, table: PoseTable) -> tuple[Array, Array]:
    """Return the wrenches of the loaded sensors, ground on robot, and their covariances.

    Parameters
    ----------
    carrier : Carrier
    table : PoseTable
        Poses whose load is measured, see :func:`measured_supports`.

    Returns
    -------
    w : array, shape (N, n_sensors, 6)
        In and about each sensor's own frame [N, N m].
    cov : array, shape (N, n_sensors, 6, 6)
        Of each pose mean; without the error of a tare, which is common to all poses.

    Raises
    ------
    MissingColumnError
        If the table holds no wrench of a loaded sensor.
    """
    _refuse_absent(table, carrier)
    w = np.stack([table.wrench[s] for s in carrier.sensors], axis=1)
    cov = np.stack([table.wrench_cov[s] for s in carrier.sensors], axis=1)
    return w, cov


def tare_covariances(carrier: Carrier, table: PoseTable) -> Array:
    """Return the covariance of each loaded sensor's tare, shape (n_sensors, 6, 6).

    One and the same error in every pose; zero where no tare was subtracted.
    """
    none = np.zeros((6, 6))
    return np.stack([table.tare_cov.get(sensor, none) for sensor in carrier.sensors])
