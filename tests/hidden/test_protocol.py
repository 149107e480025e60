# SPDX-License-Identifier: Apache-2.0
"""The protocol of hidden effects: a scenario for everything, a seal, and a method that can fail."""

from __future__ import annotations

import json
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from comcal.cli.main import main
from comcal.diagnose.diagnose import diagnose
from comcal.diagnose.diagnosis import Diagnosis, Verdict
from comcal.diagnose.metric import Metric
from comcal.diagnose.scene import Scene
from comcal.effects.registry import effects
from comcal.measure.table import PoseTable
from comcal.predict.assumed import Assumed
from comcal.robot.changes import Change, check_changes
from comcal.robot.changes_table import EFFECTS
from comcal.robot.changes_text import change_text
from comcal.robot.healthy import draw_healthy
from comcal.workflow.sealed import truth_path
from comcal_sims.faults.support import hidden_changes, worlds_for
from comcal_sims.robots import biped14

ENGINE = "pybullet" if find_spec("pybullet") else "mujoco"
POSES = tuple(range(1, 22))
LOOKED_FOR = ("payload", "link_mass", "ft_bias", "joint_offset", "imu_mounting")
"""Few of the catalogue: the method is the same, and takes a tenth of the time."""


def drawn(study: SimpleNamespace, effect: str) -> tuple[Change, ...]:
    """Draw an effect as its line of the study does."""
    rng, line = np.random.default_rng(2), study.scenario.scenario().line(effect)
    if line == "contact":
        return study.draw.contacts(rng, POSES)
    if line == "single":
        target = study.scenario.targets(study.scenario.scenario().robot, effect)[0]
        pair = (effect, target)
        return (study.draw.change_of(pair, study.draw.coordinates(pair, rng)),)
    draws = {
        "gate": lambda: study.draw.gate(rng, POSES),
        "moving": lambda: Change(effect, "l_foot", {"time": 0.1}),
        "discrete": lambda: study.draw.mistake(rng),
        "unknown": lambda: Change(
            "unknown", "l_knee", {"function": ("eccentricity",), "amplitude": 0.02, "phase": 1.0}
        ),
    }
    return (next(c for c in (draws[line]() for _ in range(200)) if c.effect == effect),)


def test_every_effect_has_a_scenario_that_says_how_it_is_realised(study: SimpleNamespace) -> None:
    declared = study.scenario.scenario().data["effects"]
    assert set(declared) == set(EFFECTS) | set(effects())
    assert {name: entry["realisation"] for name, entry in declared.items()} == {
        name: EFFECTS[name].realisation.value for name in declared
    }
    assert {entry["line"] for entry in declared.values()} <= {
        *study.lines.LINES,
        "measured",
        "moving",
    }


@pytest.mark.parametrize("effect", EFFECTS)
def test_every_effect_is_drawn_as_an_engine_can_make_it(
    study: SimpleNamespace, effect: str
) -> None:
    robot = study.scenario.scenario().robot
    if not worlds_for(effect):
        assert study.scenario.scenario().line(effect) in ("measured", "published")
        return
    changes = drawn(study, effect)
    assert {c.effect for c in changes} == {effect}
    check_changes(changes, robot)
    texts = [change_text(change) for change in changes]
    for world in worlds_for(effect):
        assert hidden_changes(texts, robot, world) == changes


def test_what_is_registered_is_hidden_at_every_target(study: SimpleNamespace) -> None:
    pairs = study.scenario.scenario().pairs()
    assert len(pairs) == len(set(pairs)) > 200
    assert {effect for effect, _ in pairs} == {
        name for name in effects() if study.scenario.scenario().line(name) in ("single", "contact")
    }


def test_a_sealed_session_is_diagnosed_without_its_truth(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Nothing in the folder tells; with the truth deleted the cause is found by the readings."""
    robot_yaml = biped14.generate(tmp_path / "robot")
    header, *rows = robot_yaml.with_name("plan.csv").read_text("utf-8").splitlines()
    plan, session = tmp_path / "plan.csv", tmp_path / "session"
    chosen = [*rows[1:17:4], *rows[17:37:5], *rows[38:40]]
    plan.write_text("\n".join([header, *chosen]) + "\n", "utf-8")
    hidden = "payload@torso:mass=5.125,com_x=0.0678125,com_z=0.21875"
    words = ["record", str(robot_yaml), "-s", str(session), "--source", ENGINE]
    assert main([*words, "--poses", str(plan), "--seed", "271828182", "--effect", hidden]) == 0
    secrets = ["payload", "5.125", "0.0678125", "0.21875", "271828182"]
    for file in (f for f in session.rglob("*") if f.is_file()):
        content = file.read_bytes()
        assert not [word for word in secrets if word.encode() in content], file
        assert np.float64(5.125).tobytes() not in content
    truth_path(session).unlink()
    capsys.readouterr()
    assert main(["diagnose", str(session), "--json"]) in (0, 5)
    said = json.loads(capsys.readouterr().out)
    assert not truth_path(session).exists()
    assert "payload" in json.dumps(said["causes"])
    assert "torso" in json.dumps(said["causes"])


@pytest.mark.parametrize("line", ["five_kg", "healthy"])
def test_a_trial_comes_to_the_right_verdict(study: SimpleNamespace, line: str) -> None:
    record = study.trial.run_trial(line, 3, 0, ENGINE)
    assert json.loads(json.dumps(record)) == record
    if line == "healthy":
        assert record["verdict"] == "nothing_wrong"
        assert not record["named"]
        return
    (truth,) = record["truth"]
    assert truth["realisation"] == "engine"
    assert truth["found"] == [truth["name"]]
    assert study.rates.right(record)
    cause = next(c for c in record["named"] if c["name"] == truth["name"])
    assert {key for key, *_ in cause["values"]} == {"mass", "com_x", "com_y", "com_z"}


@pytest.fixture(scope="module")
def few(study: SimpleNamespace) -> Any:
    """The robot in the first poses of the mixed set, a third of the work."""
    stage = study.scenario.scenario().stage("mixed")
    return replace(stage, poses=stage.poses[:6])


@pytest.fixture(scope="module")
def healthy_tables(study: SimpleNamespace, few: Any) -> list[PoseTable]:
    """Readings of healthy robots."""
    tables = []
    for seed in range(2):
        changes = draw_healthy(few.robot, np.random.default_rng([5, seed]))
        tables.append(study.world.hidden_table(few, changes, 25, engine="builtin", seed=seed))
    return tables


def false_alarms(tables: list[PoseTable], assumed: Assumed) -> int:
    """Count the healthy robots of which something wrong is said."""
    found: list[Diagnosis] = [
        diagnose(assumed, table, causes=LOOKED_FOR, learn=False) for table in tables
    ]
    return sum(said.verdict is not Verdict.NOTHING_WRONG for said in found)


def test_healthy_robots_raise_no_alarm(few: Any, healthy_tables: list[PoseTable]) -> None:
    assert false_alarms(healthy_tables, Assumed(few.robot)) == 0


def test_without_tolerances_one_would(
    study: SimpleNamespace, few: Any, healthy_tables: list[PoseTable]
) -> None:
    told = study.lines.robot_told({"": 1e-6})
    assert false_alarms(healthy_tables[:1], Assumed(told)) == 1


def test_with_a_diagonal_covariance_some_would(
    few: Any, healthy_tables: list[PoseTable], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The spread of one link is in many rows at once: row by row it would count as often."""

    def row_by_row(self: Scene, causes: tuple[int, ...] = ()) -> Metric:
        spread = self.of.spread(self.scales, causes)
        variance = 1.0 + ((self.X * spread) ** 2).sum(axis=1)
        X, r = self.X / np.sqrt(variance)[:, None], self.r / np.sqrt(variance)
        log_det = float(np.log(variance).sum())
        return Metric(X.T @ X, X.T @ r, float(r @ r), len(r), log_det)

    monkeypatch.setattr(Scene, "against", row_by_row)
    assert false_alarms(healthy_tables, Assumed(few.robot)) > 0
