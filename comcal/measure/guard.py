# SPDX-License-Identifier: Apache-2.0
"""What stands between a recording and whatever moves a real robot.

Nothing is commanded but planned poses within the limits of the URDF, after somebody has consented,
and not after an abort. What the robot really does is watched on its own encoders.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from threading import Event

import numpy as np

from comcal.errors import HardwareError, UsageError
from comcal.measure.plan import PlannedPose
from comcal.measure.source import Block, HardwareCommander
from comcal.robot.model import Robot

DEFAULT_SPEED = 0.1
"""Of the fastest joint [rad/s] or [m/s]: six degrees per second, slow enough to step aside."""

LIMIT_SLACK = 1e-6
"""Rounding allowed beyond a joint limit [rad] or [m]."""

SPEED_FACTOR = 1.5
"""The robot is stopped when a joint is faster than this times the speed agreed upon ..."""
SPEED_SLACK = 0.03
"""... plus this [rad/s] or [m/s]: a tick of the encoder within the shortest span looked at."""
SHORTEST_SPAN = 0.05
"""Seconds over which a speed is measured."""


class GuardedCommander:
    """A commander of a real robot that refuses what was not planned.

    Parameters
    ----------
    commander : HardwareCommander
    robot : Robot
    plan : sequence of PlannedPose
        Everything that may be commanded, via-poses among them.
    speed : float
        Largest speed of a joint [rad/s] or [m/s], as the commander was told.
    consent : callable
        Is shown what is going to happen, and returns whether somebody agreed.
    """

    def __init__(
        self,
        commander: HardwareCommander,
        robot: Robot,
        plan: Sequence[PlannedPose],
        speed: float,
        consent: Callable[[str], bool],
    ) -> None:
        self._commander = commander
        self._robot = robot
        self._plan = tuple(plan)
        self._speed = speed
        self._consent = consent
        self._is_agreed = False
        self._is_stopped = Event()

    @property
    def speed(self) -> float:
        """Largest speed of a joint [rad/s] or [m/s]."""
        return self._speed

    @property
    def is_stopped(self) -> bool:
        """Whether somebody has stopped the robot; it stays so."""
        return self._is_stopped.is_set()

    def ask(self) -> None:
        """Ask for consent, unless it was given.

        Raises
        ------
        UsageError
            If nobody agrees.
        """
        if self._is_agreed:
            return
        ids = sorted({pose.pose for pose in self._plan})
        fastest = f"{self._speed:g} rad/s (or m/s), {np.degrees(self._speed):.1f} deg/s"
        text = (
            f"comcal is going to move {self._robot.name} to {len(ids)} planned poses, no joint "
            f"faster than {fastest}. Collisions on the way are not checked: keep clear, and keep "
            "the emergency stop at hand."
        )
        if not self._consent(text):
            raise UsageError(
                "nobody agreed that the robot moves",
                where="--commander",
                next_step="agree when asked on a terminal, type --yes, or leave out --commander "
                "and move the robot yourself",
            )
        self._is_agreed = True

    def move_to(self, pose: PlannedPose) -> None:
        """Start moving to a planned pose.

        Raises
        ------
        UsageError
            If the pose is not in the plan, lies outside the joint limits, or nobody consented.
        KeyboardInterrupt
            If the robot was stopped.
        """
        self._check_planned(pose)
        self._check_limits(pose)
        self.ask()
        if self.is_stopped:
            raise KeyboardInterrupt
        self._commander.move_to(pose)
        if self.is_stopped:  # by another thread, while the motion was being started
            self._commander.stop()
            raise KeyboardInterrupt

    def watch(self, block: Block) -> None:
        """Stop the robot if a joint is faster than was consented to.

        Parameters
        ----------
        block : Block
            The newest samples.

        Raises
        ------
        HardwareError
            If it is; the robot was told to stop.
        """
        span = float(block.t[-1] - block.t[0])
        if not span >= SHORTEST_SPAN or getattr(self._commander, "is_emulated", False):
            return
        speed = np.nan_to_num(np.abs(block.q[-1] - block.q[0]) / span)
        limit = SPEED_FACTOR * self._speed + SPEED_SLACK
        k = int(np.argmax(speed))
        if speed[k] <= limit:
            return
        self.stop()
        raise HardwareError(
            "moves faster than allowed, and was told to stop",
            where=f"joint {self._robot.tree.joint_names[k]}",
            measured=f"{speed[k]:.3g} rad/s (or m/s)",
            limit=f"{limit:.3g}",
            next_step="find out why before the robot moves again: gear, counts per turn and sign "
            "of this joint in robot.yaml, and the speed limit of its drive",
        )

    def stop(self) -> None:
        """Stop the robot, for good; callable from any thread."""
        self._is_stopped.set()
        self._commander.stop()

    def close(self) -> None:
        """Release the commander, which stops."""
        self._commander.close()

    def _check_planned(self, pose: PlannedPose) -> None:
        # By its angles: a repetition has an id of its own.
        if any(np.array_equal(planned.q, pose.q) for planned in self._plan):
            return
        raise UsageError(
            "this pose is not in the plan, so the robot is not sent there",
            where=f"pose {pose.pose}",
            next_step="add it to plan.csv",
        )

    def _check_limits(self, pose: PlannedPose) -> None:
        tree = self._robot.tree
        for name, q in zip(tree.joint_names, pose.q.tolist(), strict=True):
            joint = tree.joints[tree.joint_index[name]]
            if not joint.lower - LIMIT_SLACK <= q <= joint.upper + LIMIT_SLACK:
                raise UsageError(
                    f"joint {name} would leave its limits",
                    where=f"pose {pose.pose}",
                    measured=f"{q:.4f}",
                    limit=f"{joint.lower:.4f} to {joint.upper:.4f}",
                    next_step="correct the plan, or the limits in the URDF",
                )
