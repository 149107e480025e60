# SPDX-License-Identifier: Apache-2.0
"""The parts of ``tests/studies/humanoids.py``: truth, oracle, and a verdict that can fail."""

import importlib
import sys
from importlib.util import find_spec
from types import SimpleNamespace

import numpy as np
import pytest

from comcal.identify.adjust import adjust
from comcal.identify.scope import Scope, scoped
from comcal.identify.unknowns import unknowns_of
from comcal.plan.candidates import random_pool
from comcal.plan.rules import rules_of
from comcal.robot.description import load_robot


@pytest.fixture(scope="module")
def study(root):
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(root / "tests" / "studies"))
        patch.syspath_prepend(str(root / "tests" / "oracles"))
        patch.setenv("OMP_NUM_THREADS", "1")  # the script would set it for good
        names = ("humanoid_engine", "humanoid_trials", "humanoid_table", "free_mass_bound")
        modules = {name: importlib.import_module(name) for name in names}
        file = root / "tests" / "studies" / "humanoids.py"
        spec = importlib.util.spec_from_file_location("humanoid_study", file)
        script = importlib.util.module_from_spec(spec)
        patch.setitem(sys.modules, spec.name, script)
        spec.loader.exec_module(script)
        yield SimpleNamespace(script=script, **modules)


@pytest.fixture(scope="module")
def stood(study, tmp_path_factory):
    """A perturbed g1, the nominal one's unknowns, and what the engine says of nine poses."""
    if find_spec("mujoco") is None:
        pytest.skip("mujoco is not installed")
    try:
        robot = load_robot(study.script.write_humanoid("g1", tmp_path_factory.mktemp("g1")))
    except LookupError as absent:
        pytest.skip(str(absent))
    rng = np.random.default_rng(5)
    poses = random_pool(rules_of(robot, ("double", "left", "right"), margin=0.015), 3, rng)
    unknowns = unknowns_of(robot, free_masses=True)
    true = study.humanoid_engine.perturbed(unknowns, rng)
    return unknowns, true, study.humanoid_engine.stand(true, poses)


@pytest.mark.engine
def test_a_perturbed_humanoid_stands_in_the_engine_as_three_statics_say(study, stood):
    engine, oracle = study.humanoid_engine, study.free_mass_bound
    unknowns, true, found = stood
    assert max(engine.off_statics(true, found)) < 1e-3
    assert max(engine.off_builtin(true, found)) < 1e-3
    theta = engine.true_theta(unknowns, true)
    assert np.abs(theta[:5] / unknowns.cad[:5] - 1.0).max() > 0.05
    bones = oracle.skeleton_of(unknowns.robot, unknowns.links)
    for i, pose in enumerate(study.humanoid_trials.bound_poses(unknowns.robot, found)):
        n_local = len(pose.q) + 2 + 6 * (len(pose.loaded) - 1)
        x = np.concatenate([np.zeros(n_local), theta])[None].astype(complex)
        predicted = oracle.measured(bones, pose, x, n_local)[0].real
        seen = np.concatenate([found.q[i], found.wrench[i].ravel(), found.torque[i]])
        assert np.abs(predicted - seen).max() < 1e-3


@pytest.mark.engine
@pytest.mark.parametrize("torques", [False, True])
def test_the_claimed_covariance_is_the_oracles_bound(study, stood, torques):
    trials = study.humanoid_trials
    unknowns, _, found = stood
    exact = study.humanoid_engine.table_of(unknowns.robot, found, trials.NOISE)
    scope = Scope(free_masses=True, torques=torques)
    fit = adjust(unknowns.robot, *scoped(unknowns.robot, exact, scope))
    _, L = trials.base_parameters(fit)
    F = trials.information_of(unknowns, found, fit.theta, trials.NOISE[3] if torques else None)
    claimed = np.sqrt(np.einsum("ij,jk,ik->i", L, fit.cov, L))
    assert np.allclose(claimed, trials.bounds_of(fit, F, L), rtol=1e-3)


def _calibrations(study, scale):
    rng = np.random.default_rng(3)
    error = scale * rng.standard_normal((400, 5))
    return study.humanoid_trials.Calibrations(
        tuple("abcde"),
        error,
        np.ones_like(error),
        np.full(400, 5),
        np.full(400, 7.0),
        np.full(400, 7),
        np.full((400, 3), 1e-3),
    )


@pytest.mark.parametrize(("scale", "missed"), [(1.0, 0), (1.3, 3), (0.8, 3)])
def test_errors_of_another_size_than_claimed_miss_the_limits(study, scale, missed):
    table = study.humanoid_table
    row = table.Row("g1", 40, "wrenches", (_calibrations(study, scale),), (np.full(3, 0.01),))
    lines, checks = table.table_lines([row], (0.94, 0.96), (0.97, 1.03))
    assert sum(not check.passed for check in checks) == missed
    assert "17.32" in lines[-1]
    assert "1.732" in lines[-1]


def test_a_folder_of_another_seed_is_refused(study, tmp_path):
    sample = study.script.SAMPLE
    first = study.script.Folder(tmp_path, sample, 1)
    made = first.once("x/y", lambda: {"a": np.arange(3)})
    again = study.script.Folder(tmp_path, sample, 1).once("x/y", dict)
    assert np.array_equal(made["a"], again["a"])
    with pytest.raises(SystemExit) as refusal:
        study.script.Folder(tmp_path, sample, 2)
    assert refusal.value.code == 2
