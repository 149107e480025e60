# SPDX-License-Identifier: Apache-2.0
"""alpha .. delta, the two-pose formula and sigmas as formulas agree with the numeric route."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

from comcal.statics.coefficients import coefficients_from_wrench, coefficients_jacobian
from comcal.statics.two_pose import (
    FootSide,
    determinants,
    height_gain,
    known_part,
    tilt_row,
    total_com,
    turned_height,
)
from comcal.symbolic.chain import planar_chain
from comcal.symbolic.coefficients import coefficients_program, total_com_program
from comcal.symbolic.cofactors import free_factors
from comcal.symbolic.cramer import cramer_program
from comcal.symbolic.one_joint import one_joint_program, one_joint_system
from comcal.symbolic.program import Program, Steps
from comcal.symbolic.samples import sample_inputs
from comcal.symbolic.sigma import one_joint_factors, sigma_program, sigma_statements
from comcal.symbolic.system import free_angles, system_of
from comcal.symbolic.to_python import python_function


def test_coefficients_of_two_feet_are_those_of_their_sum_about_p() -> None:
    rng = np.random.default_rng(5)
    half, w = 0.11, rng.normal(size=(2, 6)) * 20 + [0, 0, 150, 0, 0, 0]
    total = np.zeros(6)
    for side, wrench in zip((-1, 1), w, strict=True):
        force = wrench[:3]
        total += [*force, *(wrench[3:] + np.cross([0, side * half, 0], force))]
    inputs = {"l": half}
    for foot in (0, 1):
        inputs |= {
            f"{kind}_{axis}{foot}": w[foot, 3 * k + i]
            for k, kind in enumerate("FM")
            for i, axis in enumerate("XYZ")
        }
    program = coefficients_program()
    found = python_function(program)(**{q.name: inputs[q.name] for q in program.inputs})
    assert found == pytest.approx(coefficients_from_wrench(total), abs=1e-13)


def random_twin(rng: np.random.Generator) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """One shape on two slopes at two tilts, as a rigid body laid out in space."""
    m_2, m_u = rng.uniform(20, 60), rng.uniform(1, 4)
    r_u, l_u, A, U = rng.normal(size=4) * 0.1
    w, y = rng.normal(size=2) * 0.4, float(rng.normal() * 0.1)
    theta = np.array([rng.uniform(-0.3, 0.1), rng.uniform(0.2, 0.6)])
    beta, delta = rng.normal(size=2) * 0.1, rng.normal(size=2) * 0.1
    s, c = np.sin(theta), np.cos(theta)
    x_w, z_w = A + w[0] * s + w[1] * c, U + w[0] * c - w[1] * s
    X = (m_u * r_u + (m_2 - m_u) * x_w) / m_2
    Z = (m_u * l_u + (m_2 - m_u) * z_w) / m_2
    upright = [
        (m_u * r_u + (m_2 - m_u) * (A + w[1])) / m_2,
        y,
        (m_u * l_u + (m_2 - m_u) * (U + w[0])) / m_2,
    ]
    inputs = {"alpha": X - beta * Z, "beta": beta, "gamma": y - delta * Z, "delta": delta}
    foot = {"m_2": m_2, "m_u": m_u, "r_u": r_u, "l_u": l_u, "A": A, "U": U}
    return {**inputs, "theta": theta, **foot}, np.array(upright)


@pytest.mark.parametrize("seed", range(8))
def test_two_pose_formula_agrees_with_the_numeric_one_and_the_truth(seed: int) -> None:
    inputs, truth = random_twin(np.random.default_rng(seed))
    *found, _ = python_function(total_com_program())(**inputs)
    lines = np.stack([inputs[k] for k in ("alpha", "beta", "gamma", "delta")], axis=-1)
    foot = FootSide(*(np.array(inputs[k]) for k in ("m_u", "r_u", "l_u", "A", "U")))
    numeric = total_com(lines, np.array(inputs["m_2"]), inputs["theta"], foot)
    assert found == pytest.approx(numeric, abs=1e-12)
    assert found == pytest.approx(truth, abs=1e-12)


def test_the_balance_of_a_tilted_pose_on_symbols_is_the_one_laid_out_in_the_plane() -> None:
    """Independent of statics: the CoM of foot and tilted rest, put on the line of gravity."""
    names = "alpha beta m_2 m_u r_u l_u A U l r s c"
    alpha, beta, m_2, m_u, r_u, l_u, A, U, l_w, r_w, s, c = sp.symbols(names)
    m_w = m_2 - m_u
    x = (m_u * r_u + m_w * (A + r_w * c + l_w * s)) / m_2
    z = (m_u * l_u + m_w * (U + l_w * c - r_w * s)) / m_2
    known = known_part(m_2, FootSide(m_u, r_u, l_u, A, U))
    p, q, a = tilt_row((alpha, beta), known, (s, c))
    rest = (m_w * l_w / m_2, m_w * r_w / m_2)
    assert sp.expand(p * rest[0] + q * rest[1] - a - (x - alpha - beta * z)) == 0
    assert sp.expand(turned_height(known, rest, (s, c)) - z) == 0


def test_the_determinants_are_those_that_sympy_solves_with() -> None:
    p_1, q_1, a_1, p_2, q_2, a_2, l_w, r_w = sp.symbols("p_1 q_1 a_1 p_2 q_2 a_2 l_w r_w")
    found = sp.solve([p_1 * l_w + q_1 * r_w - a_1, p_2 * l_w + q_2 * r_w - a_2], [l_w, r_w])
    D_l, D_r, D = determinants((p_1, q_1, a_1), (p_2, q_2, a_2))
    assert sp.cancel(D_l / D - found[l_w]) == 0
    assert sp.cancel(D_r / D - found[r_w]) == 0


@pytest.mark.parametrize("seed", range(4))
def test_the_stated_determinant_of_the_two_pose_formula_is_right(seed: int) -> None:
    inputs, _ = random_twin(np.random.default_rng(seed))
    program = total_com_program()
    stated = next(s.right for s in program.statements if str(s.left) == "det")
    phi = np.arctan(inputs["beta"])
    values = dict(zip(("theta_a", "theta_b"), inputs["theta"], strict=True))
    values |= dict(zip(("phi_a", "phi_b"), phi, strict=True))
    right = stated.subs({s: values[s.name] for s in stated.free_symbols})
    assert python_function(program)(**inputs)[3] == pytest.approx(float(right), rel=1e-12)


def stated_sigma(name: str, **values: float) -> float:
    right = next(s.right for s in sigma_statements() if str(s.left) == name)
    return float(right.subs({s: values[s.name] for s in right.free_symbols}))


def test_stated_sigma_of_alpha_is_that_of_the_numeric_jacobian() -> None:
    w = np.array([1.0, 2.0, 180.0, 3.0, -4.0, 0.5])
    J = coefficients_jacobian(w)[0]
    numeric = np.hypot(J[4] * 0.02, J[2] * 0.3)
    stated = stated_sigma("sigma_alpha", sigma_My=0.02, sigma_Fz=0.3, F_Z=180, alpha=4 / 180)
    assert stated == pytest.approx(numeric, rel=1e-12)


def test_stated_sigma_of_the_height_is_that_of_the_numeric_route() -> None:
    stated = stated_sigma("sigma_Z", sigma_alpha=1.0, tau=0.4)
    assert stated == pytest.approx(height_gain(0.4), rel=1e-12)


def link_and_sigma(kind: str, n: int) -> tuple[Program, Program]:
    chain, steps = planar_chain(n), Steps()
    if kind == "one-joint":
        system = one_joint_system(chain)
        factors = one_joint_factors(system, steps)
        return one_joint_program(chain), sigma_program(system, factors, steps)
    angles, phi = free_angles(n)
    system = system_of(chain, angles, [phi])
    return cramer_program(system), sigma_program(system, free_factors(system, steps), steps)


@pytest.mark.parametrize("kind", ["one-joint", "free"])
@pytest.mark.parametrize("n", [1, 2, 3])
def test_sigma_of_links_is_propagated_through_twins_and_cramer(kind: str, n: int) -> None:
    """Finite differences of the whole generated route, twin by twin, against the formula."""
    links, sigma = link_and_sigma(kind, n)
    inputs = sample_inputs((*links.inputs, *sigma.inputs))
    m_2 = float(inputs["m_u"] + inputs["m"].sum())
    twin, cramer = python_function(total_com_program()), python_function(links)

    def route(first: np.ndarray, second: np.ndarray) -> np.ndarray:
        X, Z = np.empty(n), np.empty(n)
        for i in range(n):
            given = {name: inputs[name] for name in ("m_u", "r_u", "l_u", "U")}
            X[i], _, Z[i], _ = twin(
                alpha=[first[i], second[i]],
                beta=[0, 0],
                gamma=[0, 0],
                delta=[0, 0],
                theta=[0, inputs["tau"][i]],
                m_2=m_2,
                A=0,
                **given,
            )
        given = {q.name: inputs[q.name] for q in links.inputs}
        r, along, _ = cramer(**{**given, "X": X, "Z": Z})
        return np.concatenate([r, along])

    first, second = inputs["alpha"], inputs["alpha"] + 0.1
    by_hand = np.zeros(2 * n)
    for i in range(n):
        noise = (
            np.hypot(inputs["sigma_My"], inputs["alpha"][i] * inputs["sigma_Fz"]) / inputs["F_Z"]
        )
        step = np.zeros(n)
        step[i] = 1e-3
        for a, b in ((step, 0 * step), (0 * step, step)):
            slope = (route(first + a, second + b) - route(first - a, second - b)) / 2e-3
            by_hand += (slope * noise) ** 2
    found = python_function(sigma)(**{q.name: inputs[q.name] for q in sigma.inputs})
    assert np.concatenate(found) == pytest.approx(np.sqrt(by_hand), rel=1e-7)
