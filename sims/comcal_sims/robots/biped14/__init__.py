# SPDX-License-Identifier: Apache-2.0
"""The 64 kg biped on which diagnosis is judged: parameters, poses, plan, and its generator."""

from __future__ import annotations

from pathlib import Path

from comcal_sims.robots.biped14.model import (
    Biped14Parameters,
    biped14_motors,
    biped14_spec,
)
from comcal_sims.robots.biped14.plan import biped14_plan
from comcal_sims.robots.biped14.poses import (
    SwingLeg,
    UpperBody,
    double_pose,
    leg_angles,
    single_pose,
)
from comcal_sims.robots.files import Instruments, parameters_from, write_robot
from comcal_sims.robots.model import Lump

__all__ = [
    "Biped14Parameters",
    "SwingLeg",
    "UpperBody",
    "biped14_plan",
    "biped14_spec",
    "double_pose",
    "generate",
    "leg_angles",
    "single_pose",
]


def generate(directory: Path, **parameters: float | Lump) -> Path:
    """Write the 14-joint biped with its pose plan and return the path of its robot.yaml.

    Parameters
    ----------
    directory : Path
        Folder to write ``robot.yaml``, ``biped14.urdf`` and ``plan.csv`` into.
    **parameters : float or Lump
        Fields of :class:`Biped14Parameters`.

    Raises
    ------
    UsageError
        If a parameter does not exist, or makes a planned pose impossible.
    ConfigError
        If one of the files exists.
    """
    robot = parameters_from(Biped14Parameters, "biped14", parameters)
    spec = biped14_spec(robot)
    instruments = Instruments(
        robot.sole,
        biped14_motors(spec),
        imu_link="pelvis",
        noise={"current": 0.02, "imu": 0.001},
    )
    return write_robot(directory, spec, instruments, biped14_plan(robot))
