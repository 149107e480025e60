# SPDX-License-Identifier: Apache-2.0
"""A study gives the same results however it is run, and refuses what it does not understand.

Not covered here: that its statistics are right (test_coverage), and being killed (tests/cli).
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from comcal.errors import ConfigError, DataError, UsageError
from comcal.report.study import study_as_json
from comcal.workflow.study import StudyOrder, run_study
from comcal.workflow.study_file import NoiseSection, QuantitiesSection, RobotSection, read_study
from comcal.workflow.study_robot import prepare_robot
from comcal.workflow.study_trial import TrialKey, run_trial
from comcal_sims.robots.table1 import generate

STUDY = """\
format: comcal-study/1
name: little
robots:
  - name: table1
    quantities: {total_com: {bent: 8}}
noise:
  - {name: realistic}
seeds: {master: [3, 1], count: 3}
limits: {coverage: [0, 1]}
"""


@pytest.fixture
def study(tmp_path: Path) -> Path:
    path = tmp_path / "little.yaml"
    path.write_text(STUDY)
    return path


@pytest.fixture(scope="module")
def subject(tmp_path_factory: pytest.TempPathFactory):
    folder = tmp_path_factory.mktemp("subject")
    (folder / "study.yaml").write_text(STUDY)
    _, located = read_study(folder / "study.yaml")
    section = RobotSection(name="table1", quantities=QuantitiesSection(total_com={"bent": 8}))
    return prepare_robot(section, folder, located, 0)


def test_results_do_not_depend_on_workers_order_or_interruptions(
    study: Path, tmp_path: Path
) -> None:
    one, two = tmp_path / "one", tmp_path / "two"
    seen: list[tuple[int, int]] = []
    alone = run_study(StudyOrder(study, one, workers=1), lambda *count: seen.append(count))
    assert seen[0] == (0, 6)
    assert seen[-1] == (6, 6)

    run_study(StudyOrder(study, two, workers=1, limit=1))
    results = two / "results.jsonl"
    results.write_bytes(results.read_bytes()[:-40])  # cut off in the middle of its last line
    resumed = run_study(StudyOrder(study, two, workers=2))
    assert resumed.before == 1
    assert results.read_bytes() == (one / "results.jsonl").read_bytes()
    assert study_as_json(resumed.summary) == study_as_json(alone.summary)
    lines = [json.loads(line) for line in results.read_text().splitlines()]
    keys = [(line["master"], line["index"]) for line in lines]
    assert keys == [(m, i) for m in (1, 3) for i in range(3)]
    assert len({tuple(line["error"]) for line in lines}) == 6

    # Nothing is missing now: no process is started, nothing is written.
    again = run_study(StudyOrder(study, two, limit=2))
    assert again.before == again.summary.pooled[-1].calibrations == 4

    study.write_text(STUDY.replace("{name: realistic}", "{name: realistic, encoder: 0.001}"))
    with pytest.raises(UsageError, match="another study"):
        run_study(StudyOrder(study, two))
    results.write_text(results.read_text().replace('"rank"', '"tank"', 1))
    study.write_text(STUDY)
    with pytest.raises(DataError, match=r"results\.jsonl:1: the line is damaged"):
        run_study(StudyOrder(study, two))


def test_quantities_of_the_study_are_the_components_exact_data_determine(subject) -> None:
    names = subject.quantities.names
    assert names[0] == "mass"
    assert names[-3:] == tuple(f"total_com.bent.{axis}" for axis in "xyz")
    links = {"waist.x", "waist.z", "l_thigh.z", "l_shin.z", "r_thigh.z", "r_shin.z"}
    assert set(names[1:-3]) == links


def test_without_noise_only_cad_separates_a_calibration_from_the_truth(subject) -> None:
    noise = NoiseSection(name="tiny", ft_force=1e-6, ft_moment=1e-7, encoder=1e-10)
    trial = run_trial(subject, noise, TrialKey("table1", "tiny", 5, 0))
    error = dict(zip(subject.quantities.names, trial.error, strict=True))
    assert abs(error["l_thigh.z"]) < 1e-7
    assert abs(error["total_com.bent.x"]) < 1e-4
    # The soles were 0.1 kg +/- 0.5 % in the end; their sum is not measured.
    assert 1e-6 < abs(error["mass"]) < 3e-3


def test_a_calibration_that_is_refused_is_a_result_too(subject) -> None:
    poses = (*subject.poses[:3], subject.poses[3].__class__(99, np.full(6, 9.9)))
    other = subject.__class__(subject.name, "", subject.robot, poses, subject.quantities)
    trial = run_trial(other, NoiseSection(name="n"), TrialKey("table1", "n", 1, 0))
    assert "leave its limits" in trial.failed
    assert trial.error == ()


def test_a_robot_of_ones_own_is_found_beside_the_study(study: Path, tmp_path: Path) -> None:
    generate(tmp_path / "mine", sole_mass=0.2)
    text = STUDY.replace("  - name: table1\n", "  - name: mine\n    robot: mine/robot.yaml\n")
    study.write_text(text)
    file, located = read_study(study)
    mine = prepare_robot(file.robots[0], tmp_path / "robots", located, 0)
    assert mine.robot.tree.links[-1].mass == 0.2


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("seeds:", "seed:", "little.yaml:8: unknown key 'seed'; did you mean 'seeds'?"),
        ("count: 3", "cout: 3", "little.yaml:8: unknown key 'cout' in seeds; did you mean 'count'"),
        ("count: 3", "count: 0", "little.yaml:8: seeds.count"),
        ("[3, 1]", "[3, 3]", "little.yaml:8: seeds.master: a master seed occurs twice"),
        ("{name: realistic}", "{name: realistic, encoder: -1}", "little.yaml:7: noise[0].encoder"),
        ("table1\n", "tabel1\n", "little.yaml:4: there is no generated robot 'tabel1'; did you me"),
        ("table1\n", "t\n    robot: t.yaml\n", "no such file"),
        ("bent: 8", "bent: 88", "little.yaml:5: table1 has no standing pose 88"),
        ("realistic}", "a}\n  - {name: a}", "little.yaml:8: two entries of noise are called 'a'"),
        ("limits", "crb: none.json\nlimits", "none.json: cannot be read"),
        ("study/1", "study/9", "little.yaml:1: format"),
        ("table1\n", "table1\n    parameters: {l_d: 1}\n", "l_d is not a parameter of the robot"),
        ("coverage: [0, 1]", "coverage: [0]", "little.yaml:9: limits.coverage"),
    ],
)
def test_a_wrong_study_file_is_refused_with_its_line(
    study: Path, tmp_path: Path, old: str, new: str, words: str
) -> None:
    study.write_text(STUDY.replace(old, new))
    with pytest.raises(UsageError) as refused:
        run_study(StudyOrder(study, tmp_path / "out"))
    assert words in str(refused.value)
    assert not (tmp_path / "out" / "results.jsonl").exists()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"robot": "other"}, "no bound of table1 with noise 'realistic'"),
        ({"noise": {"ft_force": 0.2, "ft_moment": 0.01, "encoder": 3.4907e-4}}, "no bound of tab"),
        ({"poses": [1, 2]}, "no bound of table1"),
        ({"sigma": {"mass": 1.0}}, "no bound of waist.x of table1"),
    ],
)
def test_bounds_of_something_else_are_refused(
    study: Path, tmp_path: Path, change: dict[str, object], words: str
) -> None:
    entry = {
        "robot": "table1",
        "noise": {"ft_force": 0.1, "ft_moment": 0.01, "encoder": 3.4907e-4},
        "poses": list(range(1, 26)),
        "sigma": {},
    }
    bounds = {"format": "comcal-crb/1", "bounds": [{**entry, **change}]}
    (tmp_path / "crb.json").write_text(json.dumps(bounds))
    study.write_text(STUDY + "crb: crb.json\n")
    with pytest.raises(ConfigError, match=words):
        run_study(StudyOrder(study, tmp_path / "out"))
