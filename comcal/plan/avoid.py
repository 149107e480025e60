# SPDX-License-Identifier: Apache-2.0
"""Postures that a plan must stay away from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from comcal.plan.settle import JointBox
from comcal.robot.tree import Array

NEAR = 0.1
"""A pose is near another one when no joint differs by more than this share of its range."""


@dataclass(frozen=True)
class Region:
    """Joints, by column of q, that must not all be within their intervals at once [rad] or [m]."""

    columns: tuple[int, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]


@dataclass(frozen=True)
class Avoided:
    """Poses and regions to be avoided.

    Parameters
    ----------
    poses : sequence of array, each shape (n_joints,)
        NaN in joints that do not matter.
    regions : sequence of Region
    """

    poses: Sequence[Array] = ()
    regions: Sequence[Region] = ()

    def holds(self, q: Array, box: JointBox) -> npt.NDArray[np.bool_]:
        """Return which of N poses are to be avoided, shape (N,)."""
        held = np.zeros(len(q), np.bool_)
        reach = NEAR * box.range
        for pose in self.poses:
            held |= np.all(np.isnan(pose) | (np.abs(q - pose) <= reach), axis=1)
        for region in self.regions:
            part = q[:, list(region.columns)]
            held |= np.all((part >= region.lower) & (part <= region.upper), axis=1)
        return held
