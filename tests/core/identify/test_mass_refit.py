# SPDX-License-Identifier: Apache-2.0
"""Refitted masses are right where the poses determine them, and withheld where they do not.

The robot is simulated here in closed form: weights times positions of the true link CoMs. Not
covered: robots with sliding joints.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from comcal.errors import RankError
from comcal.identify.adjust import adjust
from comcal.identify.groups import groups_of
from comcal.identify.hung_moments import determined_sums
from comcal.identify.mass_fit import fit_masses, with_masses
from comcal.identify.mass_refit import MassRefit, refit_masses
from comcal.identify.unknowns import unknowns_of
from comcal.measure.table import PoseTable
from comcal.report.masses import masses_lines
from comcal.robot.description import load_robot
from comcal.robot.frames import rotation_about
from comcal.robot.kinematics import place_links
from comcal.robot.model import Robot

Array = npt.NDArray[np.float64]
MASSES = (2.0, 8.0, 12.0)
FT_FORCE, FT_MOMENT, ENCODER = 0.2, 0.02, 2e-4

LINK = (
    '<link name="{0}"><inertial><origin xyz="{2}"/><mass value="{1}"/><inertia ixx="0.1" '
    'iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
)
JOINT = (
    '<joint name="{0}" type="{1}"><parent link="{2}"/><child link="{3}"/><origin xyz="{4}"/>'
    '<axis xyz="{5}"/><limit lower="-2" upper="2" effort="100" velocity="1"/></joint>'
)
URDF = (
    '<robot name="bent">'
    + LINK.format("foot", MASSES[0], "0.04 0.01 0.03")
    + LINK.format("shin", MASSES[1], "0.02 -0.01 0.25")
    + LINK.format("trunk", MASSES[2], "-0.01 0.02 0.3")
    + JOINT.format("ankle", "revolute", "foot", "shin", "-0.05 0 0.08", "0 1 0")
    + JOINT.format("hip", "revolute", "shin", "trunk", "0 0.03 0.5", "0.8 0.6 0")
    + "</robot>"
)
YAML = f"""\
format: comcal-robot/1
name: bent
urdf: bent.urdf
feet:
  one: {{link: foot, sole: [[1, 1], [-1, 1], [-1, -1], [1, -1]]}}
plates:
  plate: {{frame: foot, feet: [one]}}
noise: {{ft_force: {FT_FORCE}, ft_moment: {FT_MOMENT}, encoder: {ENCODER}}}
tolerances: {{link_com: 0}}
"""


@pytest.fixture
def robot(tmp_path: Path) -> Robot:
    (tmp_path / "bent.urdf").write_text(URDF)
    (tmp_path / "robot.yaml").write_text(YAML)
    return load_robot(tmp_path / "robot.yaml")


def measure(
    truth: Robot,
    q: Array,
    rng: np.random.Generator | None = None,
    floor: Sequence[float] = (0.0, 0.0),
    noisier: float = 1.0,
) -> PoseTable:
    """Measure *truth* in poses *q* on a floor of some pitch and roll, with noise if *rng*.

    *noisier* is the factor of the wrench's noise over what the table says of it.
    """
    n = len(q)
    up = rotation_about([1, 0, 0], -floor[1]) @ rotation_about([0, 1, 0], -floor[0]) @ [0, 0, 1]
    force = truth.gravity * truth.tree.masses[:, None] * up
    moment = np.cross(place_links(truth.tree, q).coms, force).sum(axis=1)
    w = np.hstack([np.tile(force.sum(axis=0), (n, 1)), moment])
    sigma = np.repeat([FT_FORCE, FT_MOMENT], 3)
    read = q
    if rng is not None:
        w = w + noisier * sigma * rng.normal(size=w.shape)
        read = q + ENCODER * rng.normal(size=q.shape)
    nan = np.full(q.shape, np.nan)
    return PoseTable(
        pose=tuple(range(n)),
        support=("one",) * n,
        q=read,
        q_cov=np.full(q.shape, ENCODER**2),
        wrench={"plate": w},
        wrench_cov={"plate": np.tile(np.diag(sigma**2), (n, 1, 1))},
        torque=nan,
        torque_var=nan,
        current=nan,
        current_var=nan,
        com=np.full((n, 3), np.nan),
        com_var=np.full((n, 3), np.nan),
        imu=np.full((n, 3), np.nan),
        configuration=("",) * n,
        tilt=np.full(n, np.nan),
    )


def bent(rng: np.random.Generator, n: int = 40, reach: float = 0.9) -> Array:
    return rng.uniform(-reach, reach, (n, 2))


def heavier(robot: Robot, *factors: float) -> Robot:
    """Return the robot with true masses = factor * URDF."""
    return with_masses(robot, range(3), np.array(MASSES) * factors)


def displaced(robot: Robot, shifts: Array) -> Robot:
    """Return the robot with true CoMs = URDF + shifts."""
    links = tuple(
        replace(link, com=link.com + shift)
        for link, shift in zip(robot.tree.links, shifts, strict=True)
    )
    return replace(robot, tree=replace(robot.tree, links=links))


def objections(refit: MassRefit, link: str) -> str:
    return "; ".join(o.words for o in refit.objections if o.link == link)


def test_exact_data_give_the_true_masses(robot: Robot) -> None:
    truth = heavier(robot, 0.8, 1.3, 0.9)
    table = measure(truth, bent(np.random.default_rng(1)), floor=(0.1, -0.05))
    fit = fit_masses(robot, groups_of(robot, table))

    np.testing.assert_allclose(fit.masses, truth.tree.masses, rtol=1e-9)
    assert fit.rank == 3
    assert fit.dof == 4 * 40 - 3


def test_well_determined_masses_are_reported(robot: Robot) -> None:
    rng = np.random.default_rng(2)
    truth = heavier(robot, 0.9, 1.2, 0.95)
    refit = refit_masses(robot, measure(truth, bent(rng), rng))

    assert refit.objections == ()
    assert refit.masses is not None
    assert refit.cov is not None
    sigma = np.sqrt(np.diag(refit.cov))
    assert (np.abs(refit.masses - truth.tree.masses) < 4.0 * sigma).all()
    assert (sigma < 0.15).all()
    text = "\n".join(masses_lines(refit))
    for mass in refit.masses:
        assert f"{mass:.3f} +/- " in text
    assert "condition" in text
    assert "REFUSED" not in text


@pytest.mark.parametrize("tolerance", [0.0, 0.005])
def test_errors_are_as_large_as_their_covariance_says(robot: Robot, tolerance: float) -> None:
    """From noise alone, and with CoMs off by the tolerance that robot.yaml states."""
    rng = np.random.default_rng(3)
    robot = replace(robot, tolerances=replace(robot.tolerances, link_com=tolerance))
    squared: list[float] = []
    for _ in range(80):
        truth = displaced(heavier(robot, 0.9, 1.2, 0.95), tolerance * rng.normal(size=(3, 3)))
        table = measure(truth, bent(rng, 20), rng)
        fit = fit_masses(robot, groups_of(robot, table))
        error = fit.masses - truth.tree.masses
        squared.append(float(error @ np.linalg.solve(fit.cov + fit.cov_cad, error)) / 3.0)
    # 240 degrees of freedom: one sigma of the mean is 0.09.
    assert 0.7 < np.mean(squared) < 1.3


def test_misfit_of_a_right_model_is_chi_square(robot: Robot) -> None:
    rng = np.random.default_rng(4)
    fits = [
        fit_masses(robot, groups_of(robot, measure(robot, bent(rng, 20), rng))) for _ in range(20)
    ]
    assert np.mean([fit.chi2 / fit.dof for fit in fits]) == pytest.approx(1.0, abs=0.1)


def test_poses_that_hardly_move_are_refused(robot: Robot) -> None:
    rng = np.random.default_rng(5)
    q = bent(rng, reach=0.9) * [0.02, 1.0]
    robot = replace(robot, tolerances=replace(robot.tolerances, link_com=0.02))
    refit = refit_masses(robot, measure(robot, q, rng))

    assert refit.is_refused
    assert refit.masses is None
    assert refit.cov is None
    assert "95 % interval" in objections(refit, "shin")
    text = "\n".join(masses_lines(refit))
    assert "REFUSED" in text
    assert "why: ankle moves only 2 deg; condition" in text
    assert not [line for line in text.splitlines() if "URDF 8.000" in line]


def test_links_whose_coms_share_a_plumb_line_are_not_told_apart(robot: Robot) -> None:
    """What the noise of the force's direction feigns does not count as rank."""
    rng = np.random.default_rng(6)
    robot = displaced(robot, np.array([[0, 0, 0], [0, 0, 0], [0.03, -0.06, 0]]))
    refit = refit_masses(robot, measure(robot, np.zeros((20, 2)), rng))

    assert refit.is_refused
    assert refit.rank == 2
    assert "2 combinations of the 3 masses" in objections(refit, "")
    assert "rank 2 of 3" in "\n".join(masses_lines(refit))


@pytest.mark.parametrize(
    ("share", "words"),
    [
        (-0.5, "negative mass"),
        (0.05, "less than 10 % of the URDF's mass"),
        (4.0, "more than 300 % of the URDF's mass"),
    ],
)
def test_absurd_masses_are_named_and_not_told(robot: Robot, share: float, words: str) -> None:
    """However well the data want them."""
    rng = np.random.default_rng(7)
    truth = heavier(robot, 1.0, share, 1.0)
    refit = refit_masses(robot, measure(truth, bent(rng), rng))

    assert refit.is_refused
    assert words in objections(refit, "shin")
    assert not objections(refit, "trunk")
    text = "\n".join(masses_lines(refit))
    assert "shin: the fit wants" in text
    assert "not reported" in text
    assert f"{8.0 * share:.1f}" not in text


@pytest.mark.parametrize("share", [0.15, 2.9])
def test_unusual_masses_inside_the_bounds_are_reported(robot: Robot, share: float) -> None:
    rng = np.random.default_rng(8)
    truth = heavier(robot, 1.0, share, 1.0)
    assert refit_masses(robot, measure(truth, bent(rng), rng)).objections == ()


def test_misfit_beyond_the_noise_is_refused(robot: Robot) -> None:
    rng = np.random.default_rng(9)
    refit = refit_masses(robot, measure(robot, bent(rng), rng, noisier=3.0))

    assert refit.misfit_p < 1e-4
    assert "no sigma can be trusted" in objections(refit, "")
    assert refit.masses is None
    assert "these sigmas are too small" in "\n".join(masses_lines(refit))


def test_determined_sums_do_not_depend_on_the_split_of_the_mass(robot: Robot) -> None:
    """A URDF with masses that are far off gives the same numbers."""
    rng = np.random.default_rng(10)
    table = measure(robot, bent(rng))
    wrong = with_masses(robot, range(3), np.array([4.0, 5.0, 13.0]))
    h = np.array([2.0, 8.0, 12.0])[:, None] * robot.tree.coms
    h += np.array([[-0.05, 0, 0.08], [0, 0.03, 0.5], [0, 0, 0]]) * [[20.0], [12.0], [0.0]]
    true = dict(zip(unknowns_of(robot).names, [22.0, *h.ravel()], strict=True))

    for nominal in (robot, wrong):
        fit = adjust(nominal, unknowns_of(nominal), groups_of(nominal, table))
        sums = determined_sums(fit)
        assert len(sums) == 1 + 3 + 2 * 2 - 1  # level ground: one less than 1 + 3 + 2 n
        for c in sums:
            expected = sum(factor * true[name] for name, factor in c.coefficients.items())
            assert c.value == pytest.approx(expected, abs=1e-6)
    assert "shin z" in {c.words for c in sums}


def test_session_without_a_standing_pose_is_an_error(robot: Robot) -> None:
    table = measure(robot, bent(np.random.default_rng(11), 4))
    with pytest.raises(RankError, match="stands"):
        refit_masses(robot, replace(table, support=("none",) * 4))
