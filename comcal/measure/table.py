# SPDX-License-Identifier: Apache-2.0
"""The pose table: one row per static pose, ready for the moment balance.

This is what everything downstream of ``poses.csv`` sees. Tares are subtracted and senses resolved:
every wrench here is what the part *below* a cut exerts on the part *above* it (ground on robot).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from comcal.measure.shift import Shift
from comcal.robot.tree import Array


@dataclass(frozen=True)
class PoseTable:
    """Means and covariances of N static poses.

    Parameters
    ----------
    pose : tuple of int, length N
        Unique ids.
    support : tuple of str, length N
        ``double``, ``none`` or the name of the standing foot.
    q : array, shape (N, n_joints)
        Encoder readings [rad] or [m], in the order of ``tree.joint_names``.
    q_cov : array, shape (N, n_joints)
        Variances of ``q`` [rad^2] or [m^2] (encoders are independent of one another).
    wrench : mapping from sensor or plate name to array, shape (N, 6)
        Force, moment [N, N m]; on the robot, in and about the sensor frame; NaN where absent.
    wrench_cov : mapping from sensor or plate name to array, shape (N, 6, 6)
        Covariance of the pose mean, window and revisit scatter added.
    torque, torque_var : array, shape (N, n_joints)
        Joint torque of parent on child about +axis [N m], from ``tau.*``; NaN where absent.
    current, current_var : array, shape (N, n_joints)
        Motor currents [A]; NaN where absent.
    com, com_var : array, shape (N, 3)
        CoM components known by other means [m]; NaN where absent.
    com_frame : str
        ``P`` or a link name: the frame of ``com``.
    imu : array, shape (N, 3)
        Specific force in the IMU link frame [m/s^2]; NaN where absent.
    configuration, stance, condition, revisit : tuple of str, length N
        Empty where not given.
    tilt, heading : array, shape (N,)
        [rad]; NaN where not given. ``q`` wins over ``tilt``.
    notes : tuple of str
        What the reader did or ignored, in words, for the report.
    source : Path or None
        File it was read from, for messages.
    row_lines : tuple of int
        Line of each pose in that file, for messages.
    cop, cop_var : array, shape (N, 2)
        CoP components known by other means [m], in the same frame as ``com``; NaN where absent.
    imu_var : array, shape (N, 3)
        Variances of ``imu`` [m^2/s^4].
    base_tilt : array, shape (N, 2)
        Roll and pitch of the root link against gravity [rad]; NaN where absent.
    approach : array, shape (N, n_joints)
        +1: q was increasing, -1: decreasing, 0: not moved since the previous pose, NaN: unknown.
    t : array, shape (N,)
        Seconds since the start of the session; NaN where absent.
    temperature : mapping from sensor name to array, shape (N,)
        [deg C]; the empty name is the one thermometer of a robot that has no other.
    motion : mapping from column name to array, shape (N,)
        The columns ``qd.*``, ``qdd.*``, ``slope.*``, ``sd.*`` that the file has; NaN where empty.
    tare_cov : mapping from sensor name to array, shape (6, 6)
        Covariance of the tare that was subtracted: one and the same error in every pose, hence
        not contained in ``wrench_cov``. Empty where no tare was subtracted.
    shared : mapping from name to Shift
        What one standard deviation of each further error that all poses share does to the
        readings: of what is known to be wrong with them, but not exactly. Contained in no
        covariance.

    Notes
    -----
    Arrays from ``cop`` to ``t`` may be left out; they are then all NaN.
    """

    pose: tuple[int, ...]
    support: tuple[str, ...]
    q: Array
    q_cov: Array
    wrench: Mapping[str, Array]
    wrench_cov: Mapping[str, Array]
    torque: Array
    torque_var: Array
    current: Array
    current_var: Array
    com: Array
    com_var: Array
    imu: Array
    configuration: tuple[str, ...]
    tilt: Array
    stance: tuple[str, ...] = ()
    condition: tuple[str, ...] = ()
    revisit: tuple[str, ...] = ()
    heading: Array = field(default_factory=lambda: np.zeros(0))
    com_frame: str = "P"
    notes: tuple[str, ...] = ()
    source: Path | None = None
    row_lines: tuple[int, ...] = ()
    cop: Array = field(default_factory=lambda: np.zeros(0))
    cop_var: Array = field(default_factory=lambda: np.zeros(0))
    imu_var: Array = field(default_factory=lambda: np.zeros(0))
    base_tilt: Array = field(default_factory=lambda: np.zeros(0))
    approach: Array = field(default_factory=lambda: np.zeros(0))
    t: Array = field(default_factory=lambda: np.zeros(0))
    temperature: Mapping[str, Array] = field(default_factory=dict[str, Array])
    motion: Mapping[str, Array] = field(default_factory=dict[str, Array])
    tare_cov: Mapping[str, Array] = field(default_factory=dict[str, Array])
    shared: Mapping[str, Shift] = field(default_factory=dict[str, Shift])

    def __post_init__(self) -> None:
        n = len(self.pose)
        shapes = {
            "cop": (n, 2),
            "cop_var": (n, 2),
            "imu_var": (n, 3),
            "base_tilt": (n, 2),
            "approach": (n, self.q.shape[-1]),
            "t": (n,),
        }
        for name, shape in shapes.items():
            if getattr(self, name).shape == (0,):
                object.__setattr__(self, name, np.full(shape, np.nan))

    def __len__(self) -> int:
        return len(self.pose)

    def where(self, i: int) -> str:
        """Return ``file:line (pose id)`` of row *i*, for messages."""
        place = f"{self.source.name}:{self.row_lines[i]} " if self.source and self.row_lines else ""
        return f"{place}(pose {self.pose[i]})"

    def select(self, rows: npt.ArrayLike) -> PoseTable:
        """Return the table of some rows only.

        Parameters
        ----------
        rows : array of int or of bool
            Row numbers (not pose ids) or a mask.
        """
        index = np.arange(len(self))[np.asarray(rows)]

        def pick(values: tuple[str, ...]) -> tuple[str, ...]:
            return tuple(values[i] for i in index) if values else values

        return replace(
            self,
            pose=tuple(self.pose[i] for i in index),
            support=pick(self.support),
            q=self.q[index],
            q_cov=self.q_cov[index],
            wrench={name: w[index] for name, w in self.wrench.items()},
            wrench_cov={name: c[index] for name, c in self.wrench_cov.items()},
            torque=self.torque[index],
            torque_var=self.torque_var[index],
            current=self.current[index],
            current_var=self.current_var[index],
            com=self.com[index],
            com_var=self.com_var[index],
            imu=self.imu[index],
            configuration=pick(self.configuration),
            tilt=self.tilt[index],
            stance=pick(self.stance),
            condition=pick(self.condition),
            revisit=pick(self.revisit),
            heading=self.heading[index] if self.heading.size else self.heading,
            row_lines=tuple(self.row_lines[i] for i in index) if self.row_lines else (),
            cop=self.cop[index],
            cop_var=self.cop_var[index],
            imu_var=self.imu_var[index],
            base_tilt=self.base_tilt[index],
            approach=self.approach[index],
            t=self.t[index],
            temperature={name: v[index] for name, v in self.temperature.items()},
            motion={name: v[index] for name, v in self.motion.items()},
            shared={name: shift.select(index) for name, shift in self.shared.items()},
        )


def shift_between(before: PoseTable, after: PoseTable) -> Shift:
    """Return how the readings of two tables of the same poses differ; zero where there are none."""

    def moved(a: Array, b: Array) -> Array:
        return np.nan_to_num(b - a)

    return Shift(
        q=moved(before.q, after.q),
        wrench={s: moved(w, after.wrench[s]) for s, w in before.wrench.items()},
        torque=moved(before.torque, after.torque),
        current=moved(before.current, after.current),
        imu=moved(before.imu, after.imu),
    )
