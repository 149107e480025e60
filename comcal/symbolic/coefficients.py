# SPDX-License-Identifier: Apache-2.0
r"""alpha .. delta and the total CoM of two poses, as formulas.

Both come out of the very functions that the numeric code runs, given symbols:
:func:`comcal.statics.coefficients.coefficients_from_wrench` and the balance of a tilted pose in
:mod:`comcal.statics.two_pose`. The numeric route takes any number of poses and also the Y lines
into one least squares; for two poses without a change of slope across the two are the same.
"""

from __future__ import annotations

from typing import Any, cast

import numpy as np

from comcal.statics.coefficients import coefficients_from_wrench
from comcal.statics.two_pose import (
    FootSide,
    Row,
    determinants,
    known_part,
    tilt_row,
    turned_height,
)
from comcal.symbolic.algebra import sp
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
    poses say about it.
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
    mass, *foot = (q.symbols[0] for q in inputs[5:])
    steps = Steps()
    # The numeric functions, on symbols: they only add, multiply and divide.
    x, z = known_part(mass, FootSide(*foot))
    known = (steps.let("x_known", x, real=True), steps.let("z_known", z, real=True))
    turns: list[tuple[Any, Any]] = []
    rows: list[Row] = []
    for k, name in enumerate(poses):
        angle = theta.symbols[k]
        s = steps.let(f"s_{name}", sp.sin(angle), real=True)
        c = steps.let(f"c_{name}", sp.cos(angle), real=True)
        turns.append((s, c))
        p, q, a = tilt_row((lines[0].symbols[k], lines[1].symbols[k]), known, (s, c))
        rows.append(
            (
                steps.let(f"p_{name}", p, real=True),
                steps.let(f"q_{name}", q, real=True),
                steps.let(f"a_{name}", a, real=True),
            )
        )
    D_l, D_r, D = determinants(*rows)
    det = steps.let("det", D, real=True)
    # The share in the CoM of what tilts: m_w l_w / m_2 and m_w r_w / m_2.
    rest = (steps.let("z_rest", D_l / det, real=True), steps.let("x_rest", D_r / det, real=True))
    Y = [
        steps.let(
            f"Y_{name}",
            lines[2].symbols[k] + lines[3].symbols[k] * turned_height(known, rest, turn),
            real=True,
        )
        for k, (name, turn) in enumerate(zip(poses, turns, strict=True))
    ]
    outputs = (
        Output("X", ("X",), (known[0] + rest[1],), False, "x of the carried CoM in P", "m"),
        Output("Y", ("Y",), ((Y[0] + Y[1]) / 2,), False, "y of the carried CoM in P", "m"),
        Output("Z", ("Z",), (known[1] + rest[0],), False, "z of the carried CoM in P", "m"),
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
