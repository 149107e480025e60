# SPDX-License-Identifier: Apache-2.0
"""``MAP.yaml``: which column of a logger's CSV is which column of ``poses.csv``, in which unit.

::

    format: comcal-map/1
    robot: robot.yaml                 # beside this file
    columns:                          # column of poses.csv: column of the logger
      t: t_s
      q.l_knee: {column: knee_deg, unit: deg, sign: -1, offset: 3 deg}
      ft.l_foot.fz: {column: "Fz [kgf]", unit: kgf}
      ft.l_foot.ty: {column: "My [kgf m]", scale: 9.80665}
    constants: {support: double, q.neck: 5 deg}
    windows: [[12.0, 14.5], [20, 22]] # still windows in t [s]; or
    pose_ids: state                   # a column: rows of equal number are one pose; or neither:
                                      # every row is a pose
    quasi_static: {window: 0.2 s}     # used with --quasi-static
    tares:                            # unloaded readings, as mapped, and their standard errors
      l_foot: {value: [0, 0, 21.5 N, 0, 0, 0], sigma: [1, 1, 1, 0.2, 0.2, 0.2]}

A mapped value is ``sign * scale * (number in its unit) + offset``. A standard error that is given
(``se.q.neck: 2 deg`` among the constants) comes on top of that of a window: what is assumed instead
of measured is stated so, with what it may be wrong by.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal, cast

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from comcal.errors import ConfigError
from comcal.measure.columns import (
    CHANNELS,
    WORDS,
    Column,
    Family,
    known_columns,
    wrench_names,
)
from comcal.measure.quasi_static import QuasiStatic
from comcal.robot.locate import LocatedYaml, read_yaml
from comcal.robot.model import Robot
from comcal.robot.units import Dimension, parse_quantity
from comcal.robot.validate import did_you_mean, validate_file

DIMENSIONS = {
    "rad": Dimension.ANGLE,
    "m": Dimension.LENGTH,
    "N": Dimension.FORCE,
    "N*m": Dimension.MOMENT,
    "A": Dimension.CURRENT,
    "m/s^2": Dimension.ACCELERATION,
    "s": Dimension.TIME,
}
"""Dimension of each SI unit that a column may have."""

RATES = ("/s^2", "/s")
"""Endings of the units of velocities, accelerations and slopes."""


def _as_mapping(value: object) -> object:
    return {"column": value} if isinstance(value, str) else value


def _seconds(value: object) -> float:
    return parse_quantity(value, Dimension.TIME)


Seconds = Annotated[float, BeforeValidator(_seconds)]


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class ColumnSection(_Section):
    """Where one column comes from."""

    column: str = Field(min_length=1)
    unit: str | None = None
    sign: Literal[1, -1] = 1
    scale: float = Field(default=1.0, gt=0.0, le=1e6)
    offset: str | float = 0.0


class QuasiStaticSection(_Section):
    """How slow windows are chosen; the defaults are those of :class:`QuasiStatic`."""

    window: Annotated[Seconds, Field(gt=0.0)] = QuasiStatic.window
    spread: float = Field(default=QuasiStatic.spread, gt=0.0)
    per_posture: int = Field(default=QuasiStatic.per_posture, gt=0)
    most: int = Field(default=QuasiStatic.most, gt=0)
    smoothing: Annotated[Seconds, Field(gt=0.0)] = QuasiStatic.smoothing
    stuck: Annotated[Seconds, Field(gt=0.0)] = QuasiStatic.stuck


def _six(value: object) -> tuple[float, ...]:
    if not isinstance(value, list) or len(cast("list[object]", value)) != len(CHANNELS):
        raise ConfigError("six numbers are needed: fx, fy, fz [N], tx, ty, tz [N m]")
    kinds = (Dimension.FORCE,) * 3 + (Dimension.MOMENT,) * 3
    items = cast("list[object]", value)
    return tuple(parse_quantity(x, kind) for x, kind in zip(items, kinds, strict=True))


SixNumbers = Annotated[tuple[float, ...], BeforeValidator(_six)]


class TareSection(_Section):
    """The unloaded reading of one sensor, before its sense is resolved."""

    value: SixNumbers
    sigma: SixNumbers


class MapSection(_Section):
    """The whole file."""

    format: Literal["comcal-map/1"]
    robot: str | None = None
    columns: dict[str, Annotated[ColumnSection, BeforeValidator(_as_mapping)]]
    constants: dict[str, str | float] = Field(default_factory=dict[str, str | float])
    windows: list[tuple[Seconds, Seconds]] | None = None
    pose_ids: str | None = None
    quasi_static: QuasiStaticSection = Field(default_factory=QuasiStaticSection)
    tares: dict[str, TareSection] = Field(default_factory=dict[str, TareSection])


@dataclass(frozen=True)
class MappedColumn:
    """``poses.csv`` value = ``factor * number + offset``, in SI; words are copied.

    Parameters
    ----------
    target : Column
        Of ``poses.csv``.
    source : str
        Of the logger.
    factor, offset : float
    """

    target: Column
    source: str
    factor: float = 1.0
    offset: float = 0.0

    @property
    def is_words(self) -> bool:
        """Whether the cells are words."""
        return self.target.name in WORDS


@dataclass(frozen=True)
class ImportMap:
    """A checked map.

    Parameters
    ----------
    columns : tuple of MappedColumn
    constants : mapping from column name to str or float
    windows : tuple of (start, end) or None
        [s].
    pose_ids : str
        Column of the logger; empty when not used.
    quasi_static : QuasiStatic
    located : LocatedYaml
        The file, for messages.
    tares : mapping from sensor or plate to (value, sigma), each six numbers
        [N, N m].
    """

    columns: tuple[MappedColumn, ...]
    constants: Mapping[str, str | float]
    windows: tuple[tuple[float, float], ...] | None
    pose_ids: str
    quasi_static: QuasiStatic
    located: LocatedYaml
    tares: Mapping[str, tuple[tuple[float, ...], tuple[float, ...]]] = field(
        default_factory=dict[str, tuple[tuple[float, ...], tuple[float, ...]]]
    )


def read_map_section(path: Path | str) -> tuple[MapSection, LocatedYaml]:
    """Read a map as far as it can be understood without the robot.

    Raises
    ------
    ConfigError
        If the file is missing, not YAML, or has unknown or missing keys.
    """
    located = read_yaml(Path(path))
    return validate_file(located, MapSection), located


def resolve_map(section: MapSection, located: LocatedYaml, robot: Robot) -> ImportMap:
    """Check the names and units of a map against a robot.

    Parameters
    ----------
    section : MapSection
    located : LocatedYaml
    robot : Robot

    Raises
    ------
    ConfigError
        If a column of ``poses.csv`` does not exist, is mapped and constant, or a unit is of the
        wrong kind; if windows overlap or have no length.
    """
    known = known_columns(robot)
    columns = [
        _mapped(name, entry, _known(name, "columns", known, located), located)
        for name, entry in section.columns.items()
    ]
    constants: dict[str, str | float] = {}
    for name, value in section.constants.items():
        if name in section.columns:
            raise ConfigError(
                f"{name} is mapped to a column and constant",
                where=located.where("constants", name),
                next_step="keep one of the two",
            )
        column = _known(name, "constants", known, located)
        constants[name] = _constant(value, column, located.where("constants", name))
    options = section.quasi_static
    return ImportMap(
        tuple(columns),
        constants,
        _windows(section, located),
        section.pose_ids or "",
        QuasiStatic(**options.model_dump()),
        located,
        _tares(section, robot, located),
    )


def _known(name: str, section: str, known: Mapping[str, Column], located: LocatedYaml) -> Column:
    if name not in known:
        raise ConfigError(
            f"{name!r} is no column of poses.csv for this robot",
            where=located.where(section, name),
            next_step=did_you_mean(name, list(known)),
        )
    return known[name]


def _mapped(name: str, entry: ColumnSection, target: Column, located: LocatedYaml) -> MappedColumn:
    where = located.where("columns", name)
    plain = entry.sign == 1 and entry.scale == 1.0 and entry.offset == 0.0
    if target.family is Family.COVARIANCE or not target.unit:
        if entry.unit is not None or not plain:
            raise ConfigError(
                f"{name} is taken as it is: it can have no unit, sign, scale or offset",
                where=where,
                next_step="leave them out",
            )
        return MappedColumn(target, entry.column)
    factor = entry.sign * entry.scale
    try:
        factor *= 1.0 if entry.unit is None else unit_factor(entry.unit, target.unit)
        offset = _quantity(entry.offset, target.unit)
    except ConfigError as error:
        raise ConfigError(
            f"{name}: {error.what}", where=where, next_step=error.next_step
        ) from error
    spread = target.family in (Family.STANDARD_ERROR, Family.DEVIATION)
    if spread and (entry.sign < 0 or offset != 0.0):
        raise ConfigError(
            f"{name} is never negative and has no offset", where=where, next_step="leave them out"
        )
    return MappedColumn(target, entry.column, factor, offset)


def unit_factor(unit: str, si: str) -> float:
    """Return what one *unit* is in the SI unit of a column.

    Parameters
    ----------
    unit : str
        Such as ``deg``, ``N cm`` or ``deg/s``.
    si : str
        Unit of a :class:`~comcal.measure.columns.Column`.

    Raises
    ------
    ConfigError
        If it is of another kind.

    Examples
    --------
    >>> unit_factor("mm", "m")
    0.001
    """
    if unit == si or (si == "degC" and unit in ("°C", "C")):
        return 1.0
    if si in DIMENSIONS:
        return parse_quantity(f"1 {unit}", DIMENSIONS[si])
    for rate in RATES:
        if si.endswith(rate) and unit.endswith(rate):
            return unit_factor(unit[: -len(rate)].strip(), si[: -len(rate)])
    raise ConfigError(f"{unit!r} is not a unit of {si}", next_step=f"convert the column to {si}")


def _tares(
    section: MapSection, robot: Robot, located: LocatedYaml
) -> dict[str, tuple[tuple[float, ...], tuple[float, ...]]]:
    names = wrench_names(robot)
    for name, tare in section.tares.items():
        if name not in names:
            raise ConfigError(
                f"{name!r} is no sensor or plate of this robot",
                where=located.where("tares", name),
                next_step=did_you_mean(name, list(names)),
            )
        if min(tare.sigma) < 0.0:
            raise ConfigError(
                "a standard error is never negative", where=located.where("tares", name)
            )
    return {name: (tare.value, tare.sigma) for name, tare in section.tares.items()}


def _quantity(value: str | float, si: str) -> float:
    if isinstance(value, float) or si not in DIMENSIONS:
        return parse_quantity(value, Dimension.RATIO)
    return parse_quantity(value, DIMENSIONS[si])


def _constant(value: str | float, column: Column, where: str) -> str | float:
    if column.name in WORDS:
        return str(value)
    if column.name == "pose":
        raise ConfigError("pose cannot be constant", where=where, next_step="leave it out")
    try:
        return _quantity(value, column.unit)
    except ConfigError as error:
        raise ConfigError(
            f"{column.name}: {error.what}", where=where, next_step=error.next_step
        ) from error


def _windows(section: MapSection, located: LocatedYaml) -> tuple[tuple[float, float], ...] | None:
    if section.windows is None:
        return None
    if section.pose_ids is not None:
        raise ConfigError(
            "windows and pose_ids are two ways to say the same",
            where=located.where("pose_ids"),
            next_step="keep one of the two",
        )
    if "t" not in section.columns:
        raise ConfigError(
            "windows need the time: column t is not mapped",
            where=located.where("windows"),
            next_step="add `t: NAME` under columns",
        )
    for i, (start, end) in enumerate(section.windows):
        overlaps = [k for k, (a, b) in enumerate(section.windows[:i]) if start < b and a < end]
        if not start < end or overlaps:
            raise ConfigError(
                f"the window from {start:g} s to {end:g} s "
                + ("overlaps another" if overlaps else "has no length"),
                where=located.where("windows", i),
                next_step="give start and end in seconds, each window once",
            )
    if not section.windows:
        raise ConfigError("there is no window", where=located.where("windows"))
    return tuple(section.windows)


def mapped_robot(section: MapSection, located: LocatedYaml) -> Path:
    """Return the path of the robot.yaml that a map names.

    Raises
    ------
    ConfigError
        If it names none.
    """
    if section.robot is None:
        raise ConfigError(
            "key 'robot' is missing",
            where=located.where(),
            next_step="name the robot.yaml, relative to this file",
        )
    return located.path.parent / section.robot
