# SPDX-License-Identifier: Apache-2.0
"""Named numbers of a calibration whose truth a simulation knows: mass, link CoMs, total CoMs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from comcal.identify.adjust import Adjustment
from comcal.identify.cad_inputs import cad_inputs
from comcal.identify.solution import SEEN_SHARE, total_com_at
from comcal.identify.unknowns import AXES
from comcal.measure.plan import PlannedPose
from comcal.robot.model import Robot
from comcal.robot.tree import Array
from comcal.statics.configurations import placed_in_stance
from comcal.statics.support import carrier_of

MASS = "mass"


@dataclass(frozen=True)
class Quantities:
    """What is looked at, fixed before any noise is drawn.

    Parameters
    ----------
    mass : bool
        The mass of the whole robot [kg].
    components : tuple of (str, int)
        Link and axis of single CoM components, in the link frame [m].
    total_coms : tuple of (str, PlannedPose)
        Name and posture of total CoMs at exactly the planned angles, in P [m].
    """

    mass: bool
    components: tuple[tuple[str, int], ...]
    total_coms: tuple[tuple[str, PlannedPose], ...]

    @property
    def names(self) -> tuple[str, ...]:
        """``mass``, ``LINK.x``, ``total_com.NAME.x``."""
        return (
            *((MASS,) if self.mass else ()),
            *(f"{link}.{AXES[axis]}" for link, axis in self.components),
            *(f"total_com.{name}.{axis}" for name, _ in self.total_coms for axis in AXES),
        )


@dataclass(frozen=True)
class Estimates:
    """The quantities as one calibration finds them.

    Parameters
    ----------
    value, sigma : array, shape (n,)
        In the order of ``Quantities.names`` [kg], [m].
    reported : array of bool, shape (n,)
        False for a component that this calibration would not have called measured.
    """

    value: Array
    sigma: Array
    reported: npt.NDArray[np.bool_]


def identifiable_components(fit: Adjustment) -> tuple[tuple[str, int], ...]:
    """Return link and axis of every CoM component that *fit* determines by itself."""
    unknowns = fit.unknowns
    hidden = fit.visibility(np.eye(unknowns.size))[1:].reshape(-1, 3)
    links = unknowns.robot.tree.links
    return tuple(
        (links[k].name, axis)
        for k, shares in zip(unknowns.links, hidden, strict=True)
        for axis in range(3)
        if shares[axis] < SEEN_SHARE
    )


def estimates(fit: Adjustment, quantities: Quantities) -> Estimates:
    """Return every quantity with its standard deviation, as a calibration reports them.

    Parameters
    ----------
    fit : Adjustment
    quantities : Quantities
        Links among the free ones of *fit*.
    """
    tree = fit.unknowns.robot.tree
    inputs = cad_inputs(fit)
    cov = fit.cov + fit.cov_cad + inputs.cov
    value: list[float] = []
    variance: list[float] = []
    share: list[float] = []
    if quantities.mass:
        value.append(fit.unknowns.mass(fit.theta))
        variance.append(float(cov[0, 0]))
        share.append(0.0)
    columns = [fit.unknowns.names.index(f"{link} {AXES[a]}") for link, a in quantities.components]
    masses = [tree.masses[tree.link_index[link]] for link, _ in quantities.components]
    value += (fit.theta[columns] / masses).tolist()
    variance += (np.diag(cov)[columns] / np.square(masses)).tolist()
    share += fit.visibility(np.eye(fit.unknowns.size)[columns]).tolist()
    for _, pose in quantities.total_coms:
        xyz, noise, cad = total_com_at(fit, inputs, pose.support, pose.q[None])
        value += xyz[0].tolist()
        variance += np.diag(noise[0] + cad[0]).tolist()
        share += [0.0, 0.0, 0.0]
    return Estimates(np.array(value), np.sqrt(variance), np.array(share) < SEEN_SHARE)


def true_values(robot: Robot, quantities: Quantities) -> Array:
    """Return the quantities of a robot that is known exactly, shape (n,) [kg], [m].

    Parameters
    ----------
    robot : Robot
        The true one.
    quantities : Quantities
    """
    tree = robot.tree
    value: list[float] = [tree.total_mass] if quantities.mass else []
    value += [float(tree.coms[tree.link_index[link], axis]) for link, axis in quantities.components]
    for _, pose in quantities.total_coms:
        at = placed_in_stance(robot, carrier_of(robot, pose.support), pose.q[None])
        value += at.total_com()[0].tolist()
    return np.array(value)


def units(names: Sequence[str]) -> tuple[str, ...]:
    """Return the unit of every quantity by its name."""
    return tuple("kg" if name == MASS else "m" for name in names)
