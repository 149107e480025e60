# SPDX-License-Identifier: Apache-2.0
"""Which variance each mean of ``poses.csv`` gets: from its window, from repeats, or as stated.

variance of a mean = pooled square of se.<column>   (robot.yaml's ``noise`` where there is none)
                   + scatter between revisits        (from repeated poses, else ``noise.revisit``)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from comcal.measure.variance import MIN_REPEATS, channel_variance, revisit_variance
from comcal.robot.model import Noise
from comcal.robot.tree import Array

SAME_POSE = 1e-3
"""Repeats whose joints differ by more [rad or m] are different poses: gravity acts differently."""


@dataclass(frozen=True)
class Variances:
    """Variances of some channels of one kind.

    Parameters
    ----------
    window : array, shape (N, C)
        From within the windows, or as stated.
    own : array of bool, shape (N, C)
        Poses that were too noisy to share the pooled value.
    revisit : float
        Scatter between visits, to be added.
    notes : tuple of str
    """

    window: Array
    own: npt.NDArray[np.bool_]
    revisit: float
    notes: tuple[str, ...]

    @property
    def total(self) -> Array:
        """Variance of each mean, shape (N, C)."""
        return self.window + self.revisit


def variances(
    values: Array,
    standard_errors: Array,
    family: str,
    noise: Noise,
    repeats: Sequence[str] | None = None,
) -> Variances:
    """Return the variances of the channels of one family.

    Parameters
    ----------
    values : array, shape (N, C)
        Means; NaN where absent.
    standard_errors : array, shape (N, C)
        Columns ``se.*``; NaN where absent.
    family : str
        Field of *noise* that states the standard error, such as ``ft_force``.
    noise : Noise
    repeats : sequence of str, optional
        Equal, non-empty texts mark repeats that may tell the scatter of this family.
    """
    window = np.empty(values.shape)
    own = np.zeros(values.shape, dtype=np.bool_)
    stated = float(getattr(noise, family))
    for k in range(values.shape[1]):
        window[:, k], own[:, k] = channel_variance(standard_errors[:, k], stated)
    there = np.isfinite(values)
    window = np.where(there, window, np.nan)
    own &= there
    notes: list[str] = []
    if there.any() and not np.nanmax(window) > 0.0 and family != "encoder":
        notes.append(
            f"no standard error is known for the {family} columns: give se.* or noise.{family}"
        )
    revisit = float(noise.revisit.get(family, 0.0)) ** 2
    if repeats is not None:
        found, freedom = revisit_variance(values, window, repeats)
        if freedom >= MIN_REPEATS:
            revisit = found
            notes.append(
                f"scatter between revisits of the {family} columns is {np.sqrt(found):.3g}, "
                f"from repeated poses ({freedom} degrees of freedom)"
            )
    return Variances(window, own, revisit, tuple(notes))


def comparable_repeats(
    revisit: Sequence[str], q: Array, usable: npt.NDArray[np.bool_]
) -> tuple[str, ...]:
    """Return the repeat labels of poses that may be compared, empty for all others.

    Parameters
    ----------
    revisit : sequence of str, length N
    q : array, shape (N, n_joints)
        [rad] or [m]; repeats further apart than ``SAME_POSE`` are no repeats.
    usable : array of bool, shape (N,)
        False where the readings may differ although the robot does not: how two feet share the
        load in double support is not determined by statics.
    """
    groups: dict[str, list[int]] = {}
    for i, label in enumerate(revisit):
        if label and usable[i]:
            groups.setdefault(label, []).append(i)
    labels = [""] * len(revisit)
    for label, members in groups.items():
        if np.ptp(q[members], axis=0).max(initial=0.0) <= SAME_POSE:
            for i in members:
                labels[i] = label
    return tuple(labels)
