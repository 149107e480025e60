# SPDX-License-Identifier: Apache-2.0
"""The model handed back predicts what was measured, and changes nothing that was not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from comcal.identify.cad_inputs import cad_inputs
from comcal.identify.calibrated_model import CalibratedModel, calibrated_model
from comcal.identify.least_change import least_change
from comcal.identify.model_error import model_error
from comcal.identify.scope import Scope
from comcal.identify.solution import solve_all
from comcal.measure.table import PoseTable
from comcal.robot.model import Robot
from comcal.robot.tree import Array


def moved(robot: Robot, coms: dict[str, Array], masses: dict[str, float] | None = None) -> Robot:
    """The robot with CoMs shifted by *coms* [m] and masses multiplied by *masses*."""
    links = tuple(
        replace(
            link,
            com=link.com + np.asarray(coms.get(link.name, np.zeros(3))),
            mass=link.mass * (masses or {}).get(link.name, 1.0),
        )
        for link in robot.tree.links
    )
    return replace(robot, tree=replace(robot.tree, links=links))


def misbuilt(robot: Robot, rng: np.random.Generator, *, masses: bool) -> Robot:
    big = [link.name for link in robot.tree.links if link.mass > 0.5]
    return moved(
        robot,
        {name: 0.01 * rng.standard_normal(3) for name in big},
        {name: 1.0 + 0.05 * float(rng.standard_normal()) for name in big} if masses else None,
    )


def halves(table: PoseTable) -> tuple[PoseTable, PoseTable]:
    odd = np.arange(len(table.pose)) % 2 == 1
    return table.select(odd), table.select(~odd)


def components(model: CalibratedModel, source: str) -> dict[tuple[str, int], float]:
    """The change of every component of one provenance [m]."""
    return {
        (link.link, i): float(link.com[i] - link.urdf_com[i])
        for link in model.links
        for i in range(3)
        if link.provenance[i] == source
    }


@pytest.mark.parametrize("scale_masses", [False, True])
def test_poses_that_were_not_fitted_are_predicted_exactly(biped14, scale_masses) -> None:
    true = misbuilt(biped14.robot, np.random.default_rng(0), masses=True)
    fitted, other = halves(biped14.measure(true_robot=true))
    model = calibrated_model(biped14.robot, fitted, scale_masses=scale_masses)
    assert model_error(biped14.robot, other).com_rms > 2e-3
    error = model_error(model.robot, other)
    assert error.com_rms < 2e-5
    assert model.masses_written is scale_masses
    assert (error.force_rms < 0.1) is scale_masses


def test_what_no_pose_speaks_about_keeps_every_digit(biped14) -> None:
    true = misbuilt(biped14.robot, np.random.default_rng(1), masses=False)
    table = biped14.measure(true_robot=true)
    model = calibrated_model(biped14.robot, table)
    kept = components(model, "prior")
    assert ("l_sole", 0) in kept
    assert set(kept.values()) == {0.0}
    assert len(components(model, "measured")) >= 15
    assert max(map(abs, components(model, "combination").values())) > 1e-3


def test_measured_components_are_those_of_the_solution(biped14) -> None:
    table = biped14.measure(
        true_robot=misbuilt(biped14.robot, np.random.default_rng(2), masses=False)
    )
    model = calibrated_model(biped14.robot, table)
    assert model.mass_ratio == 1.0
    for link, solved in zip(model.links, model.solution.links, strict=True):
        seen = solved.identifiable
        np.testing.assert_allclose(link.com[seen], solved.com[seen], atol=1e-6)


def test_writing_only_measured_components_can_be_worse_than_the_urdf(biped14) -> None:
    """The reason for the choice: torso y is known only in a sum with the arms, pelvis y alone."""
    robot = biped14.robot
    mass = {link.name: link.mass for link in robot.tree.links}
    shift = 0.01
    pelvis = -shift * mass["torso"] / mass["pelvis"]
    # Together they leave the total CoM of an upright robot where it was.
    true = moved(robot, {"torso": np.array([0, shift, 0]), "pelvis": np.array([0, pelvis, 0])})
    table = biped14.measure(true_robot=true)
    model = calibrated_model(robot, table)
    provenance = {link.link: link.provenance for link in model.links}
    assert provenance["torso"][1] == "combination"
    assert provenance["pelvis"][1] == "measured"
    alone = {
        link.link: np.where(np.array(link.provenance) == "measured", link.com - link.urdf_com, 0.0)
        for link in model.links
    }
    before, partly = model_error(robot, table), model_error(moved(robot, alone), table)
    assert partly.com_rms > 3.0 * before.com_rms
    assert model_error(model.robot, table).com_rms < 1e-6


def test_no_other_model_that_fits_is_nearer_to_the_urdf(biped14) -> None:
    table = biped14.measure(
        true_robot=misbuilt(biped14.robot, np.random.default_rng(3), masses=False)
    )
    fit = solve_all(biped14.robot, table, links_only=True).adjustment
    unknowns = fit.unknowns
    theta, kept = least_change(fit, np.zeros(unknowns.size, dtype=np.bool_))
    assert kept
    np.testing.assert_allclose(theta, fit.theta, atol=1e-9)
    sigma = unknowns.cad_sigma

    def distance(x: Array) -> float:
        return float(np.linalg.norm(((x - unknowns.cad) / sigma)[1:]))

    rng = np.random.default_rng(4)
    for _ in range(20):
        step = unknowns.scale * (fit.unseen @ rng.standard_normal(fit.unseen.shape[1]))
        assert distance(theta + 0.01 * step) > distance(theta)
        assert distance(theta - 0.01 * step) > distance(theta)


def test_a_gain_of_the_sensors_moves_no_com_and_no_mass(biped14) -> None:
    true = misbuilt(biped14.robot, np.random.default_rng(5), masses=False)
    table = biped14.measure(true_robot=true)
    gained = replace(table, wrench={s: 1.03 * w for s, w in table.wrench.items()})
    plain = calibrated_model(biped14.robot, table)
    model = calibrated_model(biped14.robot, gained)
    assert model.mass_ratio == pytest.approx(1.03, rel=1e-3)
    np.testing.assert_array_equal(model.robot.tree.masses, biped14.robot.tree.masses)
    np.testing.assert_allclose(model.robot.tree.coms, plain.robot.tree.coms, atol=2e-5)
    np.testing.assert_allclose(
        model_error(model.robot, gained).distance,
        model_error(plain.robot, table).distance,
        atol=1e-5,
    )


def test_masses_that_were_looked_for_are_written(biped14) -> None:
    true = misbuilt(biped14.robot, np.random.default_rng(6), masses=True)
    fitted, other = halves(biped14.measure(true_robot=true))
    model = calibrated_model(biped14.robot, fitted, Scope(free_masses=True))
    assert model.masses_written
    assert model.robot.tree.total_mass == pytest.approx(true.tree.total_mass, abs=1e-4)
    error = model_error(model.robot, other)
    assert error.com_rms < 1e-5
    assert error.force_rms < 1e-3


def test_stated_sigmas_are_those_of_the_fit(biped14) -> None:
    table = biped14.noisy(biped14.measure(), np.random.default_rng(7))
    model = calibrated_model(biped14.robot, table)
    fit = model.fitted.adjustment
    cov = fit.cov + fit.cov_cad + cad_inputs(fit).cov
    for k in fit.unknowns.links:
        column = fit.unknowns.column(k)
        assert column is not None
        mass = fit.unknowns.robot.tree.masses[k]
        expected = np.sqrt(np.diag(cov)[column : column + 3]) / mass
        is_prior = np.array(model.links[k].provenance) == "prior"
        expected[is_prior] = biped14.robot.tolerances.link_com
        np.testing.assert_allclose(model.links[k].sigma, expected)
