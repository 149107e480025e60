# SPDX-License-Identifier: Apache-2.0
"""``diagnosis.json`` is what other programs were promised, and loses nothing."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from importlib.resources import files

import jsonschema
import numpy as np
import pytest

from comcal.errors import ConfigError
from comcal.report.diagnosis_json import diagnosis_json
from comcal.report.diagnosis_read import diagnosis_from_json

SCHEMA = json.loads(
    files("comcal.report").joinpath("diagnosis.schema.json").read_text(encoding="utf-8")
)
VERDICTS = ("nothing_wrong", "explained", "ambiguous", "unexplained")


def as_text(diagnosis) -> str:
    content = diagnosis_json(diagnosis, {"robot.yaml": "00"}, "biped14")
    return json.dumps(content, allow_nan=False)


@pytest.mark.parametrize("verdict", VERDICTS)
def test_content_has_the_schema_that_ships(verdict, diagnoses) -> None:
    content = json.loads(as_text(diagnoses[verdict]))
    jsonschema.Draft202012Validator.check_schema(SCHEMA)
    jsonschema.validate(content, SCHEMA)
    assert content["verdict"] == verdict
    known = set(SCHEMA["properties"])
    assert set(content) == known, "the schema names every key"
    rivals = [rival for cause in content["causes"] for rival in cause["rivals"]]
    named = set(SCHEMA["$defs"]["rival"]["properties"])
    assert all(set(rival) == named for rival in rivals), "of rivals as well"


def test_schema_notices_a_missing_key_and_a_wrong_verdict(diagnoses) -> None:
    content = json.loads(as_text(diagnoses["explained"]))
    del content["causes"][0]["rivals"]
    with pytest.raises(jsonschema.ValidationError, match="rivals"):
        jsonschema.validate(content, SCHEMA)
    with pytest.raises(jsonschema.ValidationError, match="perhaps"):
        jsonschema.validate({**content, "causes": [], "verdict": "perhaps"}, SCHEMA)


def test_contracted_keys_hold_what_the_diagnosis_says(diagnoses) -> None:
    content = json.loads(as_text(diagnoses["explained"]))
    cause = content["causes"][0]
    assert (cause["effect"], cause["target"]) == ("payload", "torso")
    assert cause["parameters"]["com_x"] == {
        "value": 0.1013,
        "sigma": 0.0041,
        "unit": "m",
        "interval": pytest.approx([0.093264, 0.109336]),
    }
    assert cause["gain"] == {"held_out_fraction": 0.41, "interval": [0.33, 0.48]}
    assert cause["rivals"][0]["log_odds"] == pytest.approx(math.log(400.0))
    misfit = content["misfit"]
    assert (misfit["held_out_before"], misfit["held_out_after"]) == (3.42, 1.02)
    assert content["residuals_by_channel"]["equilibrium Fz"]["worst_pose"] == 7
    assert content["residuals_by_channel"]["closure pitch"]["worst_pose"] is None


@pytest.mark.parametrize("verdict", VERDICTS)
def test_reading_gives_back_what_was_written(verdict, diagnoses) -> None:
    diagnosis = diagnoses[verdict]
    again = diagnosis_from_json(json.loads(as_text(diagnosis)))
    # NaN is not equal to itself; the texts below hold what is left out here.
    without = {"traces": (), "held_out": ()}
    assert replace(again, **without) == replace(diagnosis, **without)
    assert as_text(again) == as_text(diagnosis)
    for mine, its in zip(again.traces, diagnosis.traces, strict=True):
        assert np.array_equal(mine.before, its.before, equal_nan=True)


def test_the_certainty_of_a_mistake_survives_as_null(diagnoses) -> None:
    diagnosis = diagnoses["explained"]
    sure = replace(diagnosis, causes=(replace(diagnosis.causes[0], log_odds=math.inf),))
    content = json.loads(as_text(sure))
    assert content["causes"][0]["log_odds"] is None
    assert diagnosis_from_json(content).causes[0].log_odds == math.inf


@pytest.mark.parametrize(
    ("change", "said"),
    [({"format": "comcal-result/1"}, "is not a diagnosis"), ({"misfit": {}}, "is damaged")],
)
def test_a_file_of_another_kind_is_refused(change, said, diagnoses) -> None:
    content = {**json.loads(as_text(diagnoses["explained"])), **change}
    with pytest.raises(ConfigError, match=said):
        diagnosis_from_json(content, "diagnosis.json")
