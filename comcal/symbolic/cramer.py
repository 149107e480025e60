# SPDX-License-Identifier: Apache-2.0
r"""Cramer's rule for any configurations of a planar chain, as a straight line of small steps.

Two things keep the n x n complex system small. Row i divided by its first entry,
:math:`e^{j\varphi_{i1}}`, has only relative angles left; less row 1 it is

.. math:: D_{iv} = e^{j(\varphi_{iv} - \varphi_{i1})} - e^{j(\varphi_{1v} - \varphi_{11})},
   \qquad i, v \ge 2,

so that :math:`|\det E| = |\det D|` with n - 1 rows, and a row is zero when the shape does not
change. The minors of the first rows of D, bordered by the right-hand side, are then named one by
one: each determinant of Cramer's rule is built of smaller ones, each of which is computed once.
There is no division but the last, hence no pivot that could vanish while the determinant does not.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

from comcal.errors import RankError, UsageError
from comcal.symbolic.algebra import Expr, sp
from comcal.symbolic.minors import cramer_by_minors
from comcal.symbolic.program import Output, Program, Steps, folded
from comcal.symbolic.statements import free_statements
from comcal.symbolic.system import System

MAX_FREE = 12
"""Steps double with every link: beyond this many, bend one joint at a time."""


def cramer_program(system: System) -> Program:
    """Return the CoM of every segment by Cramer's rule.

    Parameters
    ----------
    system : System
        At least as many configurations as segments. The first choice of n whose determinant is
        not zero for all angles solves; the others check.

    Returns
    -------
    Program
        Outputs r and l of every segment [m], ``determinant``, the size of det E [1], and, where
        configurations are left to check, ``misfit_x`` and ``misfit_z`` [m].

    Raises
    ------
    RankError
        If there are too few configurations, or all of them are one shape.
    UsageError
        If there are more than ``MAX_FREE`` segments.
    """
    n = len(system.letters)
    if n > MAX_FREE:
        raise UsageError(
            "Cramer's rule for free configurations doubles with every link",
            measured=f"{n} links",
            limit=f"{MAX_FREE}",
            next_step="use the configurations one-joint, whose formula is short for any number",
        )
    if len(system.angles) < n:
        raise RankError(
            "too few configurations for Cramer's rule",
            measured=f"{len(system.angles)} configuration(s) for {n} segment(s)",
            limit=f"{n}",
            next_step="add a shape for every segment",
        )
    for solving in combinations(range(len(system.angles)), n):
        steps = Steps()
        solution = _solve(system, solving, steps)
        if solution is not None:
            return _finish(system, solving, steps, *solution)
    raise RankError(
        "the configurations are one shape for all values of their angles: the determinant is zero",
        next_step="bend one joint at a time; a tilt about the ankles is the same shape",
    )


def _solve(system: System, solving: Sequence[int], steps: Steps) -> tuple[list[Expr], Expr] | None:
    """Write the steps to G and det D; None where the determinant is zero for all angles."""
    first, D = reduced_rows(system, solving, steps)
    rhs: list[Expr] = []
    for i in solving:
        name = system.names[i]
        K = steps.let(f"K_{name}", system.K[i])
        rhs.append(steps.let(f"k_{name}", K * phase(-system.angles[i][0])))
    names = [system.names[i] for i in solving[1:]]
    B = [steps.let(f"B_{name}", k - rhs[0]) for name, k in zip(names, rhs[1:], strict=True)]
    letters = system.letters[1:]
    found = cramer_by_minors(D, B, letters, [f"G_{letter}" for letter in letters], steps)
    if found is None:
        return None
    G, det = found
    rest = sp.Add(*(f * g for f, g in zip(first[1:], G, strict=True)))
    return [steps.let(f"G_{system.letters[0]}", rhs[0] - rest), *G], det


def reduced_rows(
    system: System, solving: Sequence[int], steps: Steps
) -> tuple[tuple[Expr, ...], list[list[Expr]]]:
    """Return e^{j relative angle} of the first configuration, and D of the others.

    Parameters
    ----------
    system : System
    solving : sequence of int
        n configurations.
    steps : Steps
        The steps are added to it.

    Returns
    -------
    first : tuple of sympy.Expr
        n turns, the first of which is 1.
    D : list of list of sympy.Expr
        n - 1 rows of n - 1.
    """
    turns: list[tuple[Expr, ...]] = []
    for i in solving:
        named = [f"f_{system.names[i]}_{letter}" for letter in system.letters]
        relative = [phi - system.angles[i][0] for phi in system.angles[i]]
        values = zip(named, relative, strict=True)
        turns.append(tuple(steps.let(name, phase(phi)) for name, phi in values))
    first = turns[0]
    D = [
        [
            steps.let(f"D_{system.names[i]}_{letter}", a - b)
            for letter, a, b in zip(system.letters[1:], turn[1:], first[1:], strict=True)
        ]
        for i, turn in zip(solving[1:], turns[1:], strict=True)
    ]
    return first, D


def _finish(
    system: System,
    solving: Sequence[int],
    steps: Steps,
    G: Sequence[Expr],
    det: Expr,
) -> Program:
    outputs = [*com_outputs(system, G, steps), determinant_output(sp.Abs(det))]
    checking = [i for i in range(len(system.angles)) if i not in solving]
    if checking:
        outputs += _misfits(system, checking, G, steps)
    return Program(
        name="link_coms",
        title=f"CoM of {len(system.letters)} segment(s) of a planar chain, by Cramer's rule",
        inputs=system.inputs,
        steps=tuple(steps.done),
        outputs=tuple(outputs),
        statements=free_statements(system, solving),
    ).only_used()


def com_outputs(system: System, G: Sequence[Expr], steps: Steps) -> list[Output]:
    """Return r and l of every segment, which follow from G by taking away what is known.

    Parameters
    ----------
    system : System
    G : sequence of sympy.Expr
        m_v (l_v + j r_v) plus the lever of the segment [kg m].
    steps : Steps
        The divisions by the masses are added to it.
    """
    w = [
        steps.let(f"w_{letter}", (g - lever) / m)
        for letter, g, lever, m in zip(system.letters, G, system.levers, system.m, strict=True)
    ]
    r = tuple(sp.im(value) for value in w)
    l = tuple(sp.re(value) for value in w)  # noqa: E741 - the paper's letter
    return [
        Output(
            "r",
            tuple(f"r_{letter}" for letter in system.letters),
            r,
            True,
            "x of each segment's CoM from its joint, in axes that turn with it",
            "m",
        ),
        Output(
            "l",
            tuple(f"l_{letter}" for letter in system.letters),
            l,
            True,
            "z of each segment's CoM from its joint, in axes that turn with it",
            "m",
        ),
    ]


def determinant_output(value: Expr) -> Output:
    """Return the size of det E, by which a caller judges the configurations.

    Parameters
    ----------
    value : sympy.Expr
        [1]
    """
    meaning = "|det E|: zero when the shape does not change; trust nothing below 0.05"
    return Output("determinant", ("det",), (value,), False, meaning, "1")


def _misfits(
    system: System, checking: Sequence[int], G: Sequence[Expr], steps: Steps
) -> list[Output]:
    """Return predicted minus given CoM of the configurations that did not solve."""
    misfit: list[Expr] = []
    for i in checking:
        predicted = sp.Add(*(phase(phi) * g for phi, g in zip(system.angles[i], G, strict=True)))
        K = steps.let(f"K_{system.names[i]}", system.K[i])
        misfit.append(steps.let(f"c_{system.names[i]}", (predicted - K) / system.m_2[i]))
    names = [system.names[i] for i in checking]
    return [
        Output(
            f"misfit_{axis}",
            tuple(f"misfit_{axis}_{name}" for name in names),
            tuple(part(value) for value in misfit),
            True,
            f"{axis} of the predicted minus the given CoM of configuration {', '.join(names)}",
            "m",
        )
        for axis, part in (("x", sp.im), ("z", sp.re))
    ]


def phase(angle: Expr) -> Expr:
    """Return e^{j angle}; a number where the angle is one.

    Parameters
    ----------
    angle : sympy.Expr
        [rad]
    """
    return folded(sp.exp(sp.I * angle))
