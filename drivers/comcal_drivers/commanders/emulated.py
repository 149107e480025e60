# SPDX-License-Identifier: Apache-2.0
"""Move the emulated robot: poses by number, over the bus that is being recorded."""

from __future__ import annotations

import struct

import can
import numpy as np

from comcal.errors import HardwareError, UsageError
from comcal.measure.plan import PlannedPose
from comcal.measure.source import CommanderRequest
from comcal_drivers.emulator.robot import (
    ABORT,
    ARRIVED,
    COMMAND_ID,
    MOVE,
    NOWHERE,
    REFUSED,
    STATE_ID,
)
from comcal_drivers.frames.batch import FrameBatch
from comcal_drivers.source.live import CanSource

PATIENCE = 20.0
"""How long the robot may take to stand in a pose [s]."""


class EmulatedCommander:
    """Tells the emulated robot in which pose of its plan to stand.

    Parameters
    ----------
    source : CanSource
        Whose main bus the robot listens to.
    plan : tuple of PlannedPose
    """

    is_emulated = True
    """It jumps from pose to pose; nothing that exists moves."""

    def __init__(self, source: CanSource, plan: tuple[PlannedPose, ...]) -> None:
        self._source = source
        self._plan = plan

    def move_to(self, pose: PlannedPose) -> None:
        """Send the robot to *pose* and wait until it stands there.

        Raises
        ------
        HardwareError
            If it does not answer, or cannot stand there.
        """
        same = next(
            (
                p.pose
                for p in self._plan
                if np.array_equal(p.q, pose.q) and p.support == pose.support
            ),
            pose.pose,
        )
        self._send(struct.pack("<HBH", pose.pose & 0xFFFF, MOVE, same & 0xFFFF))

        def answers(batch: FrameBatch, k: int) -> bool:
            return (
                int(batch.ids[k]) == STATE_ID
                and int(batch.lengths[k]) >= 3
                and int(batch.data[k, :2].view("<u2")[0]) == pose.pose & 0xFFFF
                and int(batch.data[k, 2]) in (ARRIVED, REFUSED)
            )

        answer = self._source.wait_for(answers, PATIENCE)
        if answer is None or answer[2] == REFUSED:
            raise HardwareError(
                f"the emulated robot does not take pose {pose.pose}",
                where=self._source.name,
                measured="no answer" if answer is None else "refused",
                limit=f"{PATIENCE:g} s",
                next_step="see that the emulator runs, and was given the same plan",
            )

    def stop(self) -> None:
        """Let the robot stop where it is."""
        self._send(struct.pack("<HB", NOWHERE, ABORT))

    def close(self) -> None:
        """Let go; the robot stands on."""

    def _send(self, data: bytes) -> None:
        self._source.send(can.Message(arbitration_id=COMMAND_ID, data=data, is_extended_id=False))


def open_emulated(request: CommanderRequest) -> EmulatedCommander:
    """Open the commander of the emulated robot.

    Raises
    ------
    UsageError
        If the source is not a CAN bus.
    """
    if not isinstance(request.source, CanSource):
        raise UsageError(
            "the emulated robot is moved over a CAN bus",
            where="--commander emulated",
            next_step="record with --source can",
        )
    return EmulatedCommander(request.source, request.plan)
