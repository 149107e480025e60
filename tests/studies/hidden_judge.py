# SPDX-License-Identifier: Apache-2.0
"""Whether what was said is what was hidden: equal changes, true values, right places."""

from __future__ import annotations

from collections.abc import Container, Sequence
from dataclasses import replace

import numpy as np
from hidden_scenario import scenario

from comcal.diagnose.diagnosis import Cause
from comcal.errors import UsageError
from comcal.measure.source import Block
from comcal.robot.changes import ALL, Change, check_changes
from comcal_sims.faults.mistakes import Mistakes

WIRING = ("channel_swap", "sign_flip", "unit_error", "frame_handedness", "left_right_swap")
SAME_FACTOR = 0.02
"""Relative difference of two factors that are the same unit."""
PLACES = {
    "eccentricity": "encoder",
    "hardening": "encoder",
    "torque_ripple": "current",
    "curvature": "sensor",
    "creep": "sensor",
    "sliding_mass": "link moment",
    "uneven_floor": "floor",
    "imu_curvature": "IMU",
}
"""Where the functions outside the catalogue act."""
EFFECTS_AT = {
    "encoder": ("joint_offset", "joint_compliance", "backlash", "hysteresis"),
    "current": ("joint_friction", "torque_constant", "current_offset"),
    "sensor": (
        "ft_bias",
        "ft_gain",
        "ft_crosstalk",
        "ft_mounting",
        "ft_position",
        "ft_drift",
        "ft_temperature",
    ),
    "link moment": ("payload", "link_mass", "link_com"),
    "floor": ("sole_compliance", "ground_tilt", "foot_placement"),
    "IMU": ("imu_mounting",),
}
"""Effects of the catalogue that act there."""
SINGLE = ("floor", "IMU")
"""Places of which there is one, whatever the target."""


def as_recorded(change: Change, poses: Container[int]) -> Change | None:
    """Return what is hidden in the poses that were recorded; None if it is in none of them.

    A pose in which the robot fell, or came to no rest, has no readings that could tell.
    """
    hidden_in = change.poses()
    if hidden_in is None:
        return change
    seen = tuple(pose for pose in hidden_in if pose in poses)
    return replace(change, parameters={**change.parameters, "poses": seen}) if seen else None


def same_change(one: Change, other: Change) -> bool:
    """Whether two changes are the same effect at the same place, whatever their sizes.

    Mistakes of wiring are the same if they do the same to all readings: turning an axis is
    changing two signs.
    """
    if one.effect in WIRING:
        return other.effect in WIRING and _same_wiring(one, other)
    if (one.effect, one.target) != (other.effect, other.target):
        return False
    if one.effect == "external_contact":
        touched, said = one.poses(), other.poses()
        if touched is None or said is None:
            return touched is said
        return set(touched) <= set(said)
    if one.effect == "frozen_sensor":
        return set(one.words("channels")) <= set(other.words("channels") or one.words("channels"))
    return True


def _same_wiring(one: Change, other: Change) -> bool:
    try:
        check_changes((one, other), scenario().robot)
    except UsageError:
        return False
    first, second = _spoilt(one), _spoilt(other)
    return bool(np.allclose(first, second, rtol=SAME_FACTOR, atol=0.0))


def _spoilt(change: Change) -> np.ndarray:
    """Return every reading after a mistake, from readings that are all different."""
    robot = scenario().robot
    n = len(robot.tree.joint_names)
    rng = np.random.default_rng(7)
    block = Block(
        t=np.zeros(1),
        q=rng.uniform(1.0, 1e3, (1, n)),
        wrenches={name: rng.uniform(1.0, 1e3, (1, 6)) for name in robot.sensors},
        currents=rng.uniform(1.0, 1e3, (1, n)),
        imu=rng.uniform(1.0, 1e3, (1, 3)),
    )
    spoiler = Mistakes(robot, (change,))
    spoiler.begin(1)
    found = spoiler.spoil(block)
    parts = [found.q, found.currents, found.imu, *found.wrenches.values()]
    return np.concatenate([np.ravel(part) for part in parts if part is not None])


def values_of(
    cause: Cause, hidden: Sequence[Change], changes: Sequence[Change]
) -> list[list[object]]:
    """Return key, truth, estimate and interval of every parameter of a cause that is true.

    The truth is what was hidden together with what the healthy robot has of the same. Empty for a
    cause that is not true. Where on its line a contact in one pose pushed is never said, so its
    point is not held against the one that was hidden.
    """
    truth = next((h for h in hidden if same_change(h, cause.change)), None)
    if truth is None or truth.effect in WIRING or truth.effect == "unknown":
        return []
    found = list[list[object]]()
    for key, estimate in cause.estimates.items():
        if cause.change.poses() and key.startswith("point_"):
            continue
        true = total(key, truth, changes)
        low, high = estimate.interval
        found.append([key, true, float(estimate.value), float(low), float(high)])
    return found


def total(key: str, truth: Change, changes: Sequence[Change]) -> float:
    """Return what a parameter comes to over all changes of one effect at one target, in one pose.

    Stiffnesses are in series, scales of a motor's torque multiply, all else adds up.
    """
    place = truth.effect, truth.target, truth.poses()
    same = [c for c in changes if (c.effect, c.target, c.poses()) == place] or [truth]
    if key == "stiffness":
        return 1.0 / sum(1.0 / c.number(key, np.inf) for c in same)
    if truth.effect == "torque_constant":
        return float(np.prod([1.0 + c.number(key) for c in same])) - 1.0
    return sum(c.number(key) for c in same)


def is_place(function: str, target: str, place: Sequence[str]) -> bool:
    """Whether something outside the catalogue acts where it is said to.

    Parameters
    ----------
    function, target : str
        The truth.
    place : sequence of str
        Place and target that were said.
    """
    kind = PLACES[function]
    return place[0] == kind and (kind in SINGLE or place[1] == target)


def acts_there(function: str, target: str, named: Sequence[str]) -> bool:
    """Whether a cause, ``effect@target``, was named where something outside the catalogue acts."""
    kind = PLACES[function]
    split = (name.partition("@") for name in named)
    return any(
        effect in EFFECTS_AT[kind] and (kind in SINGLE or at in (target, ALL))
        for effect, _, at in split
    )
