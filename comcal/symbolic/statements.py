# SPDX-License-Identifier: Apache-2.0
"""What a derivation says to its reader beside the code: system, determinant, singularities."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from comcal.symbolic.algebra import sp
from comcal.symbolic.chain import letters_of
from comcal.symbolic.program import Statement, real_symbols
from comcal.symbolic.real_system import real_system

if TYPE_CHECKING:
    from comcal.symbolic.system import System

MOST_SHOWN = 4
"""Matrices of more rows are not printed whole."""


def balance_statements(letters: Sequence[str]) -> tuple[Statement, ...]:
    """Return the balance of one posture and what the unknowns of the system mean."""
    m_2, Z, X, m_u, l_u, r_u, m_w, U = real_symbols(
        ["m_2", "Z", "X", "m_u", "l_u", "r_u", "m_w", "U"]
    )
    G, phi = sp.IndexedBase("G"), sp.IndexedBase("varphi")
    m, l, r, L = (sp.IndexedBase(s) for s in "mlrL")  # noqa: E741 - the paper's letter
    v, k, n = sp.symbols("v k n", integer=True)
    turned = sp.Sum(G[v] * sp.exp(sp.I * phi[v]), (v, 1, n))
    return (
        Statement(
            "First moment about P of one configuration, z + I x: what stays on the ground, the "
            "ankle with all above it, and one complex number per segment, turned by its pitch.",
            m_2 * (Z + sp.I * X),
            m_u * (l_u + sp.I * r_u) + m_w * U + turned,
        ),
        Statement(
            "That number: the segment's own first moment, and what it carries at its end.",
            G[v],
            m[v] * (l[v] + sp.I * r[v]) + L[v] * sp.Sum(m[k], (k, v + 1, n)),
        ),
        Statement(f"Segments 1 .. n are called {', '.join(letters)}, from the ankle up."),
    )


def free_statements(system: System, solving: Sequence[int]) -> tuple[Statement, ...]:
    """Return what is to be said about n configurations with any angles."""
    n = len(solving)
    found = list(balance_statements(system.letters))
    E = sp.ImmutableMatrix([[sp.exp(sp.I * phi) for phi in system.angles[i]] for i in solving])
    K = sp.ImmutableMatrix([sp.Symbol(f"K_{system.names[i]}") for i in solving])
    unknown = sp.ImmutableMatrix([sp.Symbol(f"G_{letter}") for letter in system.letters])
    names = ", ".join(system.names[i] for i in solving)
    if n <= MOST_SHOWN:
        found.append(
            Statement(
                f"The system E G = K of configurations {names}.",
                sp.MatMul(E, unknown, evaluate=False),
                K,
            )
        )
    else:
        found.append(Statement("The system is E G = K with E[i, v] = exp(I phi[i, v])."))
    if n == 2:
        a, b = (system.angles[i][1] - system.angles[i][0] for i in solving)
        A, u, a_real = real_system(system.take(solving))
        found.append(
            Statement(
                "The same in real numbers, x and z in turn: (38) and (39), corrected.",
                sp.MatMul(sp.ImmutableMatrix(A), sp.ImmutableMatrix(u), evaluate=False),
                sp.ImmutableMatrix(a_real),
            )
        )
        found.append(
            Statement(
                "The determinant, whose square is that of the real system (38) per m_b^2 m_c^2: "
                "only the change of the relative angle counts.",
                sp.Symbol("|det E|^2"),
                2 * (1 - sp.cos(b - a)),
            )
        )
    found.append(
        Statement(
            "Singular configurations: det E is zero when the shape does not change. A tilt of the "
            "whole robot is the same shape. det E = e^(I sum phi_i1) det D, and row i of D is zero "
            "when configuration i has the relative angles of the first."
        )
    )
    found.append(
        Statement(
            "Noise: an error of K_i reaches G_v times the cofactor of E_iv over det E, so it grows "
            "as one over the change of shape."
        )
    )
    return tuple(found)


def one_joint_statements(n: int) -> tuple[Statement, ...]:
    """Return what is to be said about configurations that bend one joint at a time."""
    letters = letters_of(n)
    S, K, G = (sp.IndexedBase(s) for s in "SKG")
    theta = sp.IndexedBase("theta")
    v, N = sp.symbols("v n", integer=True)
    found = [
        *balance_statements(letters),
        Statement(
            "The first configuration is the straight shape, tilted by theta_1.",
            S[1],
            K[1] * sp.exp(-sp.I * theta[1]),
        ),
        Statement(
            "In configuration v only joint v is bent, by theta_v.",
            S[v],
            (K[v] - S[1]) / (sp.exp(sp.I * theta[v]) - 1),
        ),
        Statement("One segment is the difference of two sums; S_(n+1) = 0.", G[v], S[v] - S[v + 1]),
        Statement(
            "The determinant; singular when any joint is not bent: the shape does not change then.",
            sp.Symbol("|det E|"),
            sp.Product(2 * sp.Abs(sp.sin(theta[v] / 2)), (v, 2, N)),
        ),
        Statement(
            "Noise gain of configuration v: an error of K_v or S_1 reaches S_v times this.",
            sp.Symbol("gain_v"),
            1 / (2 * sp.Abs(sp.sin(theta[v] / 2))),
        ),
    ]
    return tuple(found)
