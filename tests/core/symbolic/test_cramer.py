# SPDX-License-Identifier: Apache-2.0
"""Cramer's rule as formulas against numpy, the paper's equations and the corrected closed form.

Not covered: robots (test_robot_chain.py) and generated C (test_printers.py).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
import sympy as sp

from comcal.errors import RankError, UsageError
from comcal.statics.published_chain import Bends, FootCad, PublishedChain, TotalCom
from comcal.statics.published_links import (
    link_com_matrix,
    link_com_rhs,
    link_coms_from_totals,
    listing_closed_form,
    rest_com,
)
from comcal.symbolic.chain import first_moment, planar_chain
from comcal.symbolic.cramer import cramer_program
from comcal.symbolic.one_joint import one_joint_program, one_joint_system
from comcal.symbolic.program import Program, scalar
from comcal.symbolic.real_system import real_system
from comcal.symbolic.system import free_angles, system_of
from comcal.symbolic.to_python import python_function


@dataclass(frozen=True)
class Example:
    """A planar chain with everything known, laid out joint by joint by numpy alone."""

    m: np.ndarray
    L: np.ndarray
    w: np.ndarray
    m_u: float
    r_u: float
    l_u: float
    U: float

    def total(self, angles: np.ndarray) -> np.ndarray:
        """Total CoM z + j x for angles (..., n)."""
        turned = np.exp(1j * angles)
        moment = self.m_u * (self.l_u + 1j * self.r_u) + np.zeros(angles.shape[:-1])
        at = self.U + np.zeros(angles.shape[:-1], complex)
        for v in range(len(self.m)):
            moment = moment + self.m[v] * (at + self.w[v] * turned[..., v])
            if v < len(self.L):
                at = at + self.L[v] * turned[..., v]
        return moment / (self.m_u + self.m.sum())

    def inputs(self, program: Program, angles: np.ndarray, **more: Any) -> dict[str, Any]:
        c = self.total(angles)
        every = {"X": c.imag, "Z": c.real, "phi": angles, **vars(self), **more}
        return {q.name: every[q.name] for q in program.inputs}


def example(n: int, rng: np.random.Generator, length: float = 0.4) -> Example:
    return Example(
        m=rng.uniform(1, 5, n),
        L=rng.uniform(0.5, 1.0, n - 1) * length,
        w=length * (rng.normal(size=n) + 0.5j * rng.normal(size=n)),
        m_u=float(rng.uniform(0.5, 2)),
        r_u=float(rng.normal() * 0.05),
        l_u=float(rng.normal() * 0.05),
        U=float(rng.uniform(0.05, 0.1)),
    )


def free_program(n: int) -> Program:
    angles, phi = free_angles(n)
    return cramer_program(system_of(planar_chain(n), angles, [phi]))


def one_joint(theta: np.ndarray) -> np.ndarray:
    """Angles (..., n, n) of configurations that bend one joint at a time."""
    n = theta.shape[-1]
    return np.where(np.arange(n) >= np.arange(n)[:, None], theta[..., :, None], 0.0)


def solved_by_numpy(chain: Example, angles: np.ndarray) -> np.ndarray:
    """w of every segment, from E and the known lengths by numpy's LU."""
    turned = np.exp(1j * angles)
    K = (chain.m_u + chain.m.sum()) * chain.total(angles)
    K = K - chain.m_u * (chain.l_u + 1j * chain.r_u)
    at = chain.U + np.zeros(angles.shape, complex)
    at[..., 1:] += np.cumsum(chain.L * turned[..., :-1], axis=-1)
    K = K - at @ chain.m
    return np.linalg.solve(turned, K[..., None])[..., 0] / chain.m


@pytest.mark.parametrize("n", range(1, 11))
def test_free_configurations_agree_with_numpy_and_the_truth(n: int) -> None:
    rng = np.random.default_rng(n)
    chain, program = example(n, rng), free_program(n)
    angles = rng.uniform(-1.5, 1.5, (20, n, n))
    angles = angles[np.linalg.cond(np.exp(1j * angles)) < 100]
    assert len(angles) > 0
    r, along, det = python_function(program)(**chain.inputs(program, angles))
    assert along + 1j * r == pytest.approx(solved_by_numpy(chain, angles), abs=1e-9)
    assert along + 1j * r == pytest.approx(np.broadcast_to(chain.w, along.shape), abs=1e-9)
    assert det == pytest.approx(np.abs(np.linalg.det(np.exp(1j * angles))), rel=1e-9)


@pytest.mark.parametrize("n", [1, 2, 3, 10, 50])
def test_one_joint_at_a_time_agrees_with_numpy(n: int) -> None:
    rng = np.random.default_rng(n)
    chain, program = example(n, rng, length=min(0.4, 2.0 / n)), one_joint_program(planar_chain(n))
    theta = rng.uniform(0.3, 1.2, (5, n)) * rng.choice([-1, 1], (5, n))
    angles = one_joint(theta)
    r, along, det = python_function(program)(**chain.inputs(program, angles, theta=theta))
    assert along + 1j * r == pytest.approx(solved_by_numpy(chain, angles), abs=1e-12)
    assert along + 1j * r == pytest.approx(np.broadcast_to(chain.w, along.shape), abs=1e-12)
    assert det == pytest.approx(np.abs(np.linalg.det(np.exp(1j * angles))), rel=1e-10)


def test_the_closed_form_has_a_length_proportional_to_the_links() -> None:
    lengths = [len(one_joint_program(planar_chain(n)).steps) for n in (10, 20, 30)]
    assert lengths[2] - lengths[1] == lengths[1] - lengths[0]


def test_a_small_bend_loses_no_digits_in_the_closed_form() -> None:
    """G_2 = (K_2 - S_1)/(e^{j theta} - 1): with K_1 = 0 nothing else can lose digits."""
    program = one_joint_program(planar_chain(2))
    values = {"X": [0, 1.0], "Z": [0, 0], "theta": [0.0, 1e-7], "m": [1, 1], "L": [0.0]}
    r, along, _ = python_function(program)(**values, m_u=0, r_u=0, l_u=0, U=0)
    # 2 j / (e^{j theta} - 1) = 2 / theta - j + ..
    assert along[1] == pytest.approx(2e7, rel=1e-14)
    assert r[1] == pytest.approx(-1.0, rel=1e-12)


PAPER = PublishedChain(FootCad(1.1, 0.013, 0.021, 0.047), m_b=1.9, m_c=3.3, L_b=0.41)
TRUE = (0.01, 0.2, -0.02, 0.25)


def paper_program() -> Program:
    """Configurations b and c of the paper: tilted straight, and only the thigh bent."""
    theta = [scalar(f"theta_{v}", "", "rad") for v in "bc"]
    b, c = (q.symbols[0] for q in theta)
    system = system_of(planar_chain(2), ((b, b), (sp.Integer(0), c)), theta)
    return cramer_program(system)


def paper_inputs(chain: PublishedChain, b: TotalCom, c: TotalCom, bends: Bends) -> dict[str, Any]:
    foot = chain.foot
    return {
        "X": [b.X, c.X],
        "Z": [b.Z, c.Z],
        "theta_b": bends.theta_b,
        "theta_c": bends.theta_c,
        "m": [chain.m_b, chain.m_c],
        "L": [chain.L_b],
        "m_u": foot.m_u,
        "r_u": foot.r_u,
        "l_u": foot.l_u,
        "U": foot.U,
    }


def totals(links: tuple[float, ...], bends: Bends) -> tuple[TotalCom, TotalCom]:
    r_b, l_b, r_c, l_c = links
    foot = PAPER.foot
    chain = Example(
        np.array([PAPER.m_b, PAPER.m_c]),
        np.array([PAPER.L_b]),
        np.array([l_b + 1j * r_b, l_c + 1j * r_c]),
        foot.m_u,
        foot.r_u,
        foot.l_u,
        foot.U,
    )
    both = chain.total(np.array([[bends.theta_b] * 2, [0.0, bends.theta_c]]))
    return TotalCom(both[0].imag, both[0].real), TotalCom(both[1].imag, both[1].real)


@pytest.mark.parametrize("bends", [Bends(0.175, 0.175), Bends(-0.4, 0.9), Bends(0.0, -0.3)])
def test_two_links_equal_the_corrected_closed_form_of_the_paper(bends: Bends) -> None:
    b, c = totals(TRUE, bends)
    program = paper_program()
    r, along, _ = python_function(program)(**paper_inputs(PAPER, b, c, bends))
    found = link_coms_from_totals(b, c, bends, PAPER)
    assert [r[0], along[0], r[1], along[1]] == pytest.approx(found.as_array(), abs=1e-12)
    assert [r[0], along[0], r[1], along[1]] == pytest.approx(TRUE, abs=1e-12)


def test_two_links_equal_the_listing_where_it_is_right() -> None:
    bends = Bends(np.deg2rad(10), np.deg2rad(10))
    b, c = totals((0.0, 0.2, 0.0, 0.25), bends)
    _, along, _ = python_function(paper_program())(**paper_inputs(PAPER, b, c, bends))
    assert along == pytest.approx(listing_closed_form(b, c, bends, PAPER), abs=1e-12)


def test_the_real_form_is_the_corrected_system_of_the_paper() -> None:
    bends = Bends(0.31, 0.47)
    b, c = totals(TRUE, bends)
    theta = [scalar(f"theta_{v}", "", "rad") for v in "bc"]
    tb, tc = (q.symbols[0] for q in theta)
    system = system_of(planar_chain(2), ((tb, tb), (sp.Integer(0), tc)), theta)
    A, _, a = real_system(system)
    inputs = paper_inputs(PAPER, b, c, bends)
    table = {}
    for q in system.inputs:
        if q.name in inputs:
            table |= dict(zip(q.symbols, np.ravel(inputs[q.name]), strict=True))
    rests = (rest_com(total, PAPER.m_2, PAPER.foot) for total in (b, c))
    ours_A, ours_a = (np.array(m.subs(table).evalf(), float) for m in (A, a))
    assert ours_A == pytest.approx(link_com_matrix(bends, PAPER.m_b, PAPER.m_c), abs=1e-12)
    assert ours_a[:, 0] == pytest.approx(link_com_rhs(bends, *rests, PAPER), abs=1e-12)


def test_the_determinant_for_two_links_is_as_stated() -> None:
    """|det E|^2 = 2 (1 - cos theta_c), whatever theta_b."""
    program = paper_program()
    stated = next(s for s in program.statements if str(s.left) == "|det E|^2")
    for theta_b, theta_c in ((0.2, 0.7), (-1.0, 0.1)):
        inputs = paper_inputs(PAPER, TotalCom(0, 0), TotalCom(0, 0), Bends(theta_b, theta_c))
        det = python_function(program)(**inputs)[2]
        values = {sp.Symbol("theta_c", real=True): theta_c}
        assert det**2 == pytest.approx(float(stated.right.subs(values)), rel=1e-12)


def test_a_third_configuration_checks() -> None:
    theta = scalar("theta", "", "rad")
    bend = theta.symbols[0]
    zero = sp.Integer(0)
    rows = ((zero, zero), (bend, bend), (zero, bend), (bend, zero))
    program = cramer_program(system_of(planar_chain(2), rows, [theta], ["a", "b", "c", "d"]))
    chain = example(2, np.random.default_rng(1))
    angles = np.array([[0, 0], [0.5, 0.5], [0, 0.5], [0.5, 0]])
    inputs = chain.inputs(program, angles, theta=0.5)
    r, along, _, x, z = python_function(program)(**inputs)
    assert along + 1j * r == pytest.approx(chain.w, abs=1e-12)
    assert [*x, *z] == pytest.approx([0] * 4, abs=1e-12)
    inputs["X"] = inputs["X"] + [0, 0.003, 0, 0]
    assert python_function(program)(**inputs)[3] == pytest.approx([-0.003, 0], abs=1e-12)


def test_configurations_of_one_shape_are_refused() -> None:
    theta = scalar("theta", "", "rad")
    bend, zero = theta.symbols[0], sp.Integer(0)
    system = system_of(planar_chain(2), ((zero, zero), (bend, bend)), [theta])
    with pytest.raises(RankError, match="one shape"):
        cramer_program(system)
    with pytest.raises(RankError, match="too few"):
        cramer_program(system.take([0]))


def test_too_many_free_links_are_sent_to_the_closed_form() -> None:
    with pytest.raises(UsageError, match="one-joint"):
        free_program(13)


@pytest.mark.parametrize("n", [1, 2, 4])
def test_the_system_is_the_first_moment_of_the_kinematics(n: int) -> None:
    """E G = K, with G made of masses, levers and CoMs, is the chain laid out joint by joint."""
    chain = planar_chain(n, offsets=True)
    w = [sp.Symbol(f"w_{v}") for v in range(n)]
    system = one_joint_system(chain)
    for angles in system.angles:
        G = [m * x + lever for m, x, lever in zip(chain.m, w, system.levers, strict=True)]
        turned = sum(g * sp.exp(sp.I * phi) for g, phi in zip(G, angles, strict=True))
        total = chain.foot + chain.m_w * chain.ankle + turned
        assert sp.expand(total - first_moment(chain, angles, w)) == 0
