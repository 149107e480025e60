# SPDX-License-Identifier: Apache-2.0
"""The pose table of a session, as everything downstream should read it."""

from __future__ import annotations

from comcal.measure.plausibility import check_plausible
from comcal.measure.poses_csv import read_poses
from comcal.measure.session import Session
from comcal.measure.table import PoseTable
from comcal.robot.model import Robot


def session_poses(session: Session, robot: Robot) -> PoseTable:
    """Read the usable poses of a session: tared, without superseded ones, and plausible.

    Parameters
    ----------
    session : Session
    robot : Robot
        As loaded from ``session.robot_yaml``.

    Raises
    ------
    ComcalError
        As of :func:`~comcal.measure.poses_csv.read_poses` and
        :func:`~comcal.measure.plausibility.check_plausible`.
    """
    table = read_poses(
        session.poses_csv,
        robot,
        session.tares(),
        superseded=session.superseded(),
        whole_lines=not session.is_handmade,  # a logger may leave out the last line end
    )
    check_plausible(table, robot)
    return table
