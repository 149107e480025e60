# SPDX-License-Identifier: Apache-2.0
"""Which world realises which effect; what none can do is refused with those that can."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from comcal.errors import UsageError
from comcal.robot.changes import Change, check_changes, names_of, target_kind
from comcal.robot.changes_kinds import Realisation, TargetKind
from comcal.robot.changes_table import EFFECTS
from comcal.robot.changes_text import change_text, parse_change
from comcal.robot.model import Robot
from comcal.robot.validate import did_you_mean

WORLDS = ("builtin", "pybullet", "mujoco")
"""Names of the simulated sources."""

_MOVING = ("not_settled", "timing_skew")
"""Effects that show only while something moves, which nothing does in plain statics."""

FUNCTIONS: Mapping[str, TargetKind] = {
    "eccentricity": TargetKind.JOINT,
    "hardening": TargetKind.JOINT,
    "torque_ripple": TargetKind.JOINT,
    "curvature": TargetKind.SENSOR,
    "creep": TargetKind.SENSOR,
    "sliding_mass": TargetKind.LINK,
    "uneven_floor": TargetKind.FOOT,
    "imu_curvature": TargetKind.IMU,
}
"""Functions of ``unknown`` by the kind of place at which they sit.

Amplitudes: eccentricity [rad], joint = encoder + a sin(q + phase); hardening [rad], a tanh(tau /
20 N m); torque_ripple [N m], a sin(7 q + phase) at the motor; curvature [1/N], fz + a fz^2; creep
[1], share of the load before that stays; sliding_mass [m], CoM of a link moved along its x where
that points down; uneven_floor [rad], random tilt under a foot, another one in every pose;
imu_curvature [s^2/m], a + c a^2.
"""


def worlds_for(effect: str) -> tuple[str, ...]:
    """Return the names of the simulated sources that realise an effect."""
    spec = EFFECTS.get(effect)  # what another package brings is not simulated here
    if spec is None or spec.realisation is Realisation.NONE:
        return ()
    return WORLDS[1:] if effect in _MOVING else WORLDS


def hidden_changes(texts: Sequence[str], robot: Robot, world: str) -> tuple[Change, ...]:
    """Return what ``--effect`` arguments ask of one world.

    Parameters
    ----------
    texts : sequence of str
    robot : Robot
        As designed.
    world : str
        One of :data:`WORLDS`.

    Raises
    ------
    UsageError
        If one is not valid for this robot, or this world cannot realise it; the message names
        those that can.
    """
    changes = tuple(parse_change(text) for text in texts)
    check_changes(changes, robot, "--effect")
    for change in changes:
        able = worlds_for(change.effect)
        if world not in able:
            raise UsageError(
                f"the source {world} cannot make {change.effect}",
                where=f"--effect {change_text(change)}",
                next_step=f"use --source {' or '.join(able)}"
                if able
                else "no simulated robot can: it belongs to the model or to recorded motion",
            )
        if change.effect == "unknown":
            _check_function(change, robot)
    return changes


def _check_function(change: Change, robot: Robot) -> None:
    words = change.words("function")
    name = words[0] if len(words) == 1 else ""
    if name not in FUNCTIONS:
        raise UsageError(
            f"there is no function {'+'.join(words)!r}",
            where=f"--effect {change_text(change)}",
            next_step=did_you_mean(name, list(FUNCTIONS)),
        )
    if change.target not in names_of(robot, FUNCTIONS[name]):
        kind = target_kind(change, robot)
        raise UsageError(
            f"{name} sits at a {FUNCTIONS[name].value}, not at a {kind.value}",
            where=f"--effect {change_text(change)}",
            next_step=f"functions there: "
            f"{', '.join(f for f, k in FUNCTIONS.items() if k is kind) or 'none'}",
        )
