# SPDX-License-Identifier: Apache-2.0
r"""alpha .. delta and the total CoM of two poses, as formulas.

The coefficients come out of the very function that the numeric code runs,
:func:`comcal.statics.coefficients.coefficients_from_wrench`, given an array of symbols. The
two-pose formula is derived here from the first moment of the chain instead: the numeric one calls
a solver for floats (least squares over any number of poses). The tests hold them against one
another.
"""

from __future__ import annotations

from typing import Any, cast

import numpy as np

from comcal.statics.coefficients import coefficients_from_wrench
from comcal.symbolic.algebra import Expr, sp
from comcal.symbolic.program import (
    Output,
    Program,
    Quantity,
    Statement,
    Steps,
    real_symbols,
    scalar,
    vector,
)

AXES = ("X", "Y", "Z")
COEFFICIENTS = (
    ("alpha", "x of the line of gravity at z = 0 in P", "m"),
    ("beta", "its slope dx/dz", "1"),
    ("gamma", "y of the line of gravity at z = 0 in P", "m"),
    ("delta", "its slope dy/dz", "1"),
)


def coefficients_program() -> Program:
    """Return alpha, beta, gamma, delta from the wrenches of the ground on two feet.

    Notes
    -----
    Equations (1)-(13) of Muscolo 2017 without M_2: the right foot, point 0, at y = -l and the
    left one, point 1, at y = l; sole axes parallel to those of P.
    """
    half = scalar("l", "half the distance of the feet: they stand at y = -l (0) and y = l (1)", "m")
    inputs: list[Quantity] = [half]
    total = np.array([sp.Integer(0)] * 6, dtype=object)
    for foot, side in ((0, -1), (1, 1)):
        name = "right" if foot == 0 else "left"
        F = [scalar(f"F_{a}{foot}", f"force on the {name} foot along {a}", "N") for a in AXES]
        M = [scalar(f"M_{a}{foot}", f"moment about the {name} point's {a}", "N m") for a in AXES]
        inputs += [*F, *M]
        force = np.array([q.symbols[0] for q in F], dtype=object)
        moment = np.array([q.symbols[0] for q in M], dtype=object)
        point = np.array([0, side * half.symbols[0], 0], dtype=object)
        total = total + np.concatenate([force, moment + np.cross(point, force)])
    steps = Steps()
    names = [f"{kind}_{axis}" for kind in "FM" for axis in AXES]
    named = [steps.let(name, value, real=True) for name, value in zip(names, total, strict=True)]
    # The numeric function, on symbols: it only divides and stacks.
    values = coefficients_from_wrench(cast("Any", np.array(named, dtype=object)))
    outputs = tuple(
        Output(name, (name,), (value,), False, meaning, unit)
        for (name, meaning, unit), value in zip(COEFFICIENTS, values, strict=True)
    )
    X, Y, Z = real_symbols(["X", "Y", "Z"])
    alpha, beta, gamma, delta = real_symbols(name for name, _, _ in COEFFICIENTS)
    statements = (
        Statement(
            "Rest: the moment of the ground about P is that of the weight, so the CoM lies on a "
            "line, whatever the slope of the floor. Internal torques cancel.",
            X,
            alpha + beta * Z,
        ),
        Statement("The same across.", Y, gamma + delta * Z),
    )
    title = "Coefficients of the line on which the CoM lies, from two foot wrenches"
    program = Program("coefficients", title, tuple(inputs), tuple(steps.done), outputs, statements)
    return program.only_used()


def total_com_program() -> Program:
    """Return the total CoM of one shape measured at two tilts or on two slopes.

    Notes
    -----
    Equations (14)-(17), (22), (23) and (27) of Muscolo 2017 for any ankle (A, U). Pose a, then
    pose b; the CoM is that of the shape when its tilt theta is zero. Y is the mean of what the two
    poses say about it; the numeric route weighs the two by least squares, which is the same
    wherever the two agree.
    """
    poses = ("a", "b")
    lines = [vector(name, poses, f"{words}, poses a and b", u) for name, words, u in COEFFICIENTS]
    theta = vector("theta", poses, "tilt of the shape about the ankle in poses a and b", "rad")
    m_2 = scalar("m_2", "carried mass", "kg")
    m_u = scalar("m_u", "part of it that does not tilt", "kg")
    r_u = scalar("r_u", "x of the CoM of that part in P", "m")
    l_u = scalar("l_u", "z of the CoM of that part in P", "m")
    A = scalar("A", "x of the ankle axis in P", "m")
    U = scalar("U", "z of the ankle axis in P", "m")
    inputs = (*lines, theta, m_2, m_u, r_u, l_u, A, U)
    mass, foot_mass, r, l, ankle_x, ankle_z = (q.symbols[0] for q in inputs[5:])  # noqa: E741
    steps = Steps()
    m_w = steps.let("m_w", mass - foot_mass, real=True)
    known_x = steps.let("x_known", foot_mass * r + m_w * ankle_x, real=True)
    known_z = steps.let("z_known", foot_mass * l + m_w * ankle_z, real=True)
    rows: list[tuple[Expr, Expr, Expr]] = []
    for k, name in enumerate(poses):
        alpha, beta = lines[0].symbols[k], lines[1].symbols[k]
        s = steps.let(f"s_{name}", sp.sin(theta.symbols[k]), real=True)
        c = steps.let(f"c_{name}", sp.cos(theta.symbols[k]), real=True)
        # X = alpha + beta Z of the turned l_w, r_w: p l_w + q r_w = a.
        rows.append(
            (
                steps.let(f"p_{name}", s - beta * c, real=True),
                steps.let(f"q_{name}", c + beta * s, real=True),
                steps.let(f"a_{name}", mass * alpha - known_x + beta * known_z, real=True),
            )
        )
    (p_a, q_a, a_a), (p_b, q_b, a_b) = rows
    det = steps.let("det", p_b * q_a - p_a * q_b, real=True)
    # First moments of what tilts, m_w l_w and m_w r_w, by Cramer's rule.
    along = steps.let("m_l", (a_b * q_a - a_a * q_b) / det, real=True)
    across = steps.let("m_r", (p_b * a_a - p_a * a_b) / det, real=True)
    heights = [(known_z + along * sp.cos(t) - across * sp.sin(t)) / mass for t in theta.symbols]
    Y = [
        steps.let(f"Y_{name}", lines[2].symbols[k] + lines[3].symbols[k] * heights[k], real=True)
        for k, name in enumerate(poses)
    ]
    outputs = (
        Output("X", ("X",), ((known_x + across) / mass,), False, "x of the carried CoM in P", "m"),
        Output("Y", ("Y",), ((Y[0] + Y[1]) / 2,), False, "y of the carried CoM in P", "m"),
        Output("Z", ("Z",), ((known_z + along) / mass,), False, "z of the carried CoM in P", "m"),
        Output(
            "determinant",
            ("det",),
            (det,),
            False,
            "zero when the tilt does not change against gravity; trust nothing below 0.05",
            "1",
        ),
    )
    return Program(
        name="total_com",
        title="Total CoM of one shape from two tilts or two slopes",
        inputs=inputs,
        steps=tuple(steps.done),
        outputs=outputs,
        statements=_two_pose_statements(),
    ).only_used()


def _two_pose_statements() -> tuple[Statement, ...]:
    names = ["theta", "alpha", "beta", "m_2", "m_u", "m_w", "r_u", "l_u", "l_w", "r_w", "A", "U"]
    theta, alpha, beta, m_2, m_u, m_w, r_u, l_u, l_w, r_w, A, U = real_symbols(names)
    theta_a, theta_b, phi_a, phi_b = real_symbols(["theta_a", "theta_b", "phi_a", "phi_b"])
    s, c = sp.sin(theta), sp.cos(theta)
    left = m_w * (l_w * (s - beta * c) + r_w * (c + beta * s))
    right = m_2 * alpha - m_u * r_u - m_w * A + beta * (m_u * l_u + m_w * U)
    det = sp.sin((theta_b - phi_b) - (theta_a - phi_a)) / (sp.cos(phi_a) * sp.cos(phi_b))
    return (
        Statement(
            "Each pose: what tilts has its CoM at l_w, r_w from the ankle and turns by theta.",
            left,
            right,
        ),
        Statement(
            "The determinant of the two, with beta = tan(phi): it does not matter whether the "
            "robot is tilted or the floor; zero when neither changes.",
            sp.Symbol("det"),
            det,
        ),
    )
