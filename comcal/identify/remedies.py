# SPDX-License-Identifier: Apache-2.0
"""The pose that would show what the poses of a session do not determine."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from comcal.errors import ConfigError
from comcal.identify.adjust import Adjustment
from comcal.identify.linearise import model_at, regressor
from comcal.robot.frames import apply, rotation_about
from comcal.robot.model import Robot
from comcal.robot.tree import Array
from comcal.statics.balance import balance_at
from comcal.statics.configurations import foot_side_links
from comcal.statics.stance import stance_frame
from comcal.statics.static_rows import row_jacobian
from comcal.statics.support import Carrier, carrier_of

SHOWN = 0.01
"""A trial pose shows a direction when it reacts to it with this share of what it could, ..."""
MORE_THAN_BEFORE = 3.0
"""... and by this factor more than the poses there are, which react to it by noise."""
BENT_TOGETHER = 4
"""Trial poses in which all joints are bent."""
TRIAL_BEND = 0.5
"""Angle by which a trial pose bends one joint [rad], or metres by which it moves a slide."""
TRIAL_SLOPE = 0.2
"""Slope of a trial pose [rad]."""


@dataclass(frozen=True)
class Remedies:
    """Poses that might show something, by what they do to the rows.

    Parameters
    ----------
    gravity : float
        [m/s^2]
    of_feet : array of bool, shape (size,)
        Unknowns of links on the feet's side of the standing ankles.
    session : list of array, shape (n_rows, size)
        Regressor of each of the poses there are.
    bends, others : list of (words, array of shape (4, size))
        One joint bent; the other foot.
    slopes, together : list of (words, array of shape (4, size))
        The first pose on slopes; all joints bent, on slopes, on one foot: on two feet the legs are
        not free.
    """

    gravity: float
    of_feet: npt.NDArray[np.bool_]
    session: list[Array]
    bends: list[tuple[str, Array]]
    others: list[tuple[str, Array]]
    slopes: list[tuple[str, Array]]
    together: list[tuple[str, Array]]

    @classmethod
    def around(cls, adjustment: Adjustment) -> Remedies:
        """Return what poses around those of a session would do."""
        unknowns, groups = adjustment.unknowns, adjustment.groups
        robot = unknowns.robot
        session: list[Array] = []
        for group in groups:
            balance = group.balance_at(robot, group.inputs)
            wrenches, _ = group.others(group.inputs)
            model = model_at(unknowns, group, adjustment.theta)
            B = row_jacobian(group.layout, balance, wrenches, model)
            session += [*regressor(balance, unknowns, balance.direction, group.layout, B)]
        one_foot = [*_one_foot_carriers(robot)]
        first = next((group for group in groups if not group.layout.hangs), None)
        up, q, carrier = np.array([0.0, 0.0, 1.0]), groups[0].q[0], None
        if first is not None:
            balance = first.balance_at(robot, first.inputs)
            R, _ = stance_frame(robot, first.carrier.support, balance.placements)
            up, q, carrier = R[0].T @ balance.direction[0], first.q[0], first.carrier
        elif one_foot:
            carrier = one_foot[0]
        if carrier is None:  # nothing measures what a foot carries: there is nothing to try
            nobody = np.zeros(unknowns.size, np.bool_)
            return cls(robot.gravity, nobody, session, [], [], [], [])

        def rows(carrier: Carrier, q: Array, up_in_P: Array) -> Array:
            unloaded = np.ones((1, len(carrier.sensors), 6))
            balance = balance_at(robot, carrier, q[None], unloaded)
            R, _ = stance_frame(robot, carrier.support, balance.placements)
            return regressor(balance, unknowns, apply(R, up_in_P))[0]

        n_joints = len(q)
        bends = [
            (f"a pose that moves {name} by itself", rows(carrier, q + bend, up))
            for name, bend in zip(
                robot.tree.joint_names, TRIAL_BEND * np.eye(n_joints), strict=True
            )
        ]
        measured = {group.carrier.support for group in groups}
        others = [
            (f"a pose standing on the {other.support} foot", rows(other, q, up))
            for other in one_foot
            if other.support not in measured
        ]
        leans = [rotation_about(axis, TRIAL_SLOPE) @ up for axis in np.eye(3)[:2]]
        slopes = [("a pose on a slope", rows(carrier, q, lean)) for lean in leans]
        together = [
            (
                f"a pose on the {other.support} foot that moves several joints, on a slope,",
                rows(
                    other,
                    q + TRIAL_BEND * np.cos(k * (1.0 + np.arange(n_joints))),
                    leans[k % 2],
                ),
            )
            for other in one_foot
            for k in range(1, BENT_TOGETHER + 1)
        ]
        side = foot_side_links(robot, carrier)[list(unknowns.links)]
        of_feet = np.zeros(unknowns.size, np.bool_)
        of_feet[unknowns.n_masses : unknowns.first_offset] = np.repeat(side, 3)
        if unknowns.free_masses:
            of_feet[: unknowns.n_masses] = side
        return cls(robot.gravity, of_feet, session, bends, others, slopes, together)

    def of_direction(self, direction: Array, large: npt.NDArray[np.bool_]) -> str:
        """Return the first pose that shows a direction.

        One made of standing feet only is tried on a slope first: no bent joint moves them.

        Parameters
        ----------
        direction : array, shape (size,)
            Change of the unknowns.
        large : array of bool, shape (size,)
            Which of them take part by more than noise.
        """
        in_session = max(self._reaction(rows, direction) for rows in self.session)
        first = self.slopes if bool(np.all(self.of_feet[large])) else []
        for words, rows in (*first, *self.bends, *self.others, *self.slopes, *self.together):
            shown = self._reaction(rows, direction)
            if shown > max(SHOWN, MORE_THAN_BEFORE * in_session):
                return f"{words} would show it"
        return "no pose shows it: it is merged along joint axes; fill it from CAD if it is needed"

    def _reaction(self, rows: Array, direction: Array) -> float:
        """Return a pose's reaction as a share of what the parts would add up to, if they did."""
        whole = self.gravity * np.linalg.norm(direction)
        return float(np.linalg.norm(rows @ direction) / whole)


def _one_foot_carriers(robot: Robot) -> Iterator[Carrier]:
    """Yield what carries the robot on each foot whose load is measured."""
    for foot in robot.feet:
        try:
            yield carrier_of(robot, foot)
        except ConfigError:  # nothing measures what this foot carries
            continue
