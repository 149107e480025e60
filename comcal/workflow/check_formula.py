# SPDX-License-Identifier: Apache-2.0
"""``comcal derive --check FILE.yaml``: reads a hand-written formula and compares it with ours."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, StringConstraints

from comcal.errors import ConfigError
from comcal.robot.locate import Key, LocatedYaml, read_yaml
from comcal.robot.validate import did_you_mean, validate_file
from comcal.symbolic.check import check_claim
from comcal.symbolic.check_claim import Claim, FormulaReport, Line
from comcal.symbolic.check_quantities import QUANTITIES

Text = Annotated[str, StringConstraints(min_length=1, strip_whitespace=True)]
Name = Annotated[str, StringConstraints(pattern=r"^[^\W\d]\w*$")]
Formula = Text | int | float


class FormulaFile(BaseModel):
    """The whole of a formula file."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    format: Literal["comcal-formula/1"]
    quantity: Text
    links: Annotated[int, Field(ge=1, le=12)] | None = None
    symbols: dict[Name, Formula] = Field(default_factory=dict)
    configuration: dict[Name, Formula] = Field(default_factory=dict)
    formula: Formula | None = None
    matrix: Annotated[list[list[Formula]], Field(min_length=1)] | None = None
    over: Formula | None = None


def check_formula(path: Path) -> FormulaReport:
    """Compare the formula of a file with the moment balance at random points.

    Parameters
    ----------
    path : Path

    Returns
    -------
    FormulaReport

    Raises
    ------
    ConfigError
        If the file, a symbol or a formula in it cannot be understood.

    Notes
    -----
    Nothing of the file is run: formulas are read by a parser of their own.
    """
    return check_claim(read_claim(path))


def read_claim(path: Path) -> Claim:
    """Read a formula file.

    Parameters
    ----------
    path : Path

    Raises
    ------
    ConfigError
        If it is not a valid formula file.
    """
    located = read_yaml(path)
    file = validate_file(located, FormulaFile)
    if file.quantity not in QUANTITIES:
        raise ConfigError(
            f"quantity {file.quantity!r} is not known",
            where=located.where("quantity"),
            next_step=did_you_mean(file.quantity, [*QUANTITIES])
            or f"possible are {', '.join(QUANTITIES)}",
        )
    quantity = QUANTITIES[file.quantity]
    if (file.formula is None) == (file.matrix is None):
        raise ConfigError(
            "give either `formula` or `matrix`",
            where=located.where("formula" if file.formula is None else "matrix"),
            measured="both are there" if file.formula is not None else "neither is there",
        )
    links = file.links or 2
    angles = [f"theta_{v}" for v in range(1, links + 1)]
    for key, given in (("links", file.links is not None), ("configuration", file.configuration)):
        if given and not quantity.any_links:
            raise ConfigError(
                f"{key!r} has no meaning for {quantity.name}, which is of two given poses",
                where=located.where(key),
                next_step="remove it, or use moment_x or moment_z",
            )
    for name in file.configuration:
        if name not in angles:
            raise ConfigError(
                f"{name!r} is not the pitch of a link",
                where=located.where("configuration", name),
                next_step=f"possible are {', '.join(angles)}",
            )
    if file.over is not None and (file.matrix is None or quantity.column is None):
        raise ConfigError(
            "`over` belongs to the matrix of a solution by Cramer's rule",
            where=located.where("over"),
            next_step="remove it",
        )
    return Claim(
        quantity,
        formula=None if file.formula is None else _line(located, file.formula, "formula"),
        matrix=[
            [_line(located, cell, "matrix", r, c) for c, cell in enumerate(row)]
            for r, row in enumerate(file.matrix or ())
        ],
        over=None if file.over is None else _line(located, file.over, "over"),
        symbols={k: _line(located, v, "symbols", k) for k, v in file.symbols.items()},
        configuration={
            k: _line(located, v, "configuration", k) for k, v in file.configuration.items()
        },
        links=links,
    )


def _line(located: LocatedYaml, value: Formula, *path: Key) -> Line:
    return Line(str(value), located.where(*path))
