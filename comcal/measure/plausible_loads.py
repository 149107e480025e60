# SPDX-License-Identifier: Apache-2.0
"""Do the feet carry the robot: the right way round, on the right side, with its weight?"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from comcal.errors import DataError, NotBalancedError, SignError, UnitsError
from comcal.measure.plan import DOUBLE
from comcal.measure.sole_hull import distance_outside
from comcal.measure.stance_load import StanceLoad, stance_load
from comcal.measure.table import PoseTable
from comcal.robot.model import Robot, Sense
from comcal.robot.tree import Array

KGF_TOLERANCE = 0.05
"""Forces whose sum is this close to the mass in kg are in kgf."""
LOADED = 0.05
"""A sensor is loaded from this part of the weight on."""
LIFTED, CARRYING = 0.2, 0.5
"""Below and above these parts of the weight a foot is in the air, or carries the robot."""
EXCHANGED_DISTANCE = 0.002
"""Distance between measured and expected CoM [m] above which sides are suspected of exchange. It
may be small, because a wrong model is not cured by exchanging the sensors ..."""
EXCHANGED_ONE_POSE = 0.03
"""... unless by chance in a single pose: the limit is this over the number of poses, if larger."""
EXCHANGED_GAIN = 3.0
"""How many times nearer the CoM must come when the sides are exchanged."""
WEIGHT_TOLERANCE = 0.3
LARGEST_LEAN = np.radians(30.0)
SOLE_MARGIN = 0.05
"""How far outside the soles [m] the centre of pressure may lie before it cannot be true."""

MOMENT_UNITS = {"N mm": 1e-3, "N cm": 1e-2}
"""Units in which moments are often logged, with their factors to N m."""


def check_loads(table: PoseTable, robot: Robot) -> Iterator[DataError]:
    """Yield what is wrong with the wrenches under the feet, causes before consequences.

    Parameters
    ----------
    table : PoseTable
    robot : Robot
    """
    if not robot.tree.geometry_known or not robot.feet or not robot.tree.total_mass > 0.0:
        return
    load = stance_load(table, robot)
    if not load.standing:
        return
    yield from check_force_unit(table, robot, load)
    yield from check_signs(table, robot, load)
    yield from check_sides_single(table, robot, load)
    yield from check_sides_double(table, robot, load)
    yield from check_weight(table, robot, load)
    yield from check_lean(table, load)
    yield from check_pressure(table, robot, load)


def _normal(load: StanceLoad, name: str) -> Array:
    """Return the normal force of a sensor where it stands, else NaN, shape (N,)."""
    return np.where(load.standing[name], load.force[name][:, 2], np.nan)


def check_force_unit(table: PoseTable, robot: Robot, load: StanceLoad) -> Iterator[DataError]:
    """Yield forces in kgf: their sizes add up to the mass instead of to the weight."""
    sizes = np.sum([np.nan_to_num(np.abs(_normal(load, name))) for name in load.standing], axis=0)
    ratio = (sizes / load.mass)[np.isfinite(load.mass)]
    if not ratio.size:
        return
    median = float(np.median(ratio))
    if abs(median - 1.0) < KGF_TOLERANCE and robot.gravity > 1.0 + 2 * KGF_TOLERANCE:
        yield UnitsError(
            "the forces look like kgf: they add up to the mass, not to the weight",
            where=_file(table),
            measured=f"{median * float(np.nanmedian(load.mass)):.4g}",
            limit=f"{float(np.nanmedian(load.mass)) * robot.gravity:.4g} N",
            next_step="multiply forces and moments by 9.80665, or say `unit: kgf` (forces) and "
            "`scale: 9.80665` (moments) in the map of `comcal import`",
        )


def check_signs(table: PoseTable, robot: Robot, load: StanceLoad) -> Iterator[DataError]:
    """Yield sensors by which the ground would pull at most of the poses; proposes the sense."""
    wrong: list[str] = []
    seen: list[str] = []
    count = ""
    for name in load.standing:
        normal = _normal(load, name)
        loaded = np.abs(normal) > LOADED * load.mass * robot.gravity
        if not loaded.any():
            continue
        seen.append(name)
        n_negative, n_loaded = int((normal[loaded] < 0.0).sum()), int(loaded.sum())
        if 2 * n_negative > n_loaded:
            wrong.append(name)
            count = f"{n_negative} of {n_loaded} poses"
    if not wrong:
        return
    proposals = [
        f"{name}: {'on_robot' if robot.sensors[name].sense is Sense.ON_GROUND else 'on_ground'}"
        for name in wrong
        if name in robot.sensors
    ]
    which = (
        "all sensors" if len(wrong) == len(seen) else f"sensor {', '.join(wrong)} (not the others)"
    )
    yield SignError(
        f"by {which} the ground pulls the feet down",
        where=_file(table),
        measured=f"negative normal force in {count}",
        next_step=f"set `sense` in robot.yaml to {', '.join(proposals)}"
        if proposals
        else "turn the sign of the plate's columns in the map of `comcal import`",
    )


def check_sides_single(table: PoseTable, robot: Robot, load: StanceLoad) -> Iterator[DataError]:
    """Yield standing feet that carry nothing while another foot carries the robot."""
    by_foot = {f.name: f.sensor for f in robot.feet.values() if f.sensor in table.wrench}
    found: list[int] = []
    n_single = 0
    for i, support in enumerate(table.support):
        if by_foot.get(support) is None or len(by_foot) < 2 or not np.isfinite(load.mass[i]):
            continue
        n_single += 1
        weight = load.mass[i] * robot.gravity
        sizes = {
            foot: float(np.linalg.norm(np.nan_to_num(table.wrench[sensor][i, :3])))
            for foot, sensor in by_foot.items()
            if sensor
        }
        others = max(size for foot, size in sizes.items() if foot != support)
        if sizes[support] < LIFTED * weight and others > CARRYING * weight:
            found.append(i)
    if not found:
        return
    i = found[0]
    if 2 * len(found) > n_single:
        yield SignError(
            "left and right are exchanged: the foot that stands carries nothing, another does",
            where=table.where(i),
            measured=f"in {len(found)} of {n_single} one-foot poses",
            next_step="exchange the sensors' columns, or `sensor:` of the feet in robot.yaml",
        )
    else:
        yield SignError(
            f"support says {table.support[i]}, but that foot carries nothing and another does",
            where=table.where(i),
            next_step="correct `support` of this pose, or drop it with use = 0",
        )


def check_sides_double(table: PoseTable, robot: Robot, load: StanceLoad) -> Iterator[DataError]:
    """Yield two-foot tables that fit the URDF far better with left and right exchanged."""
    sensors = [f.sensor for f in robot.feet.values() if f.sensor in table.wrench]
    double = np.array([s == DOUBLE for s in table.support])
    if len(sensors) != 2 or not double.any():
        return
    a, b = str(sensors[0]), str(sensors[1])
    exchanged = {**table.wrench, a: table.wrench[b], b: table.wrench[a]}
    mirrored = stance_load(replace(table, wrench=exchanged), robot)
    distance = {
        key: (other.line_of_gravity(other.com[:, 2]) - other.com[:, :2])[double]
        for key, other in (("as given", load), ("exchanged", mirrored))
    }
    there = np.isfinite(distance["as given"]) & np.isfinite(distance["exchanged"])
    if not there.any():
        return
    given, other = (float(np.sqrt(np.mean(d[there] ** 2))) for d in distance.values())
    limit = max(EXCHANGED_DISTANCE, EXCHANGED_ONE_POSE / int(double.sum()))
    if given > limit and other * EXCHANGED_GAIN < given:
        yield SignError(
            "left and right look exchanged: the load is on the wrong foot",
            where=_file(table),
            measured=f"{given * 1e3:.1f} mm from the URDF's CoM, exchanged {other * 1e3:.1f} mm",
            limit=f"{limit * 1e3:.1f} mm",
            next_step="exchange the sensors' columns, or `sensor:` of the feet in robot.yaml",
        )


def check_weight(table: PoseTable, robot: Robot, load: StanceLoad) -> Iterator[DataError]:
    """Yield poses in which the feet do not carry what the URDF says."""
    size = np.linalg.norm(load.total_force(), axis=1)
    weight = load.mass * robot.gravity
    relative = np.nan_to_num(np.abs(size / weight - 1.0))
    wrong = np.flatnonzero(relative > WEIGHT_TOLERANCE)
    if not wrong.size:
        return
    i = int(wrong[0])
    everywhere = wrong.size == int(np.isfinite(size / weight).sum())
    yield NotBalancedError(
        "the feet do not carry the robot's weight",
        where=table.where(i),
        measured=f"{size[i]:.1f} N",
        limit=f"{weight[i]:.1f} N +- {100 * WEIGHT_TOLERANCE:.0f} %",
        next_step="compare the URDF's masses with a scale, and tare and gain of the sensors"
        if everywhere
        else "something else held the robot, or a sensor failed: measure this pose again",
    )


def check_lean(table: PoseTable, load: StanceLoad) -> Iterator[DataError]:
    """Yield poses whose ground force leans more than any floor a robot stands on."""
    force = load.total_force()
    lean = np.arctan2(np.linalg.norm(force[:, :2], axis=1), force[:, 2])
    for i in np.flatnonzero(np.nan_to_num(lean) > LARGEST_LEAN):
        yield NotBalancedError(
            "the ground force is not along the soles' normal",
            where=table.where(int(i)),
            measured=f"{np.degrees(lean[i]):.0f} deg",
            limit=f"{np.degrees(LARGEST_LEAN):.0f} deg",
            next_step="check the axes of the sensors (joint rpy in the URDF) and whether it stood",
        )


def check_pressure(table: PoseTable, robot: Robot, load: StanceLoad) -> Iterator[DataError]:
    """Yield poses whose centre of pressure lies far outside the soles, and why that may be."""
    outside = _distances_outside(load)
    known = int(np.isfinite(outside).sum())
    wrong = np.flatnonzero(np.nan_to_num(outside) > SOLE_MARGIN)
    if not wrong.size:
        return
    i = int(wrong[0])
    seen = {
        "where": table.where(i),
        "measured": f"{outside[i] * 1e3:.0f} mm outside the soles",
        "limit": f"{SOLE_MARGIN * 1e3:.0f} mm",
    }
    unit, fits = _better_moment_unit(table, robot)
    if fits and 2 * wrong.size > known:
        yield UnitsError(
            f"the moments look like {unit}: then every centre of pressure lies inside",
            **seen,
            next_step=f"multiply them by {MOMENT_UNITS[unit]:g}, or say `unit: {unit}` in the map "
            "of `comcal import`",
        )
        return
    yield NotBalancedError(
        "the centre of pressure is where no foot is",
        **seen,
        next_step="check the tare and the frames of the sensors, and what else held the robot",
    )


def _better_moment_unit(table: PoseTable, robot: Robot) -> tuple[str, bool]:
    """Return the unit that brings the load nearest to the URDF's CoM, and whether all then fits."""
    loads: dict[str, StanceLoad] = {}
    for unit, factor in MOMENT_UNITS.items():
        scale = np.array([1.0, 1.0, 1.0, factor, factor, factor])
        scaled = replace(table, wrench={name: w * scale for name, w in table.wrench.items()})
        loads[unit] = stance_load(scaled, robot)
    distance = {
        unit: float(np.nansum((x.line_of_gravity(x.com[:, 2]) - x.com[:, :2]) ** 2))
        for unit, x in loads.items()
    }
    unit = min(distance, key=lambda name: distance[name])
    return unit, bool(np.nan_to_num(_distances_outside(loads[unit])).max() <= SOLE_MARGIN)


def _distances_outside(load: StanceLoad) -> Array:
    """Return how far outside the soles each centre of pressure lies, NaN where unknown, (N,)."""
    outside = np.full(len(load.mass), np.nan)
    for i, corners in enumerate(load.corners):
        if corners is None or not np.isfinite(load.mass[i]):
            continue
        height = np.full(len(load.mass), corners[:, 2].mean())
        point = load.line_of_gravity(height)[i]
        if np.isfinite(point).any():  # a component that was not measured is taken as well inside
            point = np.where(np.isfinite(point), point, corners[:, :2].mean(axis=0))
            outside[i] = distance_outside(point, corners[:, :2])
    return outside


def _file(table: PoseTable) -> str:
    return table.source.name if table.source else ""
