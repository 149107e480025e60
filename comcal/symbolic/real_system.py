# SPDX-License-Identifier: Apache-2.0
"""The 2n x 2n real form of E G = K, as Muscolo 2017 (34)-(39) writes it for n = 2, corrected.

Printed there are a wrong sign in row 3 of (38) and a wrong function in the last entry of (40)-(42).
"""

from __future__ import annotations

from comcal.symbolic.algebra import Matrix, sp
from comcal.symbolic.program import real_symbols
from comcal.symbolic.real_form import split
from comcal.symbolic.system import System


def real_system(system: System) -> tuple[Matrix, Matrix, Matrix]:
    """Return A, the unknowns (r_1, l_1, r_2, l_2, ...) and the right-hand side of A u = a.

    Parameters
    ----------
    system : System

    Returns
    -------
    A : sympy.Matrix, shape (2 n_configurations, 2 n)
        x and z of the first moment of each configuration in turn [kg].
    u : sympy.Matrix, shape (2 n, 1)
        [m]
    a : sympy.Matrix, shape (2 n_configurations, 1)
        [kg m]
    """
    rows: list[list[object]] = []
    rhs: list[object] = []
    for angles, K in zip(system.angles, system.K, strict=True):
        x: list[object] = []
        z: list[object] = []
        for m, phi in zip(system.m, angles, strict=True):
            s, c = sp.sin(phi), sp.cos(phi)
            x += [m * c, m * s]
            z += [-m * s, m * c]
        rows += [x, z]
        turned = zip(system.levers, angles, strict=True)
        known = sp.Add(*(lever * sp.exp(sp.I * phi) for lever, phi in turned))
        height, across = split(K - known, {})
        rhs += [across, height]
    names = [f"{which}_{letter}" for letter in system.letters for which in "rl"]
    return sp.Matrix(rows), sp.Matrix(real_symbols(names)), sp.Matrix(rhs)
