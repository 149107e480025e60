# SPDX-License-Identifier: Apache-2.0
"""The pose table of a session, as everything downstream should read it."""

from __future__ import annotations

from dataclasses import replace

from comcal.measure.plausibility import check_plausible, implausibilities
from comcal.measure.poses_csv import read_poses
from comcal.measure.session import Session
from comcal.measure.table import PoseTable
from comcal.robot.model import Robot


def session_poses(session: Session, robot: Robot, *, doubtful: bool = False) -> PoseTable:
    """Read the usable poses of a session: tared, without superseded ones, and plausible.

    Parameters
    ----------
    session : Session
    robot : Robot
        As loaded from ``session.robot_yaml``.
    doubtful : bool
        Let what cannot be true pass with a note: to find out what is wrong, it has to be read.

    Raises
    ------
    ComcalError
        As of :func:`~comcal.measure.poses_csv.read_poses` and
        :func:`~comcal.measure.plausibility.check_plausible`.
    """
    table = unjudged_poses(session, robot)
    if doubtful:
        return replace(table, notes=(*table.notes, *_doubts(table, robot)))
    check_plausible(table, robot)
    return table


def unjudged_poses(session: Session, robot: Robot) -> PoseTable:
    """Read the usable poses of a session, whether or not they can be true as they stand.

    Parameters
    ----------
    session : Session
    robot : Robot

    Raises
    ------
    ComcalError
        As of :func:`~comcal.measure.poses_csv.read_poses`.
    """
    return read_poses(
        session.poses_csv,
        robot,
        session.tares(),
        superseded=session.superseded(),
        whole_lines=not session.is_handmade,  # a logger may leave out the last line end
    )


def _doubts(table: PoseTable, robot: Robot) -> tuple[str, ...]:
    """Return the likeliest reason why a table cannot be true, and how many follow from it."""
    errors = list(implausibilities(table, robot))
    more = f" (and {len(errors) - 1} more)" if len(errors) > 1 else ""
    return tuple(f"cannot be true: {error}{more}" for error in errors[:1])
