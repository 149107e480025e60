# SPDX-License-Identifier: Apache-2.0
"""The first moments of random spatial chains in closed form and by Cramer's rule.

The oracle is numeric: the rows of the statically equivalent serial chain, which know nothing of
symbols, solved by numpy.
"""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
import sympy as sp

from comcal.errors import RankError, UsageError
from comcal.robot.kinematics import place_links
from comcal.robot.model import Robot
from comcal.robot.tree import Joint, JointType, Link, Tree
from comcal.statics.sesc import sesc_chain, sesc_matrix
from comcal.symbolic.inverse import inverse_by_minors
from comcal.symbolic.nullspace import spatial_program, visible
from comcal.symbolic.program import Program, Steps
from comcal.symbolic.robot_chain import path_between, spatial_chain
from comcal.symbolic.spatial import SpatialChain, chain_from_axes
from comcal.symbolic.spatial_cramer import spatial_cramer_program
from comcal.symbolic.spatial_one_joint import spatial_one_joint_program
from comcal.symbolic.spatial_sigma import spatial_cramer_sigma, spatial_one_joint_sigma
from comcal.symbolic.spatial_system import Shapes
from comcal.symbolic.to_c import to_c
from comcal.symbolic.to_latex import to_latex
from comcal.symbolic.to_python import python_function

Array = npt.NDArray[np.float64]
GCC = shutil.which("gcc")
LATEX = shutil.which("pdflatex")
STRICT = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-DCOMCAL_SELF_TEST")


@dataclass(frozen=True)
class Case:
    """A robot with known CoMs and its symbolic chain."""

    robot: Robot
    chain: SpatialChain
    slides: Array
    rng: np.random.Generator

    def com(self, q: Array) -> Array:
        return place_links(self.robot.tree, q).total_com()

    def poses(self, n: int) -> Array:
        return self.rng.uniform(-1.5, 1.5, (n, len(self.slides)))

    def truth(self) -> Array:
        """The combinations of the true first moments."""
        found, tree = visible(self.chain), self.robot.tree
        true = (tree.coms * tree.masses[:, None]).ravel()
        symbols = [symbol for h in found.h for symbol in h]
        numbers = dict(zip(symbols, true.tolist(), strict=True))
        return np.array([float(c.meaning.xreplace(numbers)) for c in found.combinations])

    def one_at_a_time(self, q: Array) -> Array:
        return np.vstack([np.zeros(len(q)), np.diag(q)])


def case_of(axes: Sequence[Array], slides: tuple[int, ...], rng: np.random.Generator) -> Case:
    """Joints with these axes; CoMs and joints off every line."""
    links, joints = [Link("base", 1.3, rng.normal(size=3) * 0.1, np.eye(3))], []
    for k, axis in enumerate(axes, start=1):
        T = np.eye(4)
        T[:3, 3] = rng.normal(size=3) * 0.3
        kind = JointType.PRISMATIC if k in slides else JointType.REVOLUTE
        unit = axis / np.linalg.norm(axis)
        joints.append(Joint(f"j{k}", kind, links[-1].name, f"link{k}", T, unit))
        links.append(Link(f"link{k}", rng.uniform(1, 3), rng.normal(size=3) * 0.2, np.eye(3)))
    robot = Robot("serial", Tree("serial", tuple(links), tuple(joints)))
    chain = spatial_chain(path_between(robot, "base", links[-1].name))
    return Case(robot, chain, np.isin(np.arange(1, len(axes) + 1), slides), rng)


def case(seed: int, n: int, slides: tuple[int, ...] = ()) -> Case:
    """Oblique axes; every third one along a coordinate."""
    rng = np.random.default_rng(seed)
    oblique, straight = rng.normal(size=(n, 3)), -np.eye(3)[rng.integers(3, size=n)]
    axes = np.where(rng.random((n, 1)) > 0.3, oblique, straight)
    return case_of(list(axes), slides, rng)


CASES = {
    "R": (1, 1, ()),
    "P": (2, 1, (1,)),
    "RR": (3, 2, ()),
    "RP": (4, 2, (2,)),
    "PRR": (5, 3, (1,)),
    "RPR": (6, 3, (2,)),
    "RRRR": (7, 4, ()),
    "PRPR": (9, 4, (1, 3)),
}


@pytest.fixture(params=CASES)
def any_case(request: pytest.FixtureRequest) -> Case:
    return case(*CASES[request.param])


def by_name(program: Program, values: object) -> dict[str, Array]:
    found = values if isinstance(values, tuple) else (values,)
    return {o.name: np.asarray(v) for o, v in zip(program.outputs, found, strict=True)}


def evaluated(program: Program, **inputs: npt.ArrayLike) -> dict[str, Array]:
    needed = {q.name: inputs[q.name] for q in program.inputs}
    return by_name(program, python_function(program)(**needed))


def predicted_by_rows(case: Case, s: Array, q: Array) -> Array:
    """The total CoM that the combinations predict, shape (N, 3)."""
    rows, rhs = python_function(spatial_program(case.chain))(q=q, com=np.zeros((len(q), 3)))
    rows = np.broadcast_to(rows, (len(q), rows.shape[-1])).reshape(len(q), 3, -1)
    return (rows @ s - rhs) / case.robot.tree.total_mass


def predicted_by_least_squares(case: Case, q: Array) -> Array:
    """The total CoM that the equivalent serial chain predicts after a fit to 40 other poses."""
    chain, seen = sesc_chain(case.robot.tree), case.poses(40)
    B = sesc_matrix(chain, seen).reshape(120, -1)
    R = np.linalg.lstsq(B, case.com(seen).ravel(), rcond=None)[0]
    return sesc_matrix(chain, q) @ R


def test_one_joint_at_a_time_agrees_with_least_squares(any_case: Case) -> None:
    program = spatial_one_joint_program(any_case.chain)
    q = any_case.rng.uniform(0.3, 2.5, len(any_case.slides))
    found = evaluated(program, com=any_case.com(any_case.one_at_a_time(q)), q=q)
    assert found["s"] == pytest.approx(any_case.truth(), abs=1e-9)
    assert found["misfit"] == pytest.approx(0, abs=1e-12)
    turns = q[~any_case.slides]
    assert found["determinant"] == pytest.approx(np.prod(4 * np.sin(turns / 2) ** 2))
    others = any_case.poses(6)
    ours = predicted_by_rows(any_case, found["s"], others)
    assert ours == pytest.approx(predicted_by_least_squares(any_case, others), abs=1e-9)


def test_free_configurations_agree_with_least_squares(any_case: Case) -> None:
    program = spatial_cramer_program(any_case.chain)
    q = any_case.poses(1 + int(np.sum(~any_case.slides)))
    com = any_case.com(q)
    found = evaluated(program, com=com, q=q)
    width = len(found["s"])
    # The same configurations, all of their equations, by numpy.
    rows, rhs = python_function(spatial_program(any_case.chain))(q=q, com=com)
    solved = np.linalg.lstsq(rows.reshape(-1, width), rhs.ravel(), rcond=None)[0]
    assert found["s"] == pytest.approx(solved, abs=1e-9)
    if "misfit" in found:
        assert found["misfit"] == pytest.approx(0, abs=1e-9)
    others = any_case.poses(6)
    ours = predicted_by_rows(any_case, found["s"], others)
    assert ours == pytest.approx(predicted_by_least_squares(any_case, others), abs=1e-9)


def test_cramer_s_rule_has_the_closed_form_as_its_special_case() -> None:
    robot = case(10, 4)
    q = robot.rng.uniform(0.5, 2, 4)
    shapes = robot.one_at_a_time(q)
    com = robot.com(shapes) + robot.rng.normal(size=(5, 3)) * 0.01
    closed = evaluated(spatial_one_joint_program(robot.chain), com=com, q=q)
    program = spatial_cramer_program(robot.chain)
    assert len(program.steps) < 1100
    free = evaluated(program, com=com, q=shapes)
    for name in ("s", "c", "misfit", "determinant"):
        assert free[name] == pytest.approx(closed[name], rel=1e-9, abs=1e-12)


def test_components_without_a_partner_are_those_of_the_com() -> None:
    """The last link across its axis; each of two links whose axes are parallel."""
    axes = np.array([[0.0, 0, 1], [0, 1, 0], [0, -1, 0]])
    robot = case_of(list(axes), (), np.random.default_rng(16))
    program = spatial_one_joint_program(robot.chain)
    labels = next(o.labels for o in program.outputs if o.name == "c")
    assert labels == ("c_0_1", "c_0_2", "c_1_1", "c_2_1", "c_2_2", "c_3_1", "c_3_2")
    q = np.array([0.4, 0.6, 0.8])
    found = evaluated(program, com=robot.com(robot.one_at_a_time(q)), q=q)
    c = robot.robot.tree.coms
    expected = [c[0, 0], c[0, 1], c[1, 0], c[2, 2], c[2, 0], c[3, 0], c[3, 2]]
    assert found["c"] == pytest.approx(expected, abs=1e-12)


def test_misfit_shows_what_the_solution_does_not_use() -> None:
    robot = case(8, 4, (2,))
    q = np.array([0.7, 0.2, 0.9, 1.1])
    com = robot.com(robot.one_at_a_time(q))
    axes = [np.array(joint.axis.tolist(), float).ravel() for joint in robot.chain.joints]
    program = spatial_one_joint_program(robot.chain)
    before = evaluated(program, com=com, q=q)
    for v, axis in enumerate(axes, start=1):
        moved = com.copy()
        moved[v] += 0.003 * axis
        after = evaluated(program, com=moved, q=q)
        assert after["s"] == pytest.approx(before["s"], abs=1e-12)
        assert after["misfit"] == pytest.approx(-0.003 * (np.arange(4) == v - 1), abs=1e-12)


def test_the_configuration_of_a_slide_may_be_left_out() -> None:
    robot = case(8, 4, (2,))
    q = np.array([0.7, np.nan, 0.9, 1.1])
    com = robot.com(robot.one_at_a_time(np.nan_to_num(q)))
    com[2] = np.nan
    found = evaluated(spatial_one_joint_program(robot.chain), com=com, q=q)
    assert found["s"] == pytest.approx(robot.truth(), abs=1e-9)
    assert np.isnan(found["misfit"]).tolist() == [False, True, False, False]


def test_the_closed_form_has_no_limit_and_grows_with_the_joints_only() -> None:
    robot = case(11, 8)
    program = spatial_one_joint_program(robot.chain)
    q = robot.rng.uniform(0.5, 2, 8)
    found = evaluated(program, com=robot.com(robot.one_at_a_time(q)), q=q)
    assert found["s"] == pytest.approx(robot.truth(), abs=1e-9)
    assert len(program.steps) < 12 * 8


def test_free_configurations_are_for_four_joints() -> None:
    with pytest.raises(UsageError, match=r"5 joints.*one-joint"):
        spatial_cramer_program(case(7, 5).chain)


def test_a_joint_that_stands_still_is_singular() -> None:
    robot = case(12, 3)
    program = spatial_cramer_program(robot.chain)
    for k in range(3):
        q = robot.poses(4)
        q[:, k] = 0.4
        with np.errstate(all="ignore"):
            found = evaluated(program, com=robot.com(q), q=q)
        assert found["determinant"] == pytest.approx(0, abs=1e-14)


def test_shapes_that_differ_in_slides_only_are_one_shape() -> None:
    robot = case(13, 3, (2,))
    program = spatial_cramer_program(robot.chain)
    q = robot.poses(3)
    assert abs(evaluated(program, com=robot.com(q), q=q)["determinant"]) > 1e-3
    for a, b in ((0, 1), (1, 2)):
        same = q.copy()
        same[b, [0, 2]] = q[a, [0, 2]]
        with np.errstate(all="ignore"):
            found = evaluated(program, com=robot.com(same), q=same)
        assert found["determinant"] == pytest.approx(0, abs=1e-14)


SIGMAS: list[tuple[Callable[[SpatialChain], Program], Callable[[SpatialChain], Program]]] = [
    (spatial_one_joint_program, spatial_one_joint_sigma),
    (spatial_cramer_program, spatial_cramer_sigma),
]


@pytest.mark.parametrize(("solve", "sigma"), SIGMAS, ids=["one-joint", "free"])
@pytest.mark.parametrize("name", ["P", "RR", "PRPR"])
def test_sigmas_are_those_of_the_solution_moved_a_little(
    name: str,
    solve: Callable[[SpatialChain], Program],
    sigma: Callable[[SpatialChain], Program],
) -> None:
    robot = case(*CASES[name])
    program, uncertain = solve(robot.chain), sigma(robot.chain)
    shape = next(x.shape for x in program.inputs if x.name == "com")
    q_shape = next((x.shape for x in program.inputs if x.name == "q"), (1,))
    q = robot.rng.uniform(0.5, 1.5, q_shape)
    noise = robot.rng.uniform(0.001, 0.003, shape)
    # Linear in the CoM: unit steps from zero are the derivatives, without error.
    moves = np.eye(noise.size).reshape(-1, *shape)
    many = np.broadcast_to(q, (noise.size, *q_shape))
    there = evaluated(program, com=moves, q=many)
    zero = evaluated(program, com=np.zeros(shape), q=q)
    found = evaluated(uncertain, sigma_com=noise, q=q)
    for which in [o.name for o in program.outputs if o.name in "sc"]:
        jacobian = there[which] - zero[which]
        expected = np.sqrt(noise.ravel() ** 2 @ jacobian**2)
        assert found[f"sigma_{which}"] == pytest.approx(expected, rel=1e-9)


def shapes_of(rows: Sequence[Sequence[object]]) -> Shapes:
    names = tuple("abcdefgh"[: len(rows)])
    positions = tuple(tuple(sp.sympify(x) for x in row) for row in rows)
    return Shapes(names, positions, ())


def test_given_configurations_solve_with_independent_equations_and_check_with_the_rest() -> None:
    """Three shapes for two joints are 6 equations for 4 unknowns, in any order of bends."""
    robot = case(14, 2)
    q = [[0.3, 0.2], [0.3, 1.1], [1.2, 0.2], [0.9, -0.7]]
    program = spatial_cramer_program(robot.chain, shapes_of(q))
    com = robot.com(np.array(q))
    found = evaluated(program, com=com)
    assert found["s"] == pytest.approx(robot.truth(), abs=1e-9)
    assert found["misfit"] == pytest.approx(0, abs=1e-9)
    assert len(found["misfit"]) == 9 - 4
    noisy = evaluated(program, com=com + robot.rng.normal(size=com.shape) * 1e-3)
    assert np.abs(noisy["misfit"]).max() > 1e-4


def test_three_joints_need_three_shapes_only() -> None:
    robot = case(5, 3)
    q = robot.poses(3)
    program = spatial_cramer_program(robot.chain, shapes_of(q.tolist()))
    found = evaluated(program, com=robot.com(q))
    assert found["s"] == pytest.approx(robot.truth(), abs=1e-9)
    assert "misfit" not in found


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        ([[0, 0]], "0 equations for 4 unknowns"),
        ([[0, 0], [1, 0], [2, 0]], "turn j2, which stands still"),
        ([[0, 0], [1, 1], [0, 0]], r"rank \d for 4 unknowns.*joint alone is turned"),
    ],
)
def test_configurations_that_do_not_suffice_are_refused(rows: list[list[int]], words: str) -> None:
    with pytest.raises(RankError, match=words):
        spatial_cramer_program(case(15, 2).chain, shapes_of(rows))


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5])
def test_inverse_by_minors_is_the_inverse(n: int) -> None:
    rng = np.random.default_rng(n)
    numbers = rng.normal(size=(n, n)) * (rng.random((n, n)) > 0.2) + np.eye(n)
    rows = [[sp.Float(x) if x else sp.Integer(0) for x in row] for row in numbers.tolist()]
    found = inverse_by_minors(rows, [f"c{v}" for v in range(n)], Steps())
    assert found is not None
    inverse, det = found
    assert np.array(inverse, float) == pytest.approx(np.linalg.inv(numbers), rel=1e-9, abs=1e-12)
    assert float(det) == pytest.approx(np.linalg.det(numbers))


def test_a_matrix_of_dependent_rows_has_no_inverse() -> None:
    x = sp.Symbol("x")
    assert inverse_by_minors([[x, 0], [x, 0]], ["a", "b"], Steps()) is None


MADE: dict[str, Callable[[], Program]] = {
    "one-joint": lambda: spatial_one_joint_program(case(8, 4, (2,)).chain),
    "free": lambda: spatial_cramer_program(case(7, 4).chain),
    "numbers": lambda: spatial_cramer_program(
        case(14, 2).chain, shapes_of([[0, 0], [sp.pi / 2, 0.3], [0.4, sp.pi / 3]])
    ),
    "masses as symbols": lambda: spatial_one_joint_program(
        chain_from_axes([[0, 0, 1], [0, 1, 0]], [[0.1, 0.2, 0.3]] * 2)
    ),
    "sigma, one-joint": lambda: spatial_one_joint_sigma(case(8, 4, (2,)).chain),
    "sigma, free": lambda: spatial_cramer_sigma(case(3, 3).chain),
}


@pytest.mark.parametrize("name", MADE)
def test_generated_c_agrees_with_generated_python(name: str, tmp_path: Path) -> None:
    if GCC is None:
        pytest.skip("NO gcc HERE: THE GENERATED C WAS NOT COMPILED")
    source, made = tmp_path / "made.c", tmp_path / "made"
    source.write_text(to_c(MADE[name]()))
    command = [GCC, *STRICT, str(source), "-o", str(made), "-lm"]
    run = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert run.returncode == 0, run.stderr
    run = subprocess.run([made], capture_output=True, text=True, timeout=20)
    assert (run.returncode, run.stdout.split(": ")[-1]) == (0, "ok\n")


@pytest.mark.parametrize("name", ["one-joint", "sigma, one-joint", "sigma, free"])
def test_latex_of_oblique_axes_fits_the_page(name: str, tmp_path: Path) -> None:
    if LATEX is None:
        pytest.skip("no pdflatex here: the generated LaTeX was not compiled")
    (tmp_path / "made.tex").write_text(to_latex(MADE[name]()))
    command = [LATEX, "-interaction=nonstopmode", "-halt-on-error", "made.tex"]
    run = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert run.returncode == 0, run.stdout[-2000:]
    assert "Overfull" not in run.stdout
