# SPDX-License-Identifier: Apache-2.0
"""Fit a chain without URDF to poses whose CoM components are known, and predict held-out poses.

The case it was made for is the nineteen human postures of Cotton 2009, Table I, whose source does
not say which angle belongs to which joint; nothing here knows about people.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from comcal.errors import UsageError
from comcal.identify.convention_fit import (
    convention_spread,
    fit_convention,
    predict_convention,
    rounding_spread,
)
from comcal.identify.convention_ranking import rank_conventions
from comcal.identify.conventions import Conventions, stated_conventions
from comcal.identify.conventions_file import FILE_NAME, read_conventions
from comcal.identify.known_com import KnownCom, known_com
from comcal.identify.postures import PosePrediction, PosturesResult
from comcal.measure.table import PoseTable
from comcal.robot.model import Robot
from comcal.statics.sesc import common_axis, sesc_chain

DRAWS = 200
"""Tables drawn within the rounding, to rank readings and to spread predictions."""


def solve_postures(
    robot: Robot,
    table: PoseTable,
    *,
    held_out: Sequence[int] = (),
    conventions: Conventions | None = None,
    seed: int = 0,
    draws: int = DRAWS,
) -> PosturesResult:
    """Fit R to the poses that are not held out, then predict those that are.

    Parameters
    ----------
    robot : Robot
        Usually a chain without URDF; only the axes of its joints are used.
    table : PoseTable
        With at least one of ``com.x``, ``com.y``, ``com.z`` in every pose.
    held_out : sequence of int
        Ids of poses that are predicted. Their CoM is compared at the end and enters nothing else.
    conventions : Conventions or None
        The possible readings of the table. None: ``conventions.yaml`` beside robot.yaml if there is
        one, else the chain as robot.yaml states it.
    seed : int
    draws : int

    Returns
    -------
    PosturesResult

    Raises
    ------
    UsageError
        If a held-out pose is not in the table, or no pose is left to fit.
    MissingColumnError, NotFiniteError, RankError
        If the poses cannot carry a fit.
    """
    is_held_out = np.isin(table.pose, _checked(held_out, table))
    chain = sesc_chain(robot.tree, planar=_is_planar(robot, table))
    if conventions is None:
        conventions = _conventions_of(robot)
    fitting = known_com(table.select(~is_held_out), robot.tree)
    rng = np.random.default_rng(seed)
    ranking = rank_conventions(chain, conventions, fitting, rng, draws)
    reading = ranking.chosen.convention
    fit = fit_convention(chain, reading, fitting, conventions.rounding)

    predictions: tuple[PosePrediction, ...] = ()
    if held_out:
        poses = known_com(table.select(is_held_out), robot.tree)
        predicted = predict_convention(chain, reading, fit, poses, conventions.rounding)
        low, high = rounding_spread(
            chain, reading, fit, fitting, poses, conventions.rounding, rng, draws
        )
        lowest, highest = convention_spread(
            chain, [s.convention for s in ranking.tied], fitting, poses, conventions.rounding
        )
        predictions = tuple(
            PosePrediction(
                pose=poses.pose[poses.row[i]],
                component="xyz"[poses.component[i]],
                predicted=float(predicted.com[i]),
                half_width=float(predicted.half_width[i]),
                rounding=(float(low[i]), float(high[i])),
                conventions=(float(lowest[i]), float(highest[i])),
                measured=float(poses.com[i]),
            )
            for i in range(len(poses))
        )
    return PosturesResult(
        robot=robot.name,
        fitted=fitting.pose,
        conventions=conventions,
        ranking=ranking,
        fit=fit,
        columns=robot.tree.joint_names,
        labels=chain.labels,
        com_spread=_spread(fitting),
        predictions=predictions,
        seed=seed,
    )


def _checked(held_out: Sequence[int], table: PoseTable) -> list[int]:
    """Return the held-out ids, all of them poses of the table and not all poses."""
    missing = [pose for pose in held_out if pose not in table.pose]
    if missing:
        raise UsageError(
            f"no pose {', '.join(map(str, missing))} to hold out",
            where=table.source.name if table.source else "",
            next_step=f"the poses are {', '.join(map(str, table.pose))}",
        )
    if len(set(held_out)) == len(table):
        raise UsageError("every pose is held out, so none is left to fit")
    return list(held_out)


def _is_planar(robot: Robot, table: PoseTable) -> bool:
    """Return whether two columns per body suffice.

    They do if all joints turn about one axis and no component along that axis is given.
    """
    axis = common_axis(robot.tree)
    if axis is None:
        return False
    is_given = np.isfinite(table.com).any(axis=0)
    return bool(np.all(np.abs(axis[is_given]) < _PERPENDICULAR))


def _conventions_of(robot: Robot) -> Conventions:
    """Return ``conventions.yaml`` beside robot.yaml, or the chain as stated."""
    if robot.yaml_path is not None:
        path = robot.yaml_path.parent / FILE_NAME
        if path.is_file():
            return read_conventions(path, robot.tree)
    return stated_conventions(robot.tree)


def _spread(fitting: KnownCom) -> float:
    """Return the standard deviation of the component that varies most [m]."""
    return max(
        float(np.std(fitting.com[fitting.component == c])) for c in np.unique(fitting.component)
    )


_PERPENDICULAR = 1e-9
