# SPDX-License-Identifier: Apache-2.0
"""The paper's route as one batched function of everything that was measured or taken from CAD."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from comcal.measure.shift import Shift
from comcal.measure.table import PoseTable
from comcal.robot.frames import apply
from comcal.robot.kinematics import Placements
from comcal.robot.model import Robot
from comcal.robot.tree import Array
from comcal.statics.coefficients import coefficients_from_wrench, total_wrench
from comcal.statics.configurations import (
    Configuration,
    ankle_point,
    mean_tilts,
    placed_in_stance,
)
from comcal.statics.cramer import Choice, solve_choices
from comcal.statics.planar import ComplexArray, PlanarChain, placed_configurations
from comcal.statics.support import loaded_wrenches
from comcal.statics.two_pose import FootSide, total_com

WRENCH_STEP = 1e-3
"""Central-difference step for forces [N] and moments [N m]."""
SMALL_STEP = 1e-5
"""The same for joint positions [rad] or [m], CoMs [m] and CAD values [kg, m]."""

CAD_NAMES = ("m_u", "r_u", "l_u", "U")
"""What the route takes from CAD, in this order: mass, x and z of the feet, height of the ankles."""


@dataclass(frozen=True)
class Shape:
    """One configuration with its measured inputs.

    Parameters
    ----------
    given : bool
        True: the inputs of its single row are the CoM, then the angles.
        False: those of each row are the loaded wrenches, then the angles.
    inputs : tuple of array
        One per row of the configuration.
    covs : tuple of array
        Their covariances; NaN where the error of a given CoM is not known.
    com_link : int or None
        Link in whose frame the CoM is given; None: in P.
    com_known : array of bool, shape (3,)
        Components of the CoM in P that are known.
    """

    configuration: Configuration
    given: bool
    inputs: tuple[Array, ...]
    covs: tuple[Array, ...]
    com_link: int | None = None
    com_known: npt.NDArray[np.bool_] = field(default_factory=lambda: np.ones(3, np.bool_))

    @property
    def width(self) -> int:
        """Number of inputs over all rows."""
        return sum(len(x) for x in self.inputs)

    @property
    def feet(self) -> npt.NDArray[np.bool_]:
        """Links on the feet's side of the ankles that the total CoM counts, shape (n_links,)."""
        counted = np.ones_like(self.configuration.foot_side)
        return self.configuration.foot_side & (
            counted if self.given else self.configuration.carrier.carried
        )


def shape_from_wrenches(configuration: Configuration, table: PoseTable) -> Shape:
    """Return the inputs of a configuration measured by force/torque sensors."""
    part = table.select(configuration.rows)
    w, w_cov = loaded_wrenches(configuration.carrier, part)
    inputs = [np.concatenate([wi.ravel(), qi]) for wi, qi in zip(w, part.q, strict=True)]
    covs = [_block_diagonal([*c, np.diag(v)]) for c, v in zip(w_cov, part.q_cov, strict=True)]
    return Shape(configuration, False, tuple(inputs), tuple(covs))


def shape_from_com(configuration: Configuration, table: PoseTable, com_link: int | None) -> Shape:
    """Return the inputs of a configuration whose total CoM is known by other means.

    Parameters
    ----------
    configuration : Configuration
    table : PoseTable
    com_link : int or None
        Link in whose frame the CoM is given; None: in P, where y may be missing.
    """
    row = configuration.rows[0]
    known = np.isfinite(table.com[row])
    # An error that is not stated is unknown, not zero.
    com_var = np.where(table.com_var[row] > 0.0, table.com_var[row], np.nan)
    inputs = np.concatenate([np.where(known, table.com[row], 0.0), table.q[row]])
    variance = np.concatenate([np.where(known, com_var, 0.0), table.q_cov[row]])
    return Shape(configuration, True, (inputs,), (np.diag(variance),), com_link, known)


@dataclass(frozen=True)
class Model:
    """Total CoM of every shape and CoM of every segment, for any inputs of the given layout.

    The outputs are, in this order: CoM of each shape (3; of what is carried, or of the whole robot
    where it is given), r and l of every segment for each choice, misfit (x, z) of each choice's
    checking configuration. All in P [m].

    Parameters
    ----------
    tare_cov : mapping from sensor name to array, shape (6, 6)
        Covariance of each tare: one error in all poses.
    shared : mapping from name to Shift
        Further errors of all poses of the table, in units of one sigma.
    """

    robot: Robot
    shapes: tuple[Shape, ...]
    tare_cov: Mapping[str, Array]
    chain: PlanarChain | None = None
    choices: tuple[Choice, ...] = ()
    shared: Mapping[str, Shift] = field(default_factory=dict[str, Shift])

    @property
    def inputs(self) -> Array:
        """Measured inputs, shape (n_inputs,)."""
        return np.concatenate([x for shape in self.shapes for x in shape.inputs])

    @property
    def cov(self) -> Array:
        """Their covariance, shape (n_inputs, n_inputs)."""
        cov = _block_diagonal([c for shape in self.shapes for c in shape.covs])
        for sensor, tare in self.tare_cov.items():
            hit = self._inputs_of(sensor)
            cov += hit @ tare @ hit.T
        for shift in self.shared.values():
            root = np.concatenate([_moved_inputs(shape, shift) for shape in self.shapes])
            cov += np.outer(root, root)
        return cov

    @property
    def cad_sigma(self) -> Array:
        """Sigma of the CAD values of ``CAD_NAMES``, from the robot's tolerances, shape (4,)."""
        tree, tolerances = self.robot.tree, self.robot.tolerances
        masses = tree.masses[self.shapes[0].feet]
        total = float(masses.sum())
        share = float(np.linalg.norm(masses)) / total if total > 0 else 0.0
        com = tolerances.link_com * share
        return np.array([tolerances.link_mass * share * total, com, com, tolerances.link_length])

    def evaluate(self, inputs: Array, cad: Array) -> Array:
        """Return the outputs for a batch of inputs, shape (B, n_outputs).

        Parameters
        ----------
        inputs : array, shape (B, n_inputs)
        cad : array, shape (B, 4)
            Deviations of the CAD values from the URDF [kg, m, m, m].
        """
        at = 0
        coms: list[Array] = []
        masses: list[Array] = []
        postures: list[Array] = []
        shifts: list[ComplexArray] = []
        for shape in self.shapes:
            part = inputs[:, at : at + shape.width]
            at += shape.width
            com, mass, posture, shift = self._shape(shape, part, cad)
            coms.append(com)
            masses.append(mass)
            postures.append(posture)
            shifts.append(shift)
        outputs = [np.concatenate(coms, axis=1)]
        if self.chain is not None:
            configurations = [shape.configuration for shape in self.shapes]
            q = np.stack(postures, axis=1)
            placed = placed_configurations(self.robot, configurations, q)
            m, c = np.stack(masses, axis=1), np.stack(coms, axis=1)
            moment = m * (c[..., 2] + 1j * c[..., 0]) - np.stack(shifts, axis=1)
            w, misfit = solve_choices(self.chain, self.choices, placed, moment, m)
            outputs.append(np.stack([w.imag, w.real], axis=-1).reshape(len(inputs), -1))
            outputs.append(np.stack([misfit.imag, misfit.real], axis=-1).reshape(len(inputs), -1))
        return np.concatenate(outputs, axis=1)

    def differentiate(self) -> tuple[Array, Array, Array]:
        """Return the outputs, their derivatives by inputs, and by CAD values."""
        x, n = self.inputs, len(self.inputs)
        steps = np.concatenate([self._steps(), np.full(len(CAD_NAMES), SMALL_STEP)])
        moves = np.vstack([np.diag(steps), -np.diag(steps), np.zeros((1, len(steps)))])
        y = self.evaluate(x + moves[:, :n], moves[:, n:])
        k = len(steps)
        J = ((y[:k] - y[k : 2 * k]) / (2 * steps[:, None])).T
        return y[-1], J[:, :n], J[:, n:]

    def _inputs_of(self, sensor: str) -> Array:
        """Return which inputs a change of one sensor's six channels changes, (n_inputs, 6)."""
        rows: list[Array] = []
        for shape in self.shapes:
            sensors = () if shape.given else shape.configuration.carrier.sensors
            for x in shape.inputs:
                hit = np.zeros((len(x), 6))
                if sensor in sensors:
                    at = 6 * sensors.index(sensor)
                    hit[at : at + 6] = np.eye(6)
                rows.append(hit)
        return np.concatenate(rows)

    def _steps(self) -> Array:
        n_joints = len(self.robot.tree.joint_names)
        steps: list[Array] = []
        for shape in self.shapes:
            for x in shape.inputs:
                step = np.full(len(x), SMALL_STEP)
                if not shape.given:
                    step[: len(x) - n_joints] = WRENCH_STEP
                steps.append(step)
        return np.concatenate(steps)

    def _shape(
        self, shape: Shape, inputs: Array, cad: Array
    ) -> tuple[Array, Array, Array, ComplexArray]:
        """Return CoM (B, 3), mass (B,), posture (B, n_joints), first-moment deviation (B,)."""
        tree, carrier = self.robot.tree, shape.configuration.carrier
        n_joints, batch = len(tree.joint_names), len(inputs)
        if shape.given:
            at = placed_in_stance(self.robot, carrier, inputs[:, 3:])
            foot = foot_side_values(self.robot, shape, at, cad)
            mass = tree.total_mass + cad[:, 0]
            com = _given_com(shape, inputs[:, :3], at)
            return com, mass, inputs[:, 3:], _moment_shift(foot, cad)
        rows = inputs.reshape(batch, len(shape.inputs), -1)
        w = rows[..., :-n_joints].reshape(batch * rows.shape[1], -1, 6)
        q = rows[..., -n_joints:]
        at = placed_in_stance(self.robot, carrier, q.reshape(-1, n_joints))
        w_P = total_wrench(carrier, at, w).reshape(batch, -1, 6)
        mass = np.mean(np.linalg.norm(w_P[..., :3], axis=-1), axis=1) / self.robot.gravity
        foot = foot_side_values(self.robot, shape, at, cad)
        R = at.R.reshape(batch, -1, *at.R.shape[1:])
        tilts = mean_tilts(self.robot, shape.configuration, R)
        com = total_com(coefficients_from_wrench(w_P), mass, tilts, foot)
        return com, mass, q[:, 0], _moment_shift(foot, cad)


def foot_side_values(robot: Robot, shape: Shape, at: Placements, cad: Array) -> FootSide:
    """Return m_u, r_u, l_u, A and U of B shapes in K poses each, deviations of CAD added.

    Parameters
    ----------
    at : Placements
        Of B K poses, seen from P.
    cad : array, shape (B, 4)
    """
    masses = robot.tree.masses * shape.feet
    m_u = float(masses.sum())
    moment = np.einsum("k,nki->ni", masses, at.coms)
    com = (moment / m_u if m_u > 0 else np.zeros_like(moment)).reshape(len(cad), -1, 3)
    ankle = ankle_point(robot, shape.configuration.carrier, at).reshape(len(cad), -1, 3)
    return FootSide(
        mass=m_u + cad[:, 0],
        r=com[..., 0] + cad[:, 1, None],
        l=com[..., 2] + cad[:, 2, None],
        ankle_x=ankle[..., 0],
        ankle_z=ankle[..., 2] + cad[:, 3, None],
    )


def _moment_shift(foot: FootSide, cad: Array) -> ComplexArray:
    """Return by how much the feet's first moment deviates from CAD, z + j x, shape (B,)."""
    com = foot.l[:, 0] + 1j * foot.r[:, 0]
    as_in_cad = (foot.mass - cad[:, 0]) * (com - cad[:, 2] - 1j * cad[:, 1])
    return foot.mass * com - as_in_cad


def _given_com(shape: Shape, com: Array, at: Placements) -> Array:
    """Return a given CoM in P, shape (B, 3)."""
    if shape.com_link is None:
        return com
    return apply(at.R[:, shape.com_link], com) + at.p[:, shape.com_link]


def _moved_inputs(shape: Shape, shift: Shift) -> Array:
    """Return what a shared error does to the inputs of one shape, shape (width,)."""
    rows = list(shape.configuration.rows[:1] if shape.given else shape.configuration.rows)
    loads = [np.zeros((len(rows), 3))]  # a CoM that is given by other means does not move
    if not shape.given:
        loads = [shift.wrench[sensor][rows] for sensor in shape.configuration.carrier.sensors]
    return np.concatenate([*loads, shift.q[rows]], axis=1).ravel()


def _block_diagonal(blocks: Sequence[Array]) -> Array:
    size = sum(len(b) for b in blocks)
    out = np.zeros((size, size))
    at = 0
    for block in blocks:
        out[at : at + len(block), at : at + len(block)] = block
        at += len(block)
    return out
