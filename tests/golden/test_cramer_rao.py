# SPDX-License-Identifier: Apache-2.0
"""The solver claims what the data allow: its covariance is the Cramer-Rao bound of the oracle.

Covers: masses, link CoMs and total CoMs of both generated robots on level floor. Not covered: how
the bound compares with errors actually made; that is what ``comcal study`` is for.
"""

from __future__ import annotations

import importlib
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from ruamel.yaml import YAML

from comcal.identify.adjust import Adjustment, adjust
from comcal.identify.groups import groups_of
from comcal.identify.unknowns import unknowns_of
from comcal.measure.plan_csv import read_plan
from comcal.measure.source import SourceRequest
from comcal.measure.tabulate import tabulate
from comcal.robot.description import load_robot
from comcal.workflow.sources import open_source
from comcal.workflow.study_file import NoiseSection
from comcal.workflow.study_robot import still_window, told_noise
from comcal_sims.builtin_world import static_state
from comcal_sims.robots import biped14, table1

HERE = Path(__file__).resolve().parent.parent
ROBOTS = {"table1": table1.generate, "biped14": biped14.generate}


@dataclass
class Case:
    """A generated robot, as the oracle reads it and as the solver fits its exact data."""

    machine: Any
    poses: list[Any]
    first: dict[int, np.ndarray]
    fit: Adjustment
    folder: Path


@pytest.fixture(scope="module")
def oracle() -> Iterator[ModuleType]:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(HERE / "oracles"))
        yield importlib.import_module("cramer_rao")


@pytest.fixture(scope="module")
def model(oracle: ModuleType) -> ModuleType:
    return importlib.import_module("forward_model")


@pytest.fixture(scope="module", params=list(ROBOTS))
def case(
    request: pytest.FixtureRequest, oracle: ModuleType, tmp_path_factory: pytest.TempPathFactory
) -> Case:
    folder = tmp_path_factory.mktemp("robots") / request.param
    robot = told_noise(load_robot(ROBOTS[request.param](folder)), NoiseSection(name="realistic"))
    plan = [
        p for p in read_plan(folder / "plan.csv", robot.tree.joint_names) if p.support != "none"
    ]
    windows = []
    with open_source("builtin", SourceRequest(robot=robot, seed=0, noise=False)) as source:
        for pose in plan:
            source.move_to(pose)
            windows.append(still_window(source, 2))
    table = tabulate(robot, plan, windows, "exact")
    machine = oracle.read_machine(folder)
    return Case(
        machine,
        oracle.read_plan(folder, machine),
        oracle.load_sharing(folder),
        adjust(robot, unknowns_of(robot), groups_of(robot, table)),
        folder,
    )


def test_forward_model_of_the_oracle_predicts_the_simulated_world(
    case: Case, model: ModuleType
) -> None:
    robot = load_robot(case.folder / "robot.yaml")
    plan = {p.pose: p for p in read_plan(case.folder / "plan.csv", robot.tree.joint_names)}
    shared = model.Globals(case.machine).truth[None].astype(complex)
    for pose in case.poses:
        local = np.concatenate([pose.q, np.zeros(2 + 6 * (len(pose.feet) - 1))])
        first = case.first.get(pose.pose, np.zeros(6))
        predicted = model.predict(case.machine, pose, first, local[None].astype(complex), shared)
        wrenches = static_state(robot, plan[pose.pose]).wrenches
        true = np.concatenate([pose.q, *(wrenches[robot.feet[f].sensor] for f in pose.feet)])
        np.testing.assert_allclose(predicted[0].real, true, rtol=0, atol=1e-9)


def test_kinematics_of_the_oracle_are_those_of_pinocchio(case: Case, model: ModuleType) -> None:
    pin = pytest.importorskip("pinocchio")
    urdf = str(next(case.folder.glob("*.urdf")))
    robot = pin.buildModelFromUrdf(urdf, pin.JointModelFreeFlyer())  # else the root has no mass
    data = robot.createData()
    shared = model.Globals(case.machine)
    for pose in case.poses[::5]:
        q = pin.neutral(robot)
        for name, angle in zip(case.machine.joint_names, pose.q, strict=True):
            q[robot.joints[robot.getJointId(name)].idx_q] = angle
        frames = model.place(case.machine, pose.q[None].astype(complex))
        mass, moment = shared.masses_and_moments(shared.truth[None].astype(complex), frames, set())
        com = pin.centerOfMass(robot, data, q)
        np.testing.assert_allclose((moment / mass)[0].real, com, rtol=0, atol=1e-12)


def test_covariance_of_the_fit_is_the_bound(case: Case, oracle: ModuleType) -> None:
    bound = oracle.bound(
        case.machine, case.poses, case.first, oracle.NoiseOfMeans(), {}, cad_is_exact=True
    )
    fit = case.fit
    order = [0, *(bound.names.index(f"h {name}") for name in fit.unknowns.names[1:])]
    scaled = bound.noise_cov[np.ix_(order, order)] / np.outer(
        fit.unknowns.scale, fit.unknowns.scale
    )
    assert (bound.seen, bound.unseen) == (fit.rank, fit.unseen.shape[1])
    # In the solver's own directions, each in units of its own sigma, the bound is the identity.
    to_sigmas = fit.seen * fit.singular
    np.testing.assert_allclose(
        to_sigmas.T @ scaled @ to_sigmas, np.eye(fit.rank), rtol=0, atol=1e-6
    )
    assert np.abs(fit.unseen.T @ scaled @ fit.unseen).max() < 1e-6 * np.linalg.norm(scaled)


def test_a_pose_less_never_lowers_the_bound(case: Case, oracle: ModuleType) -> None:
    noise, poses = oracle.NoiseOfMeans(), case.poses[::2]
    all_poses = oracle.bound(case.machine, poses, case.first, noise, {})
    fewer = oracle.bound(case.machine, poses[:-1], case.first, noise, {})
    assert fewer.seen == all_poses.seen
    for name, sigma in all_poses.sigma.items():
        assert fewer.sigma[name] >= sigma * (1 - 1e-9)


def test_bounds_beside_the_studies_are_those_of_the_oracle(case: Case, oracle: ModuleType) -> None:
    text = _study("full")
    stored = json.loads((HERE / "studies" / text["crb"]).read_text("utf-8"))["bounds"]
    (entry,) = (e for e in text["robots"] if e["name"] == case.machine.name)
    (old,) = (b for b in stored if b["robot"] == case.machine.name)
    by_id = {pose.pose: pose for pose in case.poses}
    com_poses = {name: by_id[i] for name, i in entry["quantities"]["total_com"].items()}
    noise = oracle.NoiseOfMeans(**old["noise"])
    new = oracle.bound(case.machine, case.poses, case.first, noise, com_poses)
    assert old["sigma"].keys() == new.sigma.keys()
    for name, sigma in new.sigma.items():
        assert old["sigma"][name] == pytest.approx(sigma, rel=1e-5), name


def test_sample_is_the_beginning_of_the_full_study() -> None:
    sample, full = _study("sample"), _study("full")
    for key in ("robots", "noise", "crb"):
        assert sample[key] == full[key]
    assert sample["seeds"]["master"] == full["seeds"]["master"][:1]
    assert sample["seeds"]["count"] <= full["seeds"]["count"]
    assert "limits" not in full  # the defaults are what is asked of the project


def _study(name: str) -> dict[str, Any]:
    return YAML(typ="safe").load((HERE / "studies" / f"{name}.yaml").read_text("utf-8"))
