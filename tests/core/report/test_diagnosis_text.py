# SPDX-License-Identifier: Apache-2.0
"""What a person reads of a diagnosis: the sentence first, the verdict last, nothing overstated."""

from __future__ import annotations

import io
import math
import re
from dataclasses import replace

import pytest

from comcal.diagnose.diagnosis import Estimate
from comcal.report.console import make_console
from comcal.report.diagnosis import CHANNELS_SHOWN, print_diagnosis
from comcal.report.diagnosis_words import odds, parameter_texts
from comcal.robot.changes import Change

VERDICTS = ("nothing_wrong", "explained", "ambiguous", "unexplained")


def text_of(diagnosis) -> str:
    stream = io.StringIO()
    print_diagnosis(make_console(file=stream), diagnosis)
    return stream.getvalue()


def words_of(diagnosis) -> str:
    return " ".join(text_of(diagnosis).split())


@pytest.mark.parametrize("verdict", VERDICTS)
def test_sentence_is_first_and_verdict_with_its_limit_last(verdict, diagnoses) -> None:
    lines = text_of(diagnoses[verdict]).splitlines()
    assert lines[0] == diagnoses[verdict].sentence
    assert lines[-2].startswith(f"Verdict: {verdict.replace('_', ' ').upper()}")
    limit = "0.001" if verdict == "nothing_wrong" else "0.0001"
    assert re.search(rf"p = \S+ (<|>=) {limit}$", lines[-1])


@pytest.mark.parametrize("verdict", VERDICTS)
def test_text_is_plain_and_fits_100_columns(verdict, diagnoses, monkeypatch) -> None:
    monkeypatch.delenv("COLUMNS", raising=False)
    text = text_of(diagnoses[verdict])
    assert "\x1b" not in text
    assert max(map(len, text.splitlines())) <= 100


def test_parameters_are_in_the_units_that_people_read(diagnoses) -> None:
    words = words_of(diagnoses["explained"])
    assert "mass 5.020 kg 4.912 to 5.128 outside the healthy tolerance" in words
    assert "com_x 101.3 mm 93.3 to 109.3" in words
    assert "com_y -2.1 mm -9.5 to 5.3 com_z" in words, "not outside: nothing beside it"
    assert "fx 0.120 N/min 0.073 to 0.167" in words_of(diagnoses["ambiguous"])


def test_odds_are_words_that_need_no_logarithm() -> None:
    assert odds(math.log(400.0)) == "1:400"
    assert odds(math.log(1.8)) == "1:1.8"
    assert odds(-math.log(3.0)) == "3:1"
    assert odds(0.0) == "1:1"
    assert odds(math.log(1e9)) == "1:10^9"
    assert odds(math.inf) == "1:10^99"


def test_rivals_stand_with_odds_and_with_what_sets_them_apart(diagnoses) -> None:
    words = words_of(diagnoses["explained"])
    assert "link_mass@torso 1:400 (21 % unlike)" in words
    assert "1 more told from them by: joints next to the link moved" in words
    assert "remedy: weigh what was added" in words


def test_a_gain_is_never_printed_as_a_proof(diagnoses) -> None:
    words = words_of(diagnoses["explained"])
    assert "removes 41 % of their squared residuals (95 %: 33 to 48 %)" in words
    assert "mean square 3.42 -> 1.02" in words
    assert "a gain alone does not prove a cause" in words
    assert "in 54 % of trials" in words
    assert "CoM 11.2 -> 0.53 mm 9.1 to 12" in words
    assert "joint torque 1.31 -> 1.3 N m - " in words


def test_a_gain_within_noise_is_called_nothing(diagnoses) -> None:
    assert "nothing is gained beyond noise: do not change" in words_of(diagnoses["ambiguous"])
    assert "nothing is gained: no cause" in words_of(diagnoses["nothing_wrong"])
    assert "nothing is gained" not in words_of(diagnoses["explained"])


def test_too_few_poses_to_hold_out_is_said(diagnoses) -> None:
    diagnosis = diagnoses["explained"]
    few = replace(diagnosis, causes=(replace(diagnosis.causes[0], gain=None),))
    assert "whether anything is gained is not known" in words_of(few)


def test_causes_of_an_unexplained_verdict_are_called_partial(diagnoses) -> None:
    words = words_of(diagnoses["unexplained"])
    assert "PARTIAL: more is wrong" in words
    assert "partial, not to be trusted: payload@torso" in words
    assert "encoder l_knee, as a function of sin(q)" in words
    assert "p = 4e-29 < 0.0001" in words
    assert "PARTIAL" not in words_of(diagnoses["explained"])


def test_all_that_is_ambiguous_is_named_with_what_decides(diagnoses) -> None:
    words = words_of(diagnoses["ambiguous"])
    assert "AMBIGUOUS: ft_drift@l_foot or ft_temperature@l_foot" in words
    assert "(the same in every reading)" in words
    assert "What would decide revisit poses at another temperature" in words


def test_refused_readings_say_which_poses_and_what_was_done(diagnoses) -> None:
    words = words_of(diagnoses["unexplained"])
    assert "saturation@r_foot: fz stands at 600 N in 3 poses, limit 1 (poses 4, 9, 11)" in words
    assert "readings left out; use a sensor of a larger range" in words


def test_tolerances_that_look_wrong_are_noted_by_factor(diagnoses) -> None:
    families = {f"family_{k}": 0.25 for k in range(6)}
    words = words_of(replace(diagnoses["explained"], scales={**families, "noise": 1.25}))
    assert (
        "0.25 times as large as stated: family_0, family_1, family_2, family_3 and 2 more" in words
    )
    assert "1.25 times as large as stated: noise" in words


def test_long_lists_are_shortened_and_counted(diagnoses) -> None:
    diagnosis = diagnoses["explained"]
    words = words_of(diagnosis)
    assert "joint_offset (arm_0, arm_1, arm_2, arm_3 and 3 more); imu_mounting" in words
    small = replace(diagnosis.channels[-1], sigmas_before=1.3)
    many = replace(diagnosis, channels=(*diagnosis.channels, *[small] * CHANNELS_SHOWN))
    assert "4 more, none above 1.3 sigmas before, 1.0 after" in words_of(many)


def test_words_of_a_mistake_are_printed_as_they_are(diagnoses) -> None:
    change = Change("unit_error", "l_foot", {"channels": ("fx", "fy"), "factor": 9.80665})
    cause = replace(
        diagnoses["explained"].causes[0],
        change=change,
        estimates={"factor": Estimate(9.80665, 0.01, (9.787, 9.826), "1")},
        outside=(),
    )
    channels, factor = parameter_texts(cause)
    assert (channels.value, channels.interval) == ("fx, fy", "")
    assert (factor.value, factor.interval) == ("9.807", "9.787 to 9.826")
