# SPDX-License-Identifier: Apache-2.0
"""Who moves a real robot: a person, or a commander of the entry-point group that was asked for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from comcal.errors import UsageError
from comcal.measure.guard import DEFAULT_SPEED, GuardedCommander
from comcal.measure.operator import Nobody, Operator
from comcal.measure.plan import PlannedPose
from comcal.measure.source import CommanderRequest, HardwareCommander, Source
from comcal.robot.model import Robot
from comcal.workflow.extensions import extension_names, make_extension

GROUP = "comcal.commanders"

FASTEST = 1.0
"""No commander may be told to move a joint faster than this [rad/s] or [m/s]."""


def nobody_agrees(text: str) -> bool:
    """Consent to nothing."""
    return False


@dataclass(frozen=True)
class CommanderOrder:
    """Who is to move the robot, and who attends it.

    Parameters
    ----------
    name : str
        ``NAME`` or ``NAME:ARGUMENT``; empty: a person.
    speed : float
        Largest speed of any joint [rad/s] or [m/s].
    consent : callable
        Is shown what is going to happen, and returns whether somebody agreed.
    operator : Operator
    """

    name: str = ""
    speed: float = DEFAULT_SPEED
    consent: Callable[[str], bool] = nobody_agrees
    operator: Operator = field(default_factory=Nobody)


def commander_names() -> tuple[str, ...]:
    """Return the names of all installed commanders."""
    return extension_names(GROUP)


def open_commander(
    order: CommanderOrder,
    robot: Robot,
    plan: tuple[PlannedPose, ...],
    source: Source,
    on_open: Callable[[GuardedCommander], None],
) -> GuardedCommander:
    """Open a commander behind its guard, and ask for consent.

    Parameters
    ----------
    order : CommanderOrder
    robot : Robot
    plan : tuple of PlannedPose
        Everything that may be commanded, via-poses among them.
    source : Source
        Of the same recording, open.
    on_open : callable
        Is given the commander before anybody is asked, so that it is closed whatever happens.

    Raises
    ------
    UsageError
        If there is no such commander, the speed cannot be, or nobody agrees.
    MissingExtraError
        If a package that it needs is not installed.
    """
    name, _, argument = order.name.partition(":")
    check_speed(order.speed)
    request = CommanderRequest(
        robot=robot,
        plan=plan,
        options=robot.commanders.get(name) or {},
        speed=order.speed,
        argument=argument,
        source=source,
    )
    commander = make_extension(GROUP, name, request, HardwareCommander, "commander")
    guarded = GuardedCommander(commander, robot, plan, order.speed, order.consent)
    on_open(guarded)
    guarded.ask()
    return guarded


def check_speed(speed: float) -> None:
    """Refuse a speed at which nobody could react.

    Raises
    ------
    UsageError
        If it is not above zero and at most :data:`FASTEST`.
    """
    if not (np.isfinite(speed) and 0.0 < speed <= FASTEST):
        raise UsageError(
            "this is no speed for a robot beside a person",
            where="--speed",
            measured=f"{speed:g} rad/s",
            limit=f"above 0, at most {FASTEST:g} rad/s",
            next_step=f"leave it out for {DEFAULT_SPEED:g} rad/s",
        )
