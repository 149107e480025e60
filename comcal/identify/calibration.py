# SPDX-License-Identifier: Apache-2.0
"""Both routes over one pose table, and the verdict on them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from comcal.errors import RankError
from comcal.identify.consistent import ConsistentFit
from comcal.identify.difference import RouteDifference, route_difference
from comcal.identify.groups import groups_of
from comcal.identify.paper_route import PaperRoute, paper_route
from comcal.identify.prior import PriorFit
from comcal.identify.scope import Scope
from comcal.identify.solution import Solution, solve_all
from comcal.identify.torque_readings import unused_currents
from comcal.measure.plan import NONE
from comcal.measure.table import PoseTable
from comcal.robot.model import Limits, Robot
from comcal.statics.coefficients import BalanceCoefficients, balance_coefficients
from comcal.statics.support import measured_supports

SAME_SHAPE = np.deg2rad(1.0)
"""Joints that move by less from pose to pose leave the shape as it is [rad]."""

MISFIT = 1e-4
"""Probability of the misfit below which the model does not explain the data."""


class Method(Enum):
    """Which routes to take."""

    BOTH = "both"
    CRAMER = "cramer"
    LSTSQ = "lstsq"


class Verdict(Enum):
    """The last word of a calibration."""

    PASSED = "passed"
    FAILED = "failed"
    NO_LIMITS = "no_limits"
    NOT_IDENTIFIABLE = "not_identifiable"


@dataclass(frozen=True)
class Check:
    """One limit and what was measured against it; SI."""

    name: str
    measured: float
    limit: float
    unit: str

    @property
    def passed(self) -> bool:
        """Whether the limit is met; NaN never meets one."""
        return bool(self.measured <= self.limit)


@dataclass(frozen=True)
class Calibration:
    """What a session says about a robot.

    Parameters
    ----------
    coefficients : BalanceCoefficients or None
        None when no pose has a wrench (given CoMs only).
    solution : Solution or None
        The all-data route; None where it was not asked for or has no data.
    paper : PaperRoute or None
        The paper's route; None where it was not asked for.
    difference : RouteDifference or None
    reason : str
        Why the verdict is ``not_identifiable``, and the pose that would change it; or why limits
        that are set were not judged.
    without_torques : Solution or None
        The all-data route from foot wrenches alone, where torques took part.
    notes : tuple of str
        What was asked for and could not be used, beside the notes of the table.
    with_prior : PriorFit or None
        The all-data route joined with CAD, where that was asked for.
    consistent : ConsistentFit or None
        The physically possible robot nearest to it, where that was asked for.
    reference : str
        What ``robot`` describes, in words: its URDF, or a model that extends it.
    """

    robot: Robot
    table: PoseTable
    coefficients: BalanceCoefficients | None
    solution: Solution | None
    paper: PaperRoute | None
    difference: RouteDifference | None
    checks: tuple[Check, ...]
    verdict: Verdict
    reason: str = ""
    without_torques: Solution | None = None
    notes: tuple[str, ...] = ()
    with_prior: PriorFit | None = None
    consistent: ConsistentFit | None = None
    reference: str = "the URDF"


def calibrate(
    robot: Robot,
    table: PoseTable,
    method: Method = Method.BOTH,
    scope: Scope | None = None,
    held_out: PoseTable | None = None,
) -> Calibration:
    """Take both routes (or one) and judge the result by the robot's limits.

    Parameters
    ----------
    robot : Robot
    table : PoseTable
    method : Method
    scope : Scope, optional
        What the all-data route uses and looks for.
    held_out : PoseTable, optional
        Poses to predict and not to fit; by default the all-data route cross-validates.

    Raises
    ------
    RankError
        If Cramer's rule was asked for and does not apply, or no pose loads a sensor.
    MissingColumnError, NotFiniteError, DataError
        If the wrench or the error of a loaded sensor is not known.
    """
    scope = scope or Scope()
    measured = has_wrenches(robot, table)
    paper = paper_route(robot, table) if method is not Method.LSTSQ else None
    if paper is not None and method is Method.CRAMER and not paper.choices:
        raise RankError(
            f"Cramer's rule does not apply: {paper.reason}",
            where=str(table.source or "pose table"),
            next_step="add the poses named, or use --method lstsq",
        )
    solution, without_torques = None, None
    if method is not Method.CRAMER and (measured or _has_torques(robot, table, scope)):
        solution = solve_all(robot, table, scope, held_out=held_out)
        used = any(group.layout.torques for group in solution.adjustment.groups)
        if used and measured:
            alone = replace(scope, torques=False)
            without_torques = solve_all(robot, table, alone, held_out=held_out)
    elif method is Method.LSTSQ:
        raise RankError(
            "the all-data route needs foot wrenches; this session has none of a standing pose",
            where=str(table.source or "pose table"),
            next_step="record poses with support 'double' or one foot; where the CoMs are given, "
            "use --method cramer",
        )
    difference = None
    if solution and paper and not scope.free_masses:  # the paper's route takes masses as given
        difference = route_difference(solution.adjustment, paper, table)
    reason = _not_identifiable(robot, table, solution, paper)
    checks = _checks(robot.limits, robot, solution)
    if reason:
        verdict = Verdict.NOT_IDENTIFIABLE
    elif not checks:
        verdict = Verdict.NO_LIMITS
        if robot.limits != Limits():
            reason = "limits are judged by the all-data route, which was not taken"
    else:
        verdict = Verdict.PASSED if all(c.passed for c in checks) else Verdict.FAILED
    return Calibration(
        robot=robot,
        table=table,
        coefficients=balance_coefficients(robot, table) if measured else None,
        solution=solution,
        paper=paper,
        difference=difference,
        checks=checks,
        verdict=verdict,
        reason=reason,
        without_torques=without_torques,
        notes=tuple(note for note in (unused_currents(robot, table),) if note and scope.torques),
    )


def _has_torques(robot: Robot, table: PoseTable, scope: Scope) -> bool:
    """Return whether some pose has a torque that statics explains without any foot sensor."""
    return scope.torques and bool(groups_of(robot, table, scope.rows))


def has_wrenches(robot: Robot, table: PoseTable) -> bool:
    """Return whether the load of any standing pose is measured.

    Raises
    ------
    ConfigError, MissingColumnError, NotFiniteError
        If a standing pose has neither a wrench nor its CoM or CoP.
    """
    return any(True for _ in measured_supports(robot, table))


def _checks(limits: Limits, robot: Robot, solution: Solution | None) -> tuple[Check, ...]:
    if solution is None:
        return ()
    checks: list[Check] = []
    if limits.com_error is not None:
        upper = solution.held_out.com_upper
        checks.append(Check("held-out CoM error, upper 95 %", upper, limits.com_error, "m"))
    if limits.mass_error is not None:
        error = abs(solution.mass - robot.tree.total_mass)
        checks.append(Check("mass against the URDF", error, limits.mass_error, "kg"))
    return tuple(checks)


def _not_identifiable(
    robot: Robot, table: PoseTable, solution: Solution | None, paper: PaperRoute | None
) -> str:
    """Return why nothing about single links is determined, or an empty string."""
    if paper is not None and len(paper.choices) > 0:
        return ""
    if all(support == NONE for support in table.support):
        return (
            "the robot is held in every pose, so neither its mass nor its total CoM is determined, "
            "whatever the joint torques fit; record poses in which a foot with a sensor stands"
        )
    if solution is None:
        return paper.reason if paper is not None else "no route was taken"
    if is_one_shape(robot, table):
        remedies = sorted({u.remedy for u in solution.unseen if "by itself" in u.remedy})
        return "all poses are one shape, so no link can be told from another; " + (
            remedies[0] if remedies else "bend one joint at a time by 30 deg or more"
        )
    if solution.adjustment.dof <= 0:
        return (
            f"{len(solution.poses)} pose(s) leave no redundancy; record more shapes: bend one "
            "joint at a time by 30 deg or more"
        )
    return ""


def is_one_shape(robot: Robot, table: PoseTable) -> bool:
    """Return whether nothing but the ankles moved from pose to pose (one degree counts)."""
    stands = [i for i, support in enumerate(table.support) if support != NONE]
    ankles = {foot.ankle for foot in robot.feet.values()}
    others = [k for k, name in enumerate(robot.tree.joint_names) if name not in ankles]
    if not others or not stands:
        return True
    return bool(np.ptp(table.q[np.ix_(stands, others)], axis=0).max() < SAME_SHAPE)
