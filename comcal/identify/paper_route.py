# SPDX-License-Identifier: Apache-2.0
"""The paper's route with uncertainties: total CoM from twins, link CoMs by Cramer's rule."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from comcal.errors import ComcalError, RankError
from comcal.identify.paper_model import (
    Model,
    Shape,
    shape_from_com,
    shape_from_wrenches,
)
from comcal.measure.plan import NONE
from comcal.measure.pose_cells import STANCE_FRAME
from comcal.measure.table import PoseTable
from comcal.robot.model import Robot
from comcal.robot.tree import Array
from comcal.statics.coefficients import balance_coefficients
from comcal.statics.configurations import (
    Configuration,
    find_configurations,
    foot_side_links,
    placed_in_stance,
)
from comcal.statics.cramer import Choice, choices_of
from comcal.statics.planar import ComplexArray, PlanarChain, placed_configurations, planar_chain
from comcal.statics.support import Carrier, measured_supports, standing_feet
from comcal.statics.two_pose import MIN_TILT, height_gain, spread


@dataclass(frozen=True)
class ConfigurationCom:
    """Total CoM of one shape, in its reference posture.

    Parameters
    ----------
    xyz, carried_xyz : array, shape (3,)
        Of the whole robot and of what the sensors carry, in P [m]; NaN where not given.
    cov, cov_cad : array, shape (3, 3)
        From measurement noise, and from the CAD values of the feet; they add up.
    tilt : float
        Spread of tilt against the direction of gravity [rad]; NaN for given CoMs.
    gain : float
        sd(Z) per sd(X); NaN for given CoMs.
    by : str
        ``twin``, ``slope`` or ``given``.
    """

    configuration: Configuration
    xyz: Array
    carried_xyz: Array
    cov: Array
    cov_cad: Array
    tilt: float
    gain: float
    by: str


@dataclass(frozen=True)
class ChoiceResult:
    """CoM of every segment from one choice of configurations.

    Parameters
    ----------
    w : complex array, shape (n_segments,)
        l + j r relative to the segment's anchor joint [m].
    cov : array, shape (2 n_segments, 2 n_segments)
        Of r and l of each segment in turn, measurement noise and CAD together.
    noise_gain : array, shape (2 n_segments,)
        sd of r and l of each segment per sd of alpha, all poses alike [1].
    misfit, misfit_sigma : array, shape (2,)
        x and z of the predicted minus the measured CoM of the checking configuration [m];
        NaN where nothing is left to check.
    """

    choice: Choice
    w: ComplexArray
    cov: Array
    noise_gain: Array
    misfit: Array
    misfit_sigma: Array


@dataclass(frozen=True)
class PaperRoute:
    """Everything that the paper's route has to say about a session.

    Parameters
    ----------
    totals : tuple of ConfigurationCom
    refused : tuple of ComcalError
        Sets of poses that share a configuration but could not be used, with the reason.
    chain : PlanarChain or None
        None where Cramer's rule does not apply; ``reason`` then says why.
    choices : tuple of ChoiceResult
        Best determinant first.
    rows : tuple of int
        Rows of the pose table whose inputs were used, in the order of ``sensitivity``.
    sensitivity : array, shape (2 n_segments, n_inputs)
        d(r, l by the best choice)/d(inputs).
    cov_cad : array, shape (2 n_segments, 2 n_segments)
        Of r and l by the best choice, from CAD alone [m^2].
    """

    totals: tuple[ConfigurationCom, ...]
    refused: tuple[ComcalError, ...]
    chain: PlanarChain | None
    choices: tuple[ChoiceResult, ...]
    reason: str
    rows: tuple[int, ...]
    sensitivity: Array
    cov_cad: Array


def paper_route(robot: Robot, table: PoseTable) -> PaperRoute:
    """Run the paper's route on every configuration of *table*.

    A configuration counts when its total CoM is given, or when it was measured at two tilts or on
    two slopes. Given CoMs win: the solution then starts there, without force sensors, and says
    nothing of poses that only have wrenches.

    Raises
    ------
    MissingColumnError, NotFiniteError, DataError
        If the wrench or the error of a loaded sensor is not known.
    """
    nothing = np.zeros((0, 0))
    shapes, refused = given_shapes(robot, table), list[ComcalError]()
    if not shapes:
        shapes, refused = _measured_shapes(robot, table)
    if not shapes:
        why = str(refused[0]) if refused else _why_nothing(robot, table)
        return PaperRoute((), tuple(refused), None, (), why, (), nothing, nothing)
    chain, choices, reason = _chain_and_choices(robot, shapes)
    model = Model(robot, tuple(shapes), table.tare_cov, chain, choices, table.shared)
    value, by_input, by_cad = model.differentiate()
    cov = by_input @ model.cov @ by_input.T
    cov_cad = (by_cad * model.cad_sigma**2) @ by_cad.T
    totals = tuple(_total(robot, table, s, i, value, cov, cov_cad) for i, s in enumerate(shapes))
    first, width = 3 * len(shapes), 2 * len(chain.segments) if chain else 0
    alpha_gain = by_input @ _alpha_noise(model)
    results = tuple(
        _choice(choice, first, width, i, len(choices), value, cov + cov_cad, alpha_gain)
        for i, choice in enumerate(choices)
    )
    rows = tuple(row for shape in shapes for row in shape.configuration.rows)
    best = slice(first, first + width)
    return PaperRoute(
        totals=totals,
        refused=tuple(refused),
        chain=chain,
        choices=results,
        reason=reason,
        rows=rows,
        sensitivity=by_input[best],
        cov_cad=cov_cad[best, best],
    )


def _why_nothing(robot: Robot, table: PoseTable) -> str:
    if any(True for _ in measured_supports(robot, table)):
        return "no two poses share a value of 'configuration'"
    return "no standing pose has a wrench, or its CoM given in x and z"


def given_shapes(robot: Robot, table: PoseTable) -> list[Shape]:
    """Return the poses whose CoM is given, each as a configuration of its own.

    In P, x and z suffice; in the frame of a link all three are needed. No force sensor is.
    """
    in_P = table.com_frame == STANCE_FRAME
    com_link = None if in_P else robot.tree.link_index[table.com_frame]
    everything = np.ones(len(robot.tree.links), dtype=np.bool_)
    shapes: list[Shape] = []
    for i, support in enumerate(table.support):
        known = np.isfinite(table.com[i])
        if support != NONE and known[[0, 2]].all() and (in_P or known[1]):
            carrier = Carrier(support, standing_feet(robot, support), (), (), everything)
            name = table.configuration[i] or str(table.pose[i])
            side = foot_side_links(robot, carrier)
            configuration = Configuration(name, carrier, (i,), np.zeros(1), side)
            shapes.append(shape_from_com(configuration, table, com_link))
    return shapes


def _measured_shapes(robot: Robot, table: PoseTable) -> tuple[list[Shape], list[ComcalError]]:
    """Return the configurations whose wrenches give a height, and why others do not."""
    if not any(table.configuration):
        return [], []
    coefficients = balance_coefficients(robot, table)
    found, not_rigid = find_configurations(robot, table, coefficients.rows)
    shapes: list[Shape] = []
    refused: list[ComcalError] = list(not_rigid)
    for configuration in found:
        alike = _too_alike(table, configuration, coefficients.values, coefficients.rows)
        if alike is None:
            shapes.append(shape_from_wrenches(configuration, table))
        else:
            refused.append(alike)
    return shapes, refused


def _too_alike(
    table: PoseTable, configuration: Configuration, values: Array, rows: Sequence[int]
) -> RankError | None:
    """Return why a configuration gives no height, or None when it does."""
    at = [rows.index(i) for i in configuration.rows]
    angle = spread(values[at], configuration.tilts)
    if len(at) > 1 and angle >= MIN_TILT:
        return None
    what = "has no tilted twin" if len(at) == 1 else "is tilted too little"
    return RankError(
        f"configuration {configuration.name!r} {what}: on one slope one pose says nothing about "
        "the height of the CoM",
        where=table.where(configuration.rows[-1]),
        measured=f"{np.rad2deg(angle):.2f} deg",
        limit=f"{np.rad2deg(MIN_TILT):.0f} deg",
        next_step="repeat the shape tilted about the ankles by 30 deg or more, or on a slope",
    )


def _chain_and_choices(
    robot: Robot, shapes: Sequence[Shape]
) -> tuple[PlanarChain | None, tuple[Choice, ...], str]:
    configurations = [shape.configuration for shape in shapes]
    carried = configurations[0].carrier.carried
    if any(not np.array_equal(c.carrier.carried, carried) for c in configurations):
        return None, (), "the configurations do not all load the same sensors"
    n_joints = len(robot.tree.joint_names)
    q = np.stack([shape.inputs[0][-n_joints:] for shape in shapes])
    placed = placed_configurations(robot, configurations, q)
    try:
        chain = planar_chain(robot, configurations, placed, carried)
        return chain, choices_of(chain, placed), ""
    except RankError as error:
        return None, (), str(error)


def _alpha_noise(model: Model) -> Array:
    """Return unit errors of alpha as changes of the inputs, shape (n_inputs, n_rows).

    An error of alpha is an error of the moment about P's y axis, whichever loaded sensor makes it:
    here the first. Where the CoM is given it is an error of x.
    """
    columns: list[Array] = []
    n, at = len(model.inputs), 0
    for shape in model.shapes:
        robot, carrier = model.robot, shape.configuration.carrier
        for x in shape.inputs:
            column = np.zeros(n)
            q = x[-len(robot.tree.joint_names) :][None]
            placed = placed_in_stance(robot, carrier, q)
            frame = shape.com_link if shape.given else carrier.frames[0]
            R = np.eye(3) if frame is None else placed.R[0, frame]
            if shape.given:
                column[at : at + 3] = R.T @ [1.0, 0.0, 0.0]
            else:
                weight = -robot.gravity * robot.tree.masses[carrier.carried].sum()
                column[at + 3 : at + 6] = R.T @ [0.0, weight, 0.0]
            columns.append(column)
            at += len(x)
    return np.stack(columns, axis=1)


def _total(
    robot: Robot,
    table: PoseTable,
    shape: Shape,
    index: int,
    value: Array,
    cov: Array,
    cov_cad: Array,
) -> ConfigurationCom:
    configuration = shape.configuration
    at = slice(3 * index, 3 * index + 3)
    carried = value[at]
    if shape.given:
        known, nothing = shape.com_known, np.full((3, 3), np.nan)
        return ConfigurationCom(
            configuration=configuration,
            xyz=np.where(known, carried, np.nan),
            carried_xyz=nothing[0],
            cov=np.where(np.outer(known, known), cov[at, at], np.nan),
            cov_cad=np.where(np.outer(known, known), cov_cad[at, at], np.nan),
            tilt=float("nan"),
            gain=float("nan"),
            by="given",
        )
    q = table.q[configuration.rows[0]][None]
    placed = placed_in_stance(robot, configuration.carrier, q)
    below = robot.tree.masses * ~configuration.carrier.carried
    values = balance_coefficients(robot, table.select(configuration.rows))
    m_2, m_below = float(values.mass.mean()), float(below.sum())
    share = m_2 / (m_2 + m_below)
    whole = share * carried + np.einsum("k,ki->i", below, placed.coms[0]) / (m_2 + m_below)
    angle = spread(values.values, configuration.tilts)
    return ConfigurationCom(
        configuration=configuration,
        xyz=whole,
        carried_xyz=carried,
        cov=cov[at, at] * share**2,
        cov_cad=cov_cad[at, at] * share**2,
        tilt=angle,
        gain=height_gain(angle),
        by="twin" if float(np.ptp(configuration.tilts)) >= MIN_TILT else "slope",
    )


def _choice(
    choice: Choice,
    first: int,
    width: int,
    index: int,
    n_choices: int,
    value: Array,
    cov: Array,
    alpha_gain: Array,
) -> ChoiceResult:
    at = slice(first + index * width, first + (index + 1) * width)
    check = slice(first + n_choices * width + 2 * index, first + n_choices * width + 2 * index + 2)
    r, l = value[at].reshape(-1, 2).T  # noqa: E741 - the paper's letter
    nan = np.full(2, np.nan)
    return ChoiceResult(
        choice=choice,
        w=l + 1j * r,
        cov=cov[at, at],
        noise_gain=np.linalg.norm(alpha_gain[at], axis=1),
        misfit=value[check] if choice.checking else nan,
        misfit_sigma=np.sqrt(np.diag(cov[check, check])) if choice.checking else nan,
    )
