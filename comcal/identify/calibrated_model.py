# SPDX-License-Identifier: Apache-2.0
"""The robot that a calibration hands back: every measured number, and as little else as possible.

The choice
----------
Static poses determine fewer directions than there are numbers in a URDF. Three models agree with
the data equally well on paper, and not at all on the robot:

- *Only components that are determined by themselves are replaced.* The total CoM is a sum over all
  links. Where CAD was wrong by a sum (both thighs together, say), a URDF in which only some terms
  of it are corrected can predict the total CoM worse than the one it came from.
- *Minimum norm*: what is not determined becomes zero. It reproduces the data and is no robot.
- *Least change*: of all models that reproduce everything the poses determine, single components
  and sums alike, the one nearest to the URDF.

The last one is taken. Near is measured in ``tolerances.link_com``, the same length for every
component of every link, so a sum of first moments is shared out in proportion to the squares of
the masses. Each component says where its number is from: ``measured`` (determined by itself),
``combination`` (a term of measured sums: the sums are measured, how they are shared out is not) or
``prior`` (the number of the URDF; no pose speaks about it, and it stays to the last digit).

Mass
----
The mass of the whole robot is measured, those of its links are not. What is seen of the CoMs are
first moments, so where the measured mass is not that of the URDF, CoMs that belong to the URDF's
masses would put the total CoM off by the same fraction of its distance from the root. In that case
(beyond :data:`MASS_AGREES` sigma) the fit is made with all masses multiplied by one factor, what
is carried as measured over what is carried in the URDF. The CoMs found then give the measured
total CoM whether the URDF's masses are multiplied too or left alone: a common factor cancels in a
centre of mass. It also cannot be told from a gain of the sensors, which is why masses are left
alone unless asked.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from comcal.errors import RankError
from comcal.identify.cad_inputs import cad_inputs
from comcal.identify.least_change import least_change
from comcal.identify.scope import Scope
from comcal.identify.solution import COMBINATION, PRIOR, Solution, sigmas, solve_all
from comcal.identify.unknowns import rigid_parts
from comcal.measure.table import PoseTable
from comcal.robot.model import Robot
from comcal.robot.tree import Array

MASS_AGREES = 2.0
"""A measured mass nearer to the URDF's than this many of its sigmas agrees with it."""


@dataclass(frozen=True)
class ModelLink:
    """One link of the calibrated robot.

    Parameters
    ----------
    com : array, shape (3,)
        In the link frame [m].
    sigma : array, shape (3,)
        [m]; from noise, and from ``tolerances`` for what is not measured.
    provenance : tuple of str, length 3
        ``measured``, ``combination`` or ``prior``.
    mass, mass_sigma : float
        [kg]; sigma NaN where the mass was not looked for.
    mass_provenance : str
        As for the CoM; ``combination`` where only the total was measured and shared out.
    factor : float
        Which multiple of the URDF's mass that is; its inertia is multiplied by the same.
    kept : str
        Why the link stays as the URDF has it; empty for links that are fitted.
    urdf_com : array, shape (3,)
        What the URDF says [m].
    """

    link: str
    com: Array
    sigma: Array
    provenance: tuple[str, str, str]
    mass: float
    mass_sigma: float
    mass_provenance: str
    factor: float
    kept: str
    urdf_com: Array


@dataclass(frozen=True)
class CalibratedModel:
    """The calibrated robot and the fit that it is from.

    Parameters
    ----------
    robot : Robot
        With the new CoMs, and masses if they were to change.
    solution : Solution
        With the masses of the URDF: the links and sums that ``result.json`` holds.
    fitted : Solution
        The one that the CoMs are from, with all masses multiplied by ``mass_ratio``.
    links : tuple of ModelLink
        Of every link, in tree order.
    mass_ratio : float
        Measured over URDF, of what the sensors carry; exactly 1 where both agree.
    masses_written : bool
        Whether the masses of ``robot`` follow the measured one.
    """

    robot: Robot
    solution: Solution
    fitted: Solution
    links: tuple[ModelLink, ...]
    mass_ratio: float
    masses_written: bool


def calibrated_model(
    robot: Robot, table: PoseTable, scope: Scope | None = None, *, scale_masses: bool = False
) -> CalibratedModel:
    """Return the model nearest to the URDF that reproduces everything the poses determine.

    Parameters
    ----------
    robot : Robot
        As in the URDF.
    table : PoseTable
    scope : Scope, optional
        What the all-data route uses and looks for. Where it looks for masses, those are in the
        model too.
    scale_masses : bool
        Multiply masses that were not looked for, so that the sensors carry what they measured.

    Raises
    ------
    RankError
        If a mass that was looked for comes out negative; else as of
        :func:`~comcal.identify.solution.solve_all`.
    MissingColumnError, NotFiniteError, DataError
        As of :func:`~comcal.identify.solution.solve_all`.
    """
    solution = solve_all(robot, table, scope, links_only=True)
    ratio = _mass_ratio(solution)
    fitted = solution
    if ratio != 1.0:
        scaled = _with_masses(robot, ratio)
        fitted = solve_all(scaled, table, scope, links_only=True)
    links = _model_links(robot, fitted, ratio if scale_masses else 1.0)
    tree_links = tuple(
        replace(old, mass=new.mass, com=new.com, inertia=old.inertia * new.factor)
        for old, new in zip(robot.tree.links, links, strict=True)
    )
    return CalibratedModel(
        robot=replace(robot, tree=replace(robot.tree, links=tree_links)),
        solution=solution,
        fitted=fitted,
        links=links,
        mass_ratio=ratio,
        masses_written=any(link.factor != 1.0 for link in links),
    )


def _mass_ratio(solution: Solution) -> float:
    """Return measured over URDF mass of what the sensors carry, 1 where they agree."""
    unknowns = solution.adjustment.unknowns
    if unknowns.free_masses or not np.isfinite(solution.mass):
        return 1.0
    urdf = unknowns.robot.tree.total_mass
    if abs(solution.mass - urdf) <= MASS_AGREES * solution.mass_sigma:
        return 1.0
    standing = [group for group in solution.adjustment.groups if not group.layout.hangs]
    poses = [len(group.rows) for group in standing]
    below = float(np.average([group.below_mass for group in standing], weights=poses))
    return (solution.mass - below) / (urdf - below)


def _with_masses(robot: Robot, factor: float) -> Robot:
    links = tuple(replace(link, mass=link.mass * factor) for link in robot.tree.links)
    return replace(robot, tree=replace(robot.tree, links=links))


def _model_links(robot: Robot, solution: Solution, scale: float) -> tuple[ModelLink, ...]:
    """Return every link of the model; *scale* multiplies masses that were not looked for."""
    fit = solution.adjustment
    unknowns = fit.unknowns
    kept = [_why_kept(robot, unknowns.links, k) for k in range(len(robot.tree.links))]
    wanted = [
        tuple(PRIOR if source is None or why else source for source in link.source)
        for link, why in zip(solution.links, kept, strict=True)
    ]
    keep = np.zeros(unknowns.size, dtype=np.bool_)
    for k in unknowns.links:
        column = unknowns.column(k)
        if column is not None:
            keep[column : column + 3] = [source == PRIOR for source in wanted[k]]
    theta, possible = least_change(fit, keep)
    masses = unknowns.link_masses(theta)
    cov = fit.cov + fit.cov_cad + cad_inputs(fit).cov
    links: list[ModelLink] = []
    for k, link in enumerate(robot.tree.links):
        com, sigma, provenance = link.com, np.full(3, robot.tolerances.link_com), wanted[k]
        column, mass_column = unknowns.column(k), unknowns.mass_column(k)
        stated = any(s.below and robot.below_cut[n][k] for n, s in robot.sensors.items())
        factor = 1.0 if stated else scale
        mass_source, mass_sigma = PRIOR if factor == 1.0 else COMBINATION, np.nan
        if mass_column is not None and not kept[k]:
            factor, mass_source = float(masses[k]) / link.mass, solution.links[k].mass_source
            mass_sigma = float(np.sqrt(cov[mass_column, mass_column]))
            _refuse_no_mass(link.name, float(masses[k]), mass_sigma)
        if column is not None and not kept[k]:
            if not possible:
                provenance = tuple(COMBINATION if s == PRIOR else s for s in provenance)
            at = slice(column, column + 3)
            rows = np.eye(unknowns.size)[at]
            if mass_column is not None:
                rows[:, mass_column] = -theta[at] / masses[k]
            is_prior = np.array([source == PRIOR for source in provenance])
            com = np.where(is_prior, link.com, theta[at] / masses[k])
            sigma = np.where(is_prior, sigma, sigmas(rows @ cov @ rows.T) / abs(masses[k]))
        links.append(
            ModelLink(
                link=link.name,
                com=com,
                sigma=sigma,
                provenance=(provenance[0], provenance[1], provenance[2]),
                mass=link.mass * factor,
                mass_sigma=mass_sigma,
                mass_provenance=mass_source,
                factor=factor,
                kept=kept[k],
                urdf_com=link.com,
            )
        )
    return tuple(links)


def _refuse_no_mass(link: str, mass: float, sigma: float) -> None:
    if mass <= 0.0:
        raise RankError(
            f"the mass found for {link!r} is not that of a body",
            where="links whose mass was looked for",
            measured=f"{mass:.3g} kg, sigma {sigma:.2g} kg",
            limit="above 0 kg",
            next_step="solve without free masses, or record poses that show this link",
        )


def _why_kept(robot: Robot, fitted: tuple[int, ...], k: int) -> str:
    """Return why a link stays as it is, or an empty string."""
    link = robot.tree.links[k]
    for sensor in robot.sensors.values():
        if sensor.below is not None and robot.below_cut[sensor.name][k]:
            return f"sensors.{sensor.name}.below of robot.yaml stands for it"
    if k in fitted:
        return ""
    if not link.has_inertial:
        return "no <inertial>: a frame without mass"
    bodies = rigid_parts(robot)
    for foot in robot.feet.values():
        if foot.sensor is not None and robot.below_cut[foot.sensor][k]:
            return f"below the cut of {foot.sensor}, which does not carry it"
    with_it = [other for other in fitted if bodies[other] == bodies[k]]
    if with_it:
        names = ", ".join(robot.tree.links[other].name for other in with_it)
        return f"fixed to {names}, which takes what the body as a whole is off by"
    return "too light to matter"
