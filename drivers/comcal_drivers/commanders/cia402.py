# SPDX-License-Identifier: Apache-2.0
"""Move a robot with CiA 402 drives in profile position mode."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Sequence

import numpy as np

from comcal.errors import ComcalError, HardwareError, UsageError
from comcal.measure.plan import PlannedPose
from comcal.robot.tree import Array
from comcal_drivers.commanders.axis import Axis, Perform
from comcal_drivers.commanders.profile import equal_duration, motion_time
from comcal_drivers.commanders.watcher import LIMIT_SLACK, Motion, Watcher

ARRIVAL_FACTOR, ARRIVAL_SLACK = 1.5, 5.0
"""A motion may take this many times its computed length, plus this [s], before it has failed."""


class ProfilePositionCommander:
    """Sends the joints to planned poses; all of them arrive together.

    ``move_to`` returns when every drive has taken its target. A thread looks after the drives from
    then on: when one fails, all are stopped, and the next ``move_to`` says why. After a stop the
    drives hold their position (Quick Stop Active): a robot that stands must not be let go.

    Parameters
    ----------
    axes : sequence of Axis
        Joints without a drive are not moved.
    plan : sequence of PlannedPose
        Everything that may be commanded.
    speed : float
        Largest of any joint [rad/s].
    acceleration : float
        Largest of any joint [rad/s^2].
    release : callable
        Closes the buses.
    """

    def __init__(
        self,
        axes: Sequence[Axis],
        plan: Sequence[PlannedPose],
        speed: float,
        acceleration: float,
        release: Callable[[], None] = lambda: None,
    ) -> None:
        self._axes = tuple(axes)
        self._plan = tuple(plan)
        self._speed, self._acceleration = speed, acceleration
        self._release = release
        self._watcher = Watcher(self._axes, self._on_failure)
        self._moving = threading.Lock()
        self._gate = threading.Lock()
        self._stops = 0
        self._is_in_charge = self._may_reset = self._is_closed = False
        self._failure: HardwareError | None = None

    @property
    def is_moving(self) -> bool:
        """Whether a motion has neither ended nor been stopped."""
        return self._watcher.is_moving

    @property
    def failure(self) -> HardwareError | None:
        """Why the last motion was stopped, until ``move_to`` has said so."""
        return self._failure

    def move_to(self, pose: PlannedPose) -> None:
        """Start moving to a planned pose.

        Raises
        ------
        UsageError
            If the pose lies outside the joint limits, or is not in the plan.
        HardwareError
            If a drive has failed since the last motion, reports a fault or a following error, does
            not take its target in time, or if ``stop`` is called meanwhile. All drives were told
            to stop then.
        """
        self._check(pose)
        with self._moving:
            self._tell()
            stops = self._stops

            def perform(write: Callable[[], None]) -> None:
                with self._gate:
                    if self._stops != stops or self._is_closed:
                        raise HardwareError(
                            "the motion was stopped before it began",
                            where=f"pose {pose.pose}",
                            next_step="start again when the robot may move",
                        )
                    write()

            self._watcher.pause()
            try:
                self._move(pose.q, perform)
            except BaseException:
                # Whatever it was, half of the joints may be running by now.
                with contextlib.suppress(ComcalError):
                    self.stop()
                raise

    def stop(self) -> None:
        """Stop all joints where they are, now; callable from any thread, and repeatedly.

        Nothing happens before the first ``move_to``: until then the drives are not ours to stop.

        Raises
        ------
        HardwareError
            If a drive does not confirm that it stops; all have been told to.
        """
        self._stops += 1
        self._watcher.pause()
        if not self._is_in_charge:
            return
        errors: list[HardwareError] = []
        # Twice: at once, past everything that may be waiting for an answer; then, when no write
        # of the interrupted motion can follow any more, with a confirmation.
        for axis in self._axes:
            _collect(errors, axis.send_quick_stop)
        with self._gate:
            for axis in self._axes:
                _collect(errors, axis.quick_stop)
        if errors:
            raise errors[-1]

    def close(self) -> None:
        """Stop, and let go of the buses; the drives go on holding their position."""
        if self._is_closed:
            return
        try:
            self.stop()
        finally:
            self._is_closed = True
            self._watcher.close()
            self._release()

    def _move(self, q: Array, perform: Perform) -> None:
        if not self._is_in_charge:
            self._require_plausible_positions()
            self._is_in_charge, self._may_reset = True, True
        for axis in self._axes:
            axis.enable(perform, reset_fault=self._may_reset)
        self._may_reset = False
        here = np.array([axis.position() for axis in self._axes])
        target = [a.units.counts(float(q[a.column]), a.lower, a.upper) for a in self._axes]
        way = np.array([a.units.position(c) for a, c in zip(self._axes, target, strict=True)])
        speeds, accelerations = equal_duration(way - here, self._speed, self._acceleration)
        for k, axis in enumerate(self._axes):
            speed = axis.units.speed(float(speeds[k]))
            axis.prepare(perform, target[k], speed, axis.units.speed(float(accelerations[k])))
        for axis in self._axes:
            axis.start(perform)
        for axis in self._axes:
            axis.confirm(perform)
        longest = float(np.abs(way - here).max(initial=0.0))
        allowed = ARRIVAL_FACTOR * motion_time(longest, self._speed, self._acceleration)
        perform(
            lambda: self._watcher.begin(
                Motion(
                    {a.units.joint: float(v) for a, v in zip(self._axes, speeds, strict=True)},
                    time.monotonic() + allowed + ARRIVAL_SLACK,
                )
            )
        )

    def _require_plausible_positions(self) -> None:
        """Refuse drives that do not know where they are, before they get power."""
        for axis in self._axes:
            position = axis.position()
            if not axis.lower - LIMIT_SLACK <= position <= axis.upper + LIMIT_SLACK:
                raise axis.drive.failure(
                    "says that its joint is outside of the limits",
                    measured=f"{position:.4f} rad",
                    limit=f"{axis.lower:.4f} to {axis.upper:.4f} rad",
                    next_step="home the drive; check zero, gear, sign and counts_per_turn in "
                    "robot.yaml",
                )

    def _check(self, pose: PlannedPose) -> None:
        if not any(np.array_equal(planned.q, pose.q) for planned in self._plan):
            raise UsageError(
                "this pose is not in the plan, so the robot is not sent there",
                where=f"pose {pose.pose}",
                next_step="add it to plan.csv",
            )
        for axis in self._axes:
            q = float(pose.q[axis.column])
            if not axis.lower <= q <= axis.upper:
                raise UsageError(
                    f"joint {axis.units.joint} would leave its limits",
                    where=f"pose {pose.pose}",
                    measured=f"{q:.4f} rad",
                    limit=f"{axis.lower:.4f} to {axis.upper:.4f} rad",
                    next_step="correct the plan, or the limits in the URDF",
                )

    def _tell(self) -> None:
        if self._is_closed:
            raise HardwareError("the commander is closed", next_step="open it again")
        failure, self._failure = self._failure, None
        if failure is not None:
            raise failure

    def _on_failure(self, error: HardwareError) -> None:
        self._failure = error
        with contextlib.suppress(ComcalError):
            self.stop()


def _collect(errors: list[HardwareError], action: Callable[[], None]) -> None:
    try:
        action()
    except HardwareError as error:
        errors.append(error)
