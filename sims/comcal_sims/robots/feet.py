# SPDX-License-Identifier: Apache-2.0
"""The sole plate below the foot sensor, standing on four bumpers.

A ball at each corner touches a plane in exactly one point, so every corner always carries its
share; a flat box makes engines drop corners from one step to the next.
"""

from __future__ import annotations

from dataclasses import dataclass

from comcal_sims.footing import BUMPER_RADIUS
from comcal_sims.robots.model import (
    Cuboid,
    JointSpec,
    LinkSpec,
    Lump,
    Sphere,
    Vector,
    cuboid_inertia,
)


@dataclass(frozen=True)
class SolePlate:
    """What hangs below the sensor's cut.

    The link frame of the plate is the sensor frame: on the vertical through the ankle,
    ``cut_height`` above the ground, x to the toes, y left, z up.

    Parameters
    ----------
    mass : float
        [kg]
    cut_height : float
        Height of the sensor's cut above the ground; the plate fills all of it [m].
    heel, toe : float
        x of the rear and front corners [m].
    half_width : float
        [m]
    """

    mass: float
    cut_height: float
    heel: float
    toe: float
    half_width: float

    @property
    def corners(self) -> tuple[tuple[float, float], ...]:
        """Corners of the sole in the sole frame, counter-clockwise from front left [m]."""
        toe, heel, w = self.toe, self.heel, self.half_width
        return ((toe, w), (heel, w), (heel, -w), (toe, -w))

    @property
    def com(self) -> Vector:
        """CoM in the link frame of the plate [m]."""
        return ((self.toe + self.heel) / 2, 0.0, -self.cut_height / 2)

    def lump_seen_from(self, ankle_height: float) -> Lump:
        """Return mass and CoM in a foot frame whose origin is *ankle_height* above the ground."""
        x, y, z = self.com
        return Lump(self.mass, (x, y, z + self.cut_height - ankle_height))

    def link(self, name: str) -> LinkSpec:
        """Return the plate as a link."""
        size = (self.toe - self.heel, 2 * self.half_width, self.cut_height)
        bumpers = tuple(
            Sphere(BUMPER_RADIUS, (x, y, BUMPER_RADIUS - self.cut_height)) for x, y in self.corners
        )
        return LinkSpec(
            name,
            Lump(self.mass, self.com),
            cuboid_inertia(self.mass, size),
            visuals=(Cuboid(size, self.com),),
            collisions=bumpers,
        )

    def joint(self, name: str, foot: str, sole: str, ankle_height: float) -> JointSpec:
        """Return the fixed joint that is the sensor's cut."""
        return JointSpec(name, foot, sole, (0.0, 0.0, self.cut_height - ankle_height))
