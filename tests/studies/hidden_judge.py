# SPDX-License-Identifier: Apache-2.0
"""Whether what was said is what was hidden: equal changes, true values, right places."""

from __future__ import annotations

from collections.abc import Sequence

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
    "imu_curvature": "imu",
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
    "imu": ("imu_mounting",),
}
"""Effects of the catalogue that act there."""


def same_change(one: Change, other: Change) -> bool:
    """Whether two changes are the same effect at the same place, whatever their sizes.

    Mistakes of wiring are the same if they do the same to all readings: turning an axis is
    changing two signs.
    """
    if one.effect in WIRING:
        return other.effect in WIRING and _same_wiring(one, other)
    if (one.effect, one.target) != (other.effect, other.target):
        return False
    if one.effect == "external_contact" and one.poses() is not None:
        return set(one.poses() or ()) <= set(other.poses() or ())
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
    cause that is not true.
    """
    truth = next((h for h in hidden if same_change(h, cause.change)), None)
    if truth is None or truth.effect in WIRING or truth.effect == "unknown":
        return []
    found = list[list[object]]()
    for key, estimate in cause.estimates.items():
        true = total(key, truth, changes)
        low, high = estimate.interval
        found.append([key, true, float(estimate.value), float(low), float(high)])
    return found


def total(key: str, truth: Change, changes: Sequence[Change]) -> float:
    """Return the sum of a parameter over all changes of one effect at one target."""
    same = [c for c in changes if (c.effect, c.target) == (truth.effect, truth.target)]
    same = same or [truth]
    if key == "stiffness":
        return 1.0 / sum(1.0 / c.number(key, np.inf) for c in same)
    return sum(c.number(key) for c in same)


def in_right_place(
    function: str, target: str, place: Sequence[str] | None, named: Sequence[str]
) -> bool:
    """Whether what is said of something outside the catalogue points at where it is.

    Parameters
    ----------
    function, target : str
        The truth.
    place : sequence of str or None
        Place and target that were said.
    named : sequence of str
        Causes, as ``effect@target``.
    """
    kind = PLACES[function]
    if place is not None and place[0] == kind and (kind == "floor" or place[1] == target):
        return True
    for name in named:
        effect, _, at = name.partition("@")
        if effect in EFFECTS_AT[kind] and (kind in ("floor", "imu") or at in (target, ALL)):
            return True
    return False
