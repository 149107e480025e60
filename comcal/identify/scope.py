# SPDX-License-Identifier: Apache-2.0
"""What a calibration uses and what it looks for."""

from __future__ import annotations

from dataclasses import dataclass

from comcal.identify.groups import Group, Rows, groups_of
from comcal.identify.unknowns import Unknowns, unknowns_of
from comcal.measure.table import PoseTable
from comcal.robot.model import Robot


@dataclass(frozen=True)
class Scope:
    """Which readings are used, and which numbers are unknown.

    Parameters
    ----------
    torques : bool
        Use joint torques and motor currents where there are any. They add no rank to foot
        wrenches; they sharpen weak directions and give a second opinion.
    free_masses : bool
        Look for the mass of every body, not only for that of the whole robot; sensors besides
        those of the feet then count as well.
    unknown_tares : bool
        Look for the offsets of force sensors together with the rest: of all but those whose tare
        is known (session.yaml), which stands with its sigma.
    """

    torques: bool = False
    free_masses: bool = False
    unknown_tares: bool = False

    @property
    def rows(self) -> Rows:
        """Which equations that takes.

        A cut below which links are free says nothing while their masses are held: it would weigh
        the URDF's masses against the measured ones.
        """
        rows = Rows.TORQUES if self.torques else Rows.BALANCE
        if self.free_masses:
            rows |= Rows.CUTS
        if self.unknown_tares:
            rows |= Rows.IDLE_CUTS
        return rows


def scoped(robot: Robot, table: PoseTable, scope: Scope) -> tuple[Unknowns, tuple[Group, ...]]:
    """Return the unknowns of a scope, and the poses that speak about them.

    Raises
    ------
    ConfigError, MissingColumnError, NotFiniteError, DataError
        As of :func:`~comcal.identify.groups.groups_of`.
    """
    groups = groups_of(robot, table, scope.rows)
    sensors: tuple[str, ...] = ()
    if scope.unknown_tares:
        used = {s for g in groups for s in g.carrier.sensors}
        used |= {cut.sensor for g in groups for cut in g.layout.cuts}
        used -= set(table.tare_cov)
        sensors = tuple(name for name in robot.sensors if name in used)
    return unknowns_of(robot, free_masses=scope.free_masses, offsets=sensors), groups
