# SPDX-License-Identifier: Apache-2.0
"""What sensors make of the truth: noise, bias, quantisation, encoder errors, motor currents."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from difflib import get_close_matches

import numpy as np

from comcal.errors import ConfigError
from comcal.measure.source import Block
from comcal.robot.changes import Change
from comcal.robot.model import Robot, Sense
from comcal.robot.tree import Array
from comcal_sims.climate import Climate
from comcal_sims.faults.mistakes import Mistakes
from comcal_sims.faults.sensors import MotorFaults, WrenchFaults
from comcal_sims.world import WorldState


@dataclass(frozen=True)
class SensorErrors:
    """Sizes of the sensor errors; zero switches one off.

    Parameters
    ----------
    ft_force, ft_moment : float
        White noise of one sample [N], [N m].
    ft_force_bias, ft_moment_bias : float
        Spread of the offsets, drawn once per session from the master seed [N], [N m].
    ft_force_step, ft_moment_step : float
        Resolution [N], [N m].
    encoder : float
        Spread of the error that stays while the robot stands in a pose: 0.02 degrees [rad].
    encoder_white, encoder_step : float
        White noise of one sample and resolution [rad].
    current, torque, imu : float
        White noise of one sample [A], [N m], [m/s^2].
    """

    ft_force: float = 0.5
    ft_moment: float = 0.05
    ft_force_bias: float = 0.0
    ft_moment_bias: float = 0.0
    ft_force_step: float = 0.0
    ft_moment_step: float = 0.0
    encoder: float = 3.4907e-4
    encoder_white: float = 0.0
    encoder_step: float = 0.0
    current: float = 0.02
    torque: float = 0.1
    imu: float = 0.005


EXACT = SensorErrors(ft_force=0.0, ft_moment=0.0, encoder=0.0, current=0.0, torque=0.0, imu=0.0)
"""Sensors that tell the truth."""


def sensor_errors_from(options: Mapping[str, object], where: str) -> SensorErrors:
    """Return the defaults, changed by the options of one simulated source.

    Raises
    ------
    ConfigError
        If an option is unknown or is not a finite number of zero or more.
    """
    known = [field.name for field in fields(SensorErrors)]
    sizes = dict[str, float]()
    for name, value in options.items():
        if name not in known:
            near = get_close_matches(name, known, n=1)
            raise ConfigError(
                f"{name} is not an option of a simulated source",
                where=where,
                next_step=f"did you mean {near[0]}?" if near else f"known: {', '.join(known)}",
            )
        if (
            isinstance(value, bool)
            or not isinstance(value, int | float)
            or not 0.0 <= value < np.inf
        ):
            raise ConfigError(
                f"{name} is {value!r}",
                where=where,
                limit="a finite number, zero or more",
                next_step="give its size in SI units, or 0 to switch it off",
            )
        sizes[name] = float(value)
    return SensorErrors(**sizes)


class SensorAdapter:
    """Turns states of a world into samples.

    Random numbers come from one stream per pose, so a pose reads the same in an interrupted and
    resumed recording as in an uninterrupted one.

    Parameters
    ----------
    robot : Robot
    errors : SensorErrors
    seed : int
        Master seed of the session.
    changes : sequence of Change
        Effects on the readings; others are left to the world.
    climate : Climate or None
        Temperature of the sensors; None: nobody measures it.
    """

    def __init__(
        self,
        robot: Robot,
        errors: SensorErrors,
        seed: int,
        changes: Sequence[Change] = (),
        climate: Climate | None = None,
    ) -> None:
        self._robot = robot
        self._errors = errors
        self._seed = seed
        session = np.random.default_rng(np.random.SeedSequence(seed))
        self._bias = {
            name: _per_wrench(errors.ft_force_bias, errors.ft_moment_bias)
            * session.standard_normal(6)
            for name in robot.sensors
        }
        self._climate = climate
        self._sensors = {name: WrenchFaults(changes, name) for name in robot.sensors}
        self._motors = MotorFaults(robot, changes)
        self._mistakes = Mistakes(robot, changes)
        self.begin(0)

    def begin(self, pose: int) -> None:
        """Start the stream of a pose and draw what stays constant in it.

        Parameters
        ----------
        pose : int
            Its id.
        """
        self._rng = np.random.default_rng(np.random.SeedSequence([self._seed, pose % 2**64]))
        n_joints = len(self._robot.tree.joint_names)
        self._encoder_error = self._errors.encoder * self._rng.standard_normal(n_joints)
        for sensor in self._sensors.values():
            sensor.begin()
        self._mistakes.begin(pose)

    def block(self, t: Array, states: Sequence[WorldState]) -> Block:
        """Return the samples of consecutive states.

        Parameters
        ----------
        t : array, shape (n,)
            [s]
        states : sequence of WorldState, length n
        """
        errors = self._errors
        at = np.array([s.q if s.encoders is None else s.encoders for s in states])
        q = at + self._encoder_error
        torques = np.array([state.torques for state in states])
        motors = np.array(
            [s.torques if s.motor_torques is None else s.motor_torques for s in states]
        )
        warming = np.zeros_like(t) if self._climate is None else self._climate.warming(t)
        factor = self._torque_per_current()
        wrenches = dict[str, Array]()
        for name, sensor in self._robot.sensors.items():
            sign = 1.0 if sensor.sense is Sense.ON_ROBOT else -1.0
            true = sign * np.array([state.wrenches[name] for state in states])
            true = self._sensors[name].reading(t, true, warming)
            noise = _per_wrench(errors.ft_force, errors.ft_moment)
            step = _per_wrench(errors.ft_force_step, errors.ft_moment_step)
            wrenches[name] = _rounded(self._noisy(true + self._bias[name], noise), step)
        imu = [state.imu for state in states if state.imu is not None]
        currents = self._motors.currents(motors, factor, at)
        block = Block(
            t=t,
            q=_rounded(self._noisy(q, errors.encoder_white), errors.encoder_step),
            wrenches=wrenches,
            torques=self._noisy(np.where(np.isnan(factor), torques, np.nan), errors.torque),
            currents=self._noisy(currents, errors.current),
            imu=self._noisy(np.array(imu), errors.imu) if imu else None,
            temperatures=None
            if self._climate is None
            else {name: self._climate.temperature(t) for name in self._robot.sensors},
        )
        return self._mistakes.spoil(block)

    def _noisy(self, values: Array, deviation: Array | float) -> Array:
        return values + deviation * self._rng.standard_normal(values.shape)

    def _torque_per_current(self) -> Array:
        """Return joint torque over motor current [N m/A]; NaN where there is no motor."""
        motors = self._robot.motors
        factor = np.full(len(self._robot.tree.joint_names), np.nan)
        for i, joint in enumerate(self._robot.tree.joint_names):
            if joint in motors:
                motor = motors[joint]
                factor[i] = motor.torque_constant * motor.gear * motor.sign
        return factor


def _per_wrench(force: float, moment: float) -> Array:
    return np.repeat([force, moment], 3)


def _rounded(values: Array, step: Array | float) -> Array:
    """Return *values* on a grid of *step*, unchanged where the step is zero."""
    step = np.broadcast_to(step, values.shape[-1:])
    safe = np.where(step > 0.0, step, 1.0)
    return np.where(step > 0.0, np.round(values / safe) * safe, values)
