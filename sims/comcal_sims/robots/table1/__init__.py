# SPDX-License-Identifier: Apache-2.0
"""The 18.6 kg robot of Table 1 of Muscolo 2017: parameters, poses, plans, and its generator."""

from __future__ import annotations

from pathlib import Path

from comcal_sims.robots.files import Instruments, MotorSpec, parameters_from, write_robot
from comcal_sims.robots.table1.model import Table1Parameters, table1_spec
from comcal_sims.robots.table1.plans import planar_twin_plan, slope_plan, table1_plan
from comcal_sims.robots.table1.poses import lateral_pose, planar_pose, split_stance_pose

__all__ = [
    "Table1Parameters",
    "generate",
    "lateral_pose",
    "planar_pose",
    "planar_twin_plan",
    "slope_plan",
    "split_stance_pose",
    "table1_plan",
    "table1_spec",
]


def generate(directory: Path, **parameters: float | bool) -> Path:
    """Write the Table 1 robot with its pose plan and return the path of its robot.yaml.

    Parameters
    ----------
    directory : Path
        Folder to write ``robot.yaml``, ``table1.urdf`` and ``plan.csv`` into.
    **parameters : float or bool
        Fields of :class:`Table1Parameters`.

    Raises
    ------
    UsageError
        If a parameter does not exist.
    ConfigError
        If one of the files exists.
    """
    robot = parameters_from(Table1Parameters, "table1", parameters)
    spec = table1_spec(robot)
    # Mirrored gearboxes: the same current turns the right leg the other way.
    motors = {
        joint: MotorSpec(0.115, 50.0, 1 if joint.startswith("l_") else -1)
        for joint in spec.joint_names
    }
    instruments = Instruments(robot.sole, motors, imu_link=None, noise={})
    return write_robot(directory, spec, instruments, table1_plan(robot))
