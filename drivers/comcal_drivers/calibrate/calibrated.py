# SPDX-License-Identifier: Apache-2.0
"""Samples in physical units, with the complaints of their device as flags."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from comcal_drivers.devices.description import Description
from comcal_drivers.join.sample import SATURATED, STATUS, Counts, Samples

Array = npt.NDArray[np.float64]
STATUS_BITS = 63
"""Status words of up to 32 bits, or a byte for each of up to seven parts."""


@dataclass(frozen=True)
class Calibrated:
    """Samples of one device in physical units; flagged ones keep their values.

    Parameters
    ----------
    t, counter, last_row, flags
        As of :class:`~comcal_drivers.join.sample.Samples`, with STATUS and SATURATED set.
    values : array, shape (n, k)
        A wrench [N, N m]; position [rad], current [A] and torque [N m] of a joint, NaN where the
        drive does not send it; or specific force [m/s^2].
    counts : Counts
        Only what calibration counts: status bits, ignored ones, saturated samples. Add it to the
        joiner's.
    """

    t: Array
    counter: npt.NDArray[np.int64]
    last_row: npt.NDArray[np.int64]
    values: Array
    flags: npt.NDArray[np.uint8]
    counts: Counts

    def __len__(self) -> int:
        return int(self.t.size)


@dataclass(frozen=True)
class StatusRule:
    """Which bits of a status word mean what, as masks.

    Parameters
    ----------
    trouble, saturated, ignored : int
        Ignored bits are in neither of the others.
    """

    trouble: int = 0
    saturated: int = 0
    ignored: int = 0


def status_rule(description: Description, ignore: tuple[int, ...]) -> StatusRule:
    """Return the masks of a device whose bits *ignore* are ignored."""
    word = description.status
    if word is None:
        return StatusRule()
    ignored = _mask(ignore)
    saturated = _mask(word.saturated)
    return StatusRule(
        _mask(tuple(word.bits)) & ~saturated & ~ignored, saturated & ~ignored, ignored
    )


def judge(
    samples: Samples, rule: StatusRule, at_limit: npt.NDArray[np.bool_]
) -> tuple[npt.NDArray[np.uint8], Counts]:
    """Return the flags of samples, and how often the device complained.

    Parameters
    ----------
    samples : Samples
    rule : StatusRule
    at_limit : array of bool, shape (n,)
        Samples with a raw value at its limit.

    Returns
    -------
    flags : array of uint8, shape (n,)
    counts : Counts
    """
    saturated = at_limit | ((samples.status & rule.saturated) != 0)
    flags = samples.flags.copy()
    flags[(samples.status & rule.trouble) != 0] |= STATUS
    flags[saturated] |= SATURATED
    status = dict[int, int]()
    if samples.status.any():
        seen = int(np.bitwise_or.reduce(samples.status))
        for bit in range(STATUS_BITS):
            if seen >> bit & 1:
                status[bit] = int((samples.status >> bit & 1).sum())
    ignored = {bit: n for bit, n in status.items() if rule.ignored >> bit & 1}
    return flags, Counts(saturated=int(saturated.sum()), status=status, ignored_status=ignored)


def status_notes(description: Description, counts: Counts, ignore_where: str) -> tuple[str, ...]:
    """Return what the status words said, in sentences for the report.

    Parameters
    ----------
    description : Description
    counts : Counts
        The joiner's and calibration's together.
    ignore_where : str
        ``file:line`` at which bits are ignored.

    Returns
    -------
    tuple of str
        One sentence for each bit that was set: ``bit 14 (CAN bus error) set on 808 of 808 samples,
        ignored by robot.yaml:12``.
    """
    word = description.status
    notes = list[str]()
    for bit, times in sorted(counts.status.items()):
        meaning = word.bits.get(bit) if word else None
        if meaning is None and description.kind == "drive":
            continue  # the state of a drive that works
        text = f"bit {bit}" + (f" ({meaning})" if meaning else "")
        text += f" set on {times} of {counts.samples} samples"
        if bit in counts.ignored_status:
            text += f", ignored by {ignore_where}" if ignore_where else ", ignored"
        elif meaning is None:
            text += ", of no known meaning"
        notes.append(text)
    return tuple(notes)


def _mask(bits: tuple[int, ...]) -> int:
    return sum(1 << bit for bit in set(bits))
