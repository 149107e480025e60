# SPDX-License-Identifier: Apache-2.0
r"""The closed form for configurations that bend one joint at a time, for any number of links.

The first configuration is the straight shape, tilted by theta_1; in configuration v >= 2 only
joint v is bent, by theta_v, and turns all segments from v on. With
:math:`S_v = \sum_{k \ge v} G_k` the first moments are :math:`K_1 = e^{j\theta_1} S_1` and
:math:`K_v = S_1 + (e^{j\theta_v} - 1) S_v`, hence

.. math::

   S_1 = K_1 e^{-j\theta_1}, \quad S_v = \frac{K_v - S_1}{e^{j\theta_v} - 1}, \quad
   G_v = S_v - S_{v+1}, \quad |\det E| = \prod_{v \ge 2} 2 |\sin(\theta_v / 2)| .

:math:`1 / (e^{j\theta} - 1) = -\frac12 - \frac{j}{2} \cot\frac{\theta}{2}`: it turns an error of K
into one :math:`1 / (2 \sin(\theta/2))` times as large, whatever the rest of the robot is like.
"""

from __future__ import annotations

from comcal.symbolic.algebra import Expr, sp
from comcal.symbolic.chain import Chain
from comcal.symbolic.cramer import com_outputs, determinant_output, phase
from comcal.symbolic.program import Program, Steps
from comcal.symbolic.statements import one_joint_statements
from comcal.symbolic.system import System, one_joint_angles, system_of


def one_joint_system(chain: Chain) -> System:
    """Return the system of the configurations that bend one joint of *chain* at a time."""
    angles, theta = one_joint_angles(len(chain.letters))
    return system_of(chain, angles, [theta])


def one_joint_program(chain: Chain) -> Program:
    """Return the CoM of every segment in closed form; its length grows with their number only.

    Returns
    -------
    Program
        Outputs r and l of every segment [m], ``determinant``, the size of det E [1].
    """
    system = one_joint_system(chain)
    n = len(system.letters)
    thetas = [system.angles[v][v] for v in range(n)]
    steps = Steps()
    K = [steps.let(f"K_{name}", value) for name, value in zip(system.names, system.K, strict=True)]
    S = [steps.let(f"S_{system.letters[0]}", K[0] * phase(-thetas[0]))]
    determinant = sp.Integer(1)
    for v in range(1, n):
        letter = system.letters[v]
        half = steps.let(f"h_{letter}", sp.sin(thetas[v] / 2), real=True)
        # 1 / (e^{j theta} - 1), written so that a small angle loses no digits.
        gain = steps.let(f"q_{letter}", inverse_turn(thetas[v], half))
        S.append(steps.let(f"S_{letter}", (K[v] - S[0]) * gain))
        determinant = steps.let(f"det_{letter}", determinant * 2 * sp.Abs(half), real=True)
    S.append(sp.Integer(0))
    G = [
        steps.let(f"G_{letter}", S[v] - S[v + 1]) if v + 1 < n else S[v]
        for v, letter in enumerate(system.letters)
    ]
    outputs = (*com_outputs(system, G, steps), determinant_output(determinant))
    return Program(
        name="link_coms",
        title=f"CoM of {n} segment(s) of a planar chain, one joint bent at a time",
        inputs=system.inputs,
        steps=tuple(steps.done),
        outputs=outputs,
        statements=one_joint_statements(n),
    ).only_used()


def inverse_turn(theta: Expr, half_sine: Expr) -> Expr:
    """Return 1 / (e^{j theta} - 1).

    Parameters
    ----------
    theta : sympy.Expr
        [rad]
    half_sine : sympy.Expr
        sin(theta / 2).
    """
    return -sp.Rational(1, 2) - sp.I * sp.cos(theta / 2) / (2 * half_sine)
