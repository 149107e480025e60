# SPDX-License-Identifier: Apache-2.0
"""Readings that repeat themselves: a sensor with noise never gives the same number twice.

Where windows tell their standard deviation, one that is zero betrays a frozen reading even in a
single pose, as long as others scatter. Where they do not, the same number in consecutive poses
does, if the reading should have changed. A table without any noise shows whole sensors only.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from comcal.diagnose.diagnosis import Finding
from comcal.diagnose.gates.channels import (
    Channel,
    Mask,
    channels,
    instruments,
    scatters,
    without,
)
from comcal.diagnose.gates.gated import Gated, ids, listed
from comcal.diagnose.gates.residual_steps import ResidualSteps
from comcal.predict.assumed import Assumed
from comcal.robot.changes import Change

FEWEST_ALONE = 3
"""Consecutive poses in which one channel of several must repeat; of whole sensors two do."""


def frozen_instruments(assumed: Assumed, so_far: Gated) -> Gated:
    """Refuse readings of force/torque sensors and IMUs that repeat all their channels."""
    found = channels(assumed.robot, so_far.table)
    steps = ResidualSteps(assumed, so_far.table)
    for of in instruments(found):
        fine = tuple(c for c in of if not so_far.is_coarse(c.target, c.name))
        if fine:
            rows = _frozen(fine, scatters(found), steps, 2)
            so_far = _refused(so_far, of, rows)
    return so_far


def frozen_channels(assumed: Assumed, so_far: Gated) -> Gated:
    """Refuse readings of single channels that repeat: of a sensor, an encoder, a motor."""
    found = channels(assumed.robot, so_far.table)
    noisy = scatters(found)
    if noisy is False:
        return so_far
    steps = ResidualSteps(assumed, so_far.table)
    by_rows: dict[tuple[str, bytes], tuple[list[Channel], Mask]] = {}
    for channel in found:
        if so_far.is_coarse(channel.target, channel.name):
            continue
        alone = channel.name in ("q", "i", "tau")
        rows = _frozen((channel,), noisy, steps, 2 if alone else FEWEST_ALONE)
        if rows.any():
            by_rows.setdefault((channel.target, rows.tobytes()), ([], rows))[0].append(channel)
    for of, rows in by_rows.values():
        so_far = _refused(so_far, of, rows)
    return so_far


def _frozen(of: Sequence[Channel], noisy: bool | None, steps: ResidualSteps, least: int) -> Mask:
    """Return in which poses all channels given are frozen, shape (N,)."""
    # An encoder that stands on one step of its grid is at rest, not frozen.
    if noisy and of[0].name != "q" and all(c.has_sd for c in of):
        still = np.all([c.stands_still for c in of], axis=0)
        # Windows that never scatter, about values that differ, are those of a heavy filter.
        stopped = all(c.is_constant for c in of) and any(np.nanmax(np.abs(c.values)) for c in of)
        told = stopped or any(c.scatters.any() for c in of)
        return np.asarray(still & told & (not _steps_about(of, still)), np.bool_)
    rows = np.zeros(len(of[0].values), np.bool_)
    if not any(np.nanmax(np.abs(c.values)) > 0.0 for c in of):
        return rows
    for run in _runs(of):
        if len(run) < least or not any(c.values[run[0]] for c in of):
            continue
        if any(steps.are_clear(c, run) for c in of):
            # Encoders have no noise: the first number was still right. Others have, and a mean
            # that equals a single sample is frozen as well.
            rows[run[1:] if of[0].name == "q" else run] = True
    if of[0].name == "q":
        rows &= _moved(of[0], steps)
    return rows


def _steps_about(of: Sequence[Channel], still: Mask) -> bool:
    """Return whether windows stand still as on a grid: here and there, and again, or side by side.

    A frozen reading keeps its number until it thaws, and never finds it again.
    """
    rows = np.flatnonzero(still)
    same = np.all([np.abs(np.diff(c.values[rows])) <= c.resolution for c in of], axis=0)
    if np.any((np.diff(rows) == 1) & ~same):
        return True
    firsts = np.concatenate([rows[:1], rows[1:][(np.diff(rows) > 1) | ~same]])
    values = np.column_stack([np.round(c.values[firsts] / (10.0 * c.resolution)) for c in of])
    return len(np.unique(values, axis=0)) < len(firsts)


def _runs(of: Sequence[Channel]) -> Iterator[np.ndarray]:
    """Yield stretches of consecutive rows in which all channels repeat."""
    same = np.all([np.abs(np.diff(c.values)) <= c.resolution for c in of], axis=0)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], same, [False]])))
    for start, end in list(pairwise(edges))[::2]:
        yield np.arange(start, end + 1)


def _moved(channel: Channel, steps: ResidualSteps) -> Mask:
    """Return in which poses a joint is known to have moved since the one before."""
    side = steps.table.approach[:, channel.column]
    return np.asarray(np.nan_to_num(side) != 0.0, np.bool_)


def _refused(so_far: Gated, of: Sequence[Channel], rows: Mask) -> Gated:
    if not rows.any():
        return so_far
    table, target = so_far.table, of[0].target
    poses, names = ids(table, rows), tuple(c.name for c in of)
    for channel in of:
        table = without(table, channel, rows)
    parameters = {"channels": names, **({"poses": poses} if poses else {})}
    finding = Finding(
        "frozen_sensor",
        target,
        Change("frozen_sensor", target, parameters),
        f"{target} {', '.join(names)}: the same number again and again in {listed(poses)}, where "
        "noise and another configuration should have changed it",
        poses,
        "readings left out",
        "check supply and bus of the sensor, and record these poses again",
    )
    return so_far.found(table, (finding,))
