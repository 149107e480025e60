# SPDX-License-Identifier: Apache-2.0
"""``comcal derive``: what is asked for, in which configurations, of which chain, as a program."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum
from itertools import combinations
from pathlib import Path

from comcal.errors import RankError, UsageError
from comcal.robot.description import load_robot
from comcal.symbolic.chain import Chain, planar_chain
from comcal.symbolic.coefficients import coefficients_program, total_com_program
from comcal.symbolic.cofactors import free_factors
from comcal.symbolic.cramer import MAX_FREE, cramer_program
from comcal.symbolic.nullspace import spatial_program
from comcal.symbolic.one_joint import one_joint_program, one_joint_system
from comcal.symbolic.program import Program, Statement, Steps, substituted
from comcal.symbolic.robot_chain import (
    LinkPath,
    default_ends,
    path_between,
    planar_values,
    spatial_chain,
)
from comcal.symbolic.sigma import one_joint_factors, sigma_program
from comcal.symbolic.spatial import SpatialChain
from comcal.symbolic.spatial_cramer import spatial_cramer_program
from comcal.symbolic.spatial_one_joint import spatial_one_joint_program
from comcal.symbolic.spatial_sigma import spatial_cramer_sigma, spatial_one_joint_sigma
from comcal.symbolic.system import System, free_angles, system_of
from comcal.symbolic.to_c import to_c
from comcal.symbolic.to_latex import to_latex
from comcal.symbolic.to_python import to_python
from comcal.symbolic.to_text import to_text
from comcal.workflow.derive_configurations import read_pitches, read_shapes

ONE_JOINT, FREE = "one-joint", "free"
MAX_LINKS = 200
"""Longer chains are a slip of the keyboard."""


class What(Enum):
    """What can be derived."""

    COEFFICIENTS = "coefficients"
    TOTAL_COM = "total-com"
    LINK_COM = "link-com"
    SIGMA = "sigma"
    ROWS = "rows"


PRINTERS: dict[str, Callable[[Program], str]] = {
    "text": to_text,
    "python": to_python,
    "c": to_c,
    "latex": to_latex,
}


@dataclass(frozen=True)
class DeriveOrder:
    """What to derive.

    Parameters
    ----------
    what : What
    dof : int or None
        Segments of the paper's chain above the ankle; or
    robot : Path or None
        robot.yaml, and its links *base* and *tip* (None: a foot and the root link).
    configurations : str
        ``one-joint``, ``free``, or the path of a file.
    """

    what: What
    dof: int | None = None
    robot: Path | None = None
    base: str | None = None
    tip: str | None = None
    configurations: str = ONE_JOINT


def derive(order: DeriveOrder) -> Program:
    """Return what was asked for, ready for the ``PRINTERS``.

    Raises
    ------
    UsageError
        If the chain is too long for what is asked, or the robot or its links are wrong.
    RankError
        If the configurations cannot determine the links.
    """
    if order.what is What.COEFFICIENTS:
        return coefficients_program()
    if order.what is What.TOTAL_COM:
        return total_com_program()
    if order.robot is not None:
        robot = load_robot(order.robot)
        base, tip = default_ends(robot)
        path = path_between(robot, order.base or base, order.tip or tip)
        if order.what is What.ROWS or not path.is_planar:
            program = _spatial(order, spatial_chain(path))
            return replace(program, statements=(*program.statements, _carried(path)))
        chain, values = planar_values(path)
        program = substituted(_planar(order, chain), values)
        return replace(program, statements=(*program.statements, _meaning(path, chain)))
    if order.what is What.ROWS:
        raise UsageError(
            "the equations of one pose are for the chain of a robot",
            next_step="give --robot ROBOT.yaml",
        )
    if order.dof is None:
        raise UsageError("nothing to derive from", next_step="give --dof N or --robot ROBOT.yaml")
    if not 1 <= order.dof <= MAX_LINKS:
        raise UsageError(
            "that many links cannot be derived",
            measured=f"{order.dof}",
            limit=f"1 to {MAX_LINKS}",
        )
    return _planar(order, planar_chain(order.dof))


def _meaning(path: LinkPath, chain: Chain) -> Statement:
    """Return which letter stands for which part of the robot."""
    parts = [
        f"{letter} turns at {joint} and begins with {link} ({mass:g} kg)"
        for letter, joint, link, mass in zip(
            chain.letters, path.names, path.links[1:], path.masses[1:], strict=True
        )
    ]
    return Statement(
        f"Segments from {path.links[0]}: {'; '.join(parts)}. What hangs beside the chain counts "
        "with the segment it hangs on, its joints at zero. Angles are pitches about +y, positive "
        "to the toes."
    )


def _carried(path: LinkPath) -> Statement:
    """Return which masses count with which link, and in which frame the total CoM is given."""
    parts = [f"{link} {mass:g} kg" for link, mass in zip(path.links, path.masses, strict=True)]
    return Statement(
        f"What hangs beside the chain counts with the link it hangs on, its joints at zero: "
        f"{', '.join(parts)}. The frame of {path.links[0]} is the stance frame P when the robot "
        "stands on it, else its URDF frame; the total CoM is that of these masses together."
    )


def _spatial(order: DeriveOrder, chain: SpatialChain) -> Program:
    if order.what is What.ROWS:
        return spatial_program(chain)
    wants_sigma = order.what is What.SIGMA
    if order.configurations == ONE_JOINT:
        make = spatial_one_joint_sigma if wants_sigma else spatial_one_joint_program
        return make(chain)
    free = order.configurations == FREE
    shapes = None if free else read_shapes(Path(order.configurations), chain)
    return (spatial_cramer_sigma if wants_sigma else spatial_cramer_program)(chain, shapes)


def _planar(order: DeriveOrder, chain: Chain) -> Program:
    if order.configurations == ONE_JOINT:
        if order.what is What.LINK_COM:
            return one_joint_program(chain)
        steps = Steps()
        system = one_joint_system(chain)
        return sigma_program(system, one_joint_factors(system, steps), steps)
    n = len(chain.letters)
    if n > MAX_FREE:
        raise UsageError(
            "Cramer's rule for free configurations doubles with every link",
            measured=f"{n} links",
            limit=f"{MAX_FREE}",
            next_step=f"use --configurations {ONE_JOINT}, which is short for any number",
        )
    if order.configurations == FREE:
        angles, phi = free_angles(n)
        system = system_of(chain, angles, [phi])
    else:
        system = read_pitches(Path(order.configurations), chain)
    if order.what is What.LINK_COM:
        return cramer_program(system)
    return _sigma_of_first_choice(system)


def _sigma_of_first_choice(system: System) -> Program:
    """Return the uncertainty for the first n configurations that are regular."""
    n = len(system.letters)
    refused = RankError(
        "too few configurations for Cramer's rule",
        measured=f"{len(system.names)} configuration(s) for {n} segment(s)",
        limit=f"{n}",
        next_step="add a shape for every segment",
    )
    for rows in combinations(range(len(system.names)), n):
        chosen, steps = system.take(rows), Steps()
        try:
            return sigma_program(chosen, free_factors(chosen, steps), steps)
        except RankError as error:
            refused = error
    raise refused


def write_new(path: Path, text: str) -> None:
    """Write a file that does not exist yet.

    Raises
    ------
    UsageError
        If it exists, or its folder does not.
    """
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        raise UsageError(
            "the file exists and is not overwritten",
            where=str(path),
            next_step="choose another name for -o, or remove it",
        ) from None
    except OSError as error:
        raise UsageError(f"cannot be written: {error.strerror}", where=str(path)) from error
