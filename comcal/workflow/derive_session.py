# SPDX-License-Identifier: Apache-2.0
"""``comcal derive --session``: the generated Cramer function, fed with a recorded session."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from comcal.errors import RankError, UsageError
from comcal.identify.paper_route import PaperRoute, paper_route
from comcal.measure.table import PoseTable
from comcal.robot.model import Robot
from comcal.robot.tree import Array
from comcal.statics.coefficients import balance_coefficients
from comcal.statics.configurations import pitch_between
from comcal.statics.planar import PlanarChain, placed_configurations, segment_turns
from comcal.symbolic.cramer import MAX_FREE, cramer_program
from comcal.symbolic.program import Program
from comcal.symbolic.system import system_with_joints
from comcal.symbolic.to_python import python_function
from comcal.workflow.calibrate import load_session


@dataclass(frozen=True)
class SessionDerivation:
    """The CoM of every segment by the generated code and by ``solve --method cramer``.

    Parameters
    ----------
    program : Program
    segments : tuple of str
    configurations : tuple of str
        The n that solve.
    inputs : mapping
        What the function was given, by name.
    generated, solved : array, shape (n, 2)
        r and l of every segment from its joint [m].
    """

    program: Program
    segments: tuple[str, ...]
    configurations: tuple[str, ...]
    inputs: Mapping[str, Array]
    generated: Array
    solved: Array

    @property
    def difference(self) -> float:
        """Largest difference between the two [m]."""
        return float(np.max(np.abs(self.generated - self.solved)))


def derive_session(directory: Path) -> SessionDerivation:
    """Generate Cramer's rule for the segments of a session and evaluate it with its CoMs.

    Raises
    ------
    RankError
        If the session does not determine its segments by Cramer's rule.
    UsageError
        If the session cannot be read, or has more than ``MAX_FREE`` segments.
    """
    _, robot, table = load_session(directory)
    route = paper_route(robot, table)
    if route.chain is None or not route.choices:
        raise RankError(
            f"Cramer's rule does not apply to this session: {route.reason}",
            where=str(directory),
            next_step="record n + 1 shapes, each with a twin tilted about the ankles",
        )
    n = len(route.chain.segments)
    if n > MAX_FREE:
        raise UsageError("too many segments", measured=f"{n}", limit=f"{MAX_FREE}")
    program = cramer_program(system_with_joints(n))
    best = route.choices[0]
    inputs = session_inputs(robot, table, route, route.chain, best.choice.solving)
    needed = [q.name for q in program.inputs]
    found = python_function(program)(**{name: inputs[name] for name in needed})
    return SessionDerivation(
        program=program,
        segments=tuple(segment.name(robot) for segment in route.chain.segments),
        configurations=tuple(route.totals[i].configuration.name for i in best.choice.solving),
        inputs=inputs,
        generated=np.stack(found[:2], axis=-1),
        solved=np.stack([best.w.imag, best.w.real], axis=-1),
    )


def session_inputs(
    robot: Robot,
    table: PoseTable,
    route: PaperRoute,
    chain: PlanarChain,
    solving: tuple[int, ...],
) -> dict[str, Array]:
    """Return what the generated function is to be given: CoMs, angles, joints, masses.

    Notes
    -----
    A pair of legs is one segment: its joint is where the mean of the legs' joints is, weighted
    with their masses, and turns as the mean of the legs does.
    """
    configurations = [total.configuration for total in route.totals]
    q = np.stack([table.q[c.rows[0]] for c in configurations])
    at = placed_configurations(robot, configurations, q)
    turns = segment_turns(chain, at)
    masses = robot.tree.masses
    n = len(chain.segments)
    phi, x, z = (np.empty((len(configurations), n)) for _ in range(3))
    for v, segment in enumerate(chain.segments):
        links = list(segment.links)
        lead = links[0]
        phi[:, v] = pitch_between(chain.straight[lead], at.R[0, lead]) + turns[:, v]
        arm = at.p[0, links] - at.p[0, segment.anchor]
        G = masses[links] @ (arm[:, 2] + 1j * arm[:, 0])
        origins = np.einsum("k,ikc->ic", masses[links], at.p[:, links])
        joint = origins[:, 2] + 1j * origins[:, 0] - G * np.exp(1j * turns[:, v])
        x[:, v], z[:, v] = joint.imag / segment.mass, joint.real / segment.mass
    foot = masses * chain.known
    m_u = float(foot.sum())
    foot_moment = np.einsum("k,ikc->ic", foot, at.coms)
    rows = list(solving)
    return {
        "X": np.array([route.totals[i].carried_xyz[0] for i in rows]),
        "Z": np.array([route.totals[i].carried_xyz[2] for i in rows]),
        "phi": phi[rows],
        "m_2": np.array([_mass(robot, table, route, i) for i in rows]),
        "m": np.array([segment.mass for segment in chain.segments]),
        "m_u": np.array(m_u),
        "r_u": foot_moment[rows, 0] / m_u if m_u > 0 else np.zeros(n),
        "l_u": foot_moment[rows, 2] / m_u if m_u > 0 else np.zeros(n),
        "x": x[rows],
        "z": z[rows],
    }


def _mass(robot: Robot, table: PoseTable, route: PaperRoute, i: int) -> float:
    """Return the mass of which a configuration's CoM speaks [kg]."""
    total = route.totals[i]
    if total.by == "given":
        return robot.tree.total_mass
    part = table.select(total.configuration.rows)
    return float(balance_coefficients(robot, part).mass.mean())
