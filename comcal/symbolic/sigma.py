# SPDX-License-Identifier: Apache-2.0
r"""First-order uncertainty as formulas: what angle buys what accuracy.

Level ground, each configuration measured upright and as a twin tilted by tau about the ankles.
:math:`\alpha = -M_Y / F_Z` of one pose has :math:`\sigma_\alpha = \sqrt{\sigma_{M_Y}^2 +
\alpha^2 \sigma_{F_Z}^2} / F_Z`. The twin gives :math:`X = \alpha_1` and, CAD values taken as true,
:math:`dZ = (d\alpha_2 - \cos\tau \, d\alpha_1) / \sin\tau`, so with
C = c_re + j c_im the factor from K_i to G_v, alpha_1 and alpha_2 reach r_v as

.. math:: \frac{m_2}{m_v} (c_{re} - c_{im} \cot\tau) \quad\text{and}\quad
   \frac{m_2}{m_v} \frac{c_{im}}{\sin\tau},

and l_v as the same with (-c_im, c_re) for (c_re, c_im).
"""

from __future__ import annotations

from collections.abc import Sequence

from comcal.symbolic.algebra import Expr, sp
from comcal.symbolic.cramer import phase
from comcal.symbolic.one_joint import inverse_turn
from comcal.symbolic.program import (
    Output,
    Program,
    Statement,
    Steps,
    real_symbols,
    scalar,
    vector,
)
from comcal.symbolic.system import System

Factors = Sequence[Sequence[Expr]]


def sigma_program(system: System, factors: Factors, steps: Steps) -> Program:
    """Return sd of r and l of every segment from the noise of the wrenches.

    Parameters
    ----------
    system : System
        The configurations that solve.
    factors : sequence of sequence of sympy.Expr
        dG_v/dK_i, a row per segment, of :func:`one_joint_factors` or of
        :func:`~comcal.symbolic.cofactors.free_factors` [1].
    steps : Steps
        In which the factors are written.
    """
    letters, names = system.letters, system.names
    tau = vector("tau", names, "tilt of each configuration's twin about the ankles", "rad")
    alpha = vector("alpha", names, "x of the line of gravity of each configuration", "m")
    s_M = scalar("sigma_My", "standard error of the moment about P's y axis, per pose", "N m")
    s_F = scalar("sigma_Fz", "standard error of the vertical force, per pose", "N")
    F = scalar("F_Z", "vertical force, m_2 g", "N")
    noise: list[Expr] = []
    for i, name in enumerate(names):
        variance = s_M.symbols[0] ** 2 + (alpha.symbols[i] * s_F.symbols[0]) ** 2
        noise.append(steps.let(f"v_{name}", variance / F.symbols[0] ** 2, real=True))
    sigma_r: list[Expr] = []
    sigma_l: list[Expr] = []
    m_2 = steps.let("m_2", system.m_2[0], real=True)
    turned = [
        (
            steps.let(f"cot_{name}", sp.cos(t) / sp.sin(t), real=True),
            steps.let(f"csc_{name}", 1 / sp.sin(t), real=True),
        )
        for name, t in zip(names, tau.symbols, strict=True)
    ]
    for v, letter in enumerate(letters):
        variances: list[list[Expr]] = [[], []]
        for i, name in enumerate(names):
            C = factors[v][i]
            if C == 0:
                continue
            re = steps.let(f"re_{letter}_{name}", sp.re(C), real=True)
            im = steps.let(f"im_{letter}_{name}", sp.im(C), real=True)
            cot, csc = turned[i]
            variances[0].append(noise[i] * ((re - im * cot) ** 2 + (im * csc) ** 2))
            variances[1].append(noise[i] * ((im + re * cot) ** 2 + (re * csc) ** 2))
        for which, found, terms in zip("rl", (sigma_r, sigma_l), variances, strict=True):
            variance = steps.let(f"V_{which}_{letter}", sp.Add(*terms), real=True)
            found.append(m_2 / system.m[v] * sp.sqrt(variance))
    outputs = tuple(
        Output(
            f"sigma_{which}",
            tuple(f"sigma_{which}_{letter}" for letter in letters),
            tuple(values),
            True,
            f"standard deviation of {which} of each segment's CoM",
            "m",
        )
        for which, values in (("r", sigma_r), ("l", sigma_l))
    )
    return Program(
        name="link_com_sigmas",
        title=f"Uncertainty of the CoM of {len(letters)} segment(s) from the wrench noise",
        inputs=(*system.inputs, tau, alpha, s_M, s_F, F),
        steps=tuple(steps.done),
        outputs=outputs,
        statements=sigma_statements(),
    ).only_used()


def one_joint_factors(system: System, steps: Steps) -> list[list[Expr]]:
    """Return dG_v/dK_i when one joint is bent at a time: two or three of them are not zero.

    Parameters
    ----------
    system : System
    steps : Steps
        The steps are added to it.
    """
    n = len(system.letters)
    factors: list[list[Expr]] = [[sp.Integer(0)] * n for _ in range(n)]
    straight = phase(-system.angles[0][0])
    gain = [sp.Integer(-1)] * (n + 1)
    gain[n] = sp.Integer(0)
    for v in range(1, n):
        theta, letter = system.angles[v][v], system.letters[v]
        half = steps.let(f"h_{letter}", sp.sin(theta / 2), real=True)
        gain[v] = steps.let(f"q_{letter}", inverse_turn(theta, half))
    for v in range(n):
        # S_1 = K_1 e^{-j theta_1}, S_v = (K_v - S_1) gain_v; the first gain of -1 is that of S_1.
        factors[v][0] = (gain[v + 1] - gain[v]) * straight
        if v > 0:
            factors[v][v] = gain[v]
        if v + 1 < n:
            factors[v][v + 1] = -gain[v + 1]
    return factors


def sigma_statements() -> tuple[Statement, ...]:
    """Return the formulas by which to choose angles."""
    s_alpha, s_M, s_F, F, alpha, tau, s_X, s_Z, theta, s_K, m_v = real_symbols(
        [
            "sigma_alpha",
            "sigma_My",
            "sigma_Fz",
            "F_Z",
            "alpha",
            "tau",
            "sigma_X",
            "sigma_Z",
            "theta_v",
            "sigma_K",
            "m_v",
        ]
    )
    return (
        Statement(
            "The line of gravity of one pose.", s_alpha, sp.sqrt(s_M**2 + alpha**2 * s_F**2) / F
        ),
        Statement(
            "x of the CoM on level ground; the CAD values of the feet are taken as true.",
            s_X,
            s_alpha,
        ),
        Statement(
            "Height from a twin tilted by tau on level ground.",
            s_Z,
            s_alpha * sp.sqrt(1 + sp.cos(tau) ** 2) / sp.sin(tau),
        ),
        Statement(
            "One joint bent by theta_v: what K_v adds to the CoM of segment v. Noise falls as the "
            "bend grows, up to half a turn.",
            sp.Symbol("sigma_r_v"),
            s_K / (2 * m_v * sp.Abs(sp.sin(theta / 2))),
        ),
    )
