# SPDX-License-Identifier: Apache-2.0
"""One instant of a live robot as a pose table of one row: for showing and judging it, no more."""

from __future__ import annotations

import warnings
from collections.abc import Mapping

import numpy as np

from comcal.measure.plan import DOUBLE
from comcal.measure.source import Block
from comcal.measure.table import PoseTable
from comcal.robot.model import Robot, Sense
from comcal.robot.tree import Array

Tares = Mapping[str, tuple[Array, Array]]


def mean_of(values: Array) -> Array:
    """Return the mean over the samples that are finite, NaN where none is, shape (k,).

    Parameters
    ----------
    values : array, shape (n, k)
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # of a channel that is all NaN
        return np.nanmean(values, axis=0)


def reading_table(
    block: Block, robot: Robot, support: str = DOUBLE, tares: Tares | None = None, name: str = ""
) -> PoseTable:
    """Average a block into a table of one row, without any statement on uncertainty.

    Parameters
    ----------
    block : Block
    robot : Robot
    support : str
    tares : mapping from sensor name to (value, sigma)
        Subtracted where there are any.
    name : str
        Of the source, for messages.

    Returns
    -------
    PoseTable
        Samples that are not finite are left out. Covariances are zero.
    """
    n_joints = len(robot.tree.joint_names)
    nothing = np.full((1, n_joints), np.nan)
    wrench: dict[str, Array] = {}
    for sensor, values in block.wrenches.items():
        w = mean_of(values)
        if tares and sensor in tares:
            w = w - tares[sensor][0]
        is_reversed = sensor in robot.sensors and robot.sensors[sensor].sense is Sense.ON_GROUND
        wrench[sensor] = (-w if is_reversed else w)[None]
    imu = np.full((1, 3), np.nan) if block.imu is None else mean_of(block.imu)[None]
    return PoseTable(
        pose=(0,),
        support=(support,),
        q=mean_of(block.q)[None],
        q_cov=np.zeros((1, n_joints)),
        wrench=wrench,
        wrench_cov={sensor: np.zeros((1, 6, 6)) for sensor in wrench},
        torque=nothing if block.torques is None else mean_of(block.torques)[None],
        torque_var=nothing,
        current=nothing if block.currents is None else mean_of(block.currents)[None],
        current_var=nothing,
        com=np.full((1, 3), np.nan),
        com_var=np.full((1, 3), np.nan),
        imu=imu,
        configuration=("",),
        tilt=np.full(1, np.nan),
        notes=(name,) if name else (),
    )
