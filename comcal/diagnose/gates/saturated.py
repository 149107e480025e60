# SPDX-License-Identifier: Apache-2.0
"""Readings that stop at a level: several poses share the extreme value of a channel exactly."""

from __future__ import annotations

import numpy as np

from comcal.diagnose.diagnosis import Finding
from comcal.diagnose.gates.channels import Channel, Mask, channels, scatters, without
from comcal.diagnose.gates.gated import Gated, ids, listed
from comcal.diagnose.gates.residual_steps import ResidualSteps
from comcal.predict.assumed import Assumed
from comcal.robot.changes import Change

FEWEST, FEWEST_BLIND = 2, 3
"""Poses that must share it, with and without a standard deviation that says they stand still."""
NEAR = 3.0
"""Standard deviations of a sample: a mean nearer to the level has lost some of its samples."""
HELD = 25.0
"""Errors of a mean within which a single sample of the pose before lies: five times the noise of a
sample, averaged over 25."""


def saturated(assumed: Assumed, so_far: Gated) -> Gated:
    """Refuse readings at the level where a channel ends, and those so near that they touch it."""
    found = channels(assumed.robot, so_far.table)
    noisy = scatters(found)
    if noisy is False:
        return so_far
    steps = ResidualSteps(assumed, so_far.table)
    for channel in found:
        # An encoder without noise shares its largest angle with the plan.
        if so_far.is_coarse(channel.target, channel.name) or channel.name == "q":
            continue
        levels = _ends(channel, bool(noisy), steps)
        if levels:
            rows = np.asarray(np.any([rows for _, rows in levels], axis=0), np.bool_)
            so_far = _refused(so_far, channel, max(level for level, _ in levels), rows)
    return so_far


def _ends(channel: Channel, noisy: bool, steps: ResidualSteps) -> list[tuple[float, Mask]]:
    """Return the levels at which a channel ends, with the poses in which it does."""
    found: list[tuple[float, Mask]] = []
    if channel.is_constant:
        return found
    tells = noisy and channel.has_sd
    for side in (1.0, -1.0):
        size = side * channel.values
        level = float(np.nanmax(size))
        at = np.asarray(size >= level - channel.resolution, np.bool_)
        if level <= 0.0:
            continue
        if tells:
            at &= channel.stands_still
            ends = at.sum() >= FEWEST and channel.scatters.any()
            margin = NEAR * float(np.median(channel.sd[channel.scatters])) if ends else 0.0
        else:
            ends = at.sum() >= FEWEST_BLIND and steps.are_clear(channel, np.flatnonzero(at))
            margin = NEAR * float(np.sqrt(np.nan_to_num(np.nanmedian(channel.variance))))
        if ends and not _holds(channel, at):
            found.append((level, np.asarray(size > level - max(margin, channel.resolution))))
    inside = channel.stands_still & ~np.any([rows for _, rows in found], axis=0)
    # What also stands still elsewhere lies on a grid, or is frozen.
    return [] if tells and inside.any() else found


def _holds(channel: Channel, at: Mask) -> bool:
    """Return whether one stretch of poses goes on with the reading of the pose before: frozen."""
    rows = np.flatnonzero(at)
    if np.any(np.diff(rows) != 1):
        return False
    first = int(rows[0])
    step = abs(channel.values[first] - channel.values[first - 1]) if first else 0.0
    return bool(step <= HELD * np.sqrt(channel.variance[first]))


def _refused(so_far: Gated, channel: Channel, level: float, rows: Mask) -> Gated:
    poses, target = ids(so_far.table, rows), channel.target
    parameters = {"channels": (channel.name,), "level": level}
    finding = Finding(
        "saturation",
        target,
        Change("saturation", target, parameters),
        f"{target} {channel.name}: never beyond {level:.4g} {channel.unit}, reached in "
        f"{listed(poses)}",
        poses,
        "readings left out",
        "use a larger range of the sensor, or poses that load it less",
    )
    return so_far.found(without(so_far.table, channel, rows), (finding,))
