# SPDX-License-Identifier: Apache-2.0
"""Whatever bytes the readers are given, they answer with a robot or with an error of ours."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from comcal.errors import ComcalError
from comcal.robot.description import load_robot
from comcal.robot.health import check_health
from comcal.robot.urdf import read_urdf

QUICK = settings(
    deadline=None, max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
NUMBERS = ["0", "-1", "1e308", "-1e-308", "nan", ".inf", "1e9999", "0 0 0", "1 2", "5 mm", "3 kg"]
YAML_MARKS = ["~", "true", "[]", "{}", "[[", ":", "- ", "&a", "*a", "!!float", "|", "<<: *a", "\t"]
XML_MARKS = ["<", ">", "/>", "&lt;", "&x;", "]]>", "<!--", "<link/>", "<mimic/>", "'", '"', "\x00"]
NAMES = ["pelvis", "l_sole", "l_hip", "base", "double", "fixed", "floating", "prismatic", "é", ""]
WORDS = st.sampled_from([*NUMBERS, *YAML_MARKS, *XML_MARKS, *NAMES, "\n", "%YAML 1.1\n---\n"])


@st.composite
def mutated(draw, text: str) -> str:
    """*text* with a few stretches cut out, copied elsewhere, or replaced by words that hurt."""
    for _ in range(draw(st.integers(1, 4))):
        start = draw(st.integers(0, len(text)))
        end = min(len(text), start + draw(st.integers(0, 25)))
        what = draw(st.one_of(WORDS, st.just(text[end : end + 30]), st.just("")))
        text = text[:start] + what + text[end:]
    return text


@st.composite
def with_other_values(draw, text: str) -> str:
    """*text* with some whole words replaced, so that what is wrong is the meaning."""
    words = text.split(" ")
    for _ in range(draw(st.integers(1, 3))):
        i = draw(st.integers(0, len(words) - 1))
        words[i] = draw(st.one_of(WORDS, st.sampled_from(words)))
    return " ".join(words)


def read_all(path):
    """Load and check; only errors of ours may come out, and they name a place."""
    try:
        robot = load_robot(path)
    except ComcalError as error:
        refusal = error
    else:
        refusal = None
    if refusal is not None:
        assert refusal.exit_code == 2
        assert refusal.where
        return
    check_health(robot)
    assert np.isfinite(robot.tree.masses).all() or not robot.tree.geometry_known


@QUICK
@given(raw=st.binary(max_size=200))
def test_random_bytes_are_answered_with_our_own_errors(biped, raw):
    biped.write_bytes(raw)
    with pytest.raises(ComcalError):
        load_robot(biped)
    urdf = biped.parent / "small.urdf"
    urdf.write_bytes(raw)
    with pytest.raises(ComcalError):
        read_urdf(urdf)


@QUICK
@given(data=st.data())
def test_a_damaged_yaml_is_answered_with_our_own_errors(biped, biped_yaml, data):
    how = data.draw(st.sampled_from([mutated, with_other_values]))
    biped.write_bytes(data.draw(how(biped_yaml)).encode("utf-8", "surrogatepass"))
    read_all(biped)


@QUICK
@given(data=st.data())
def test_a_damaged_urdf_is_answered_with_our_own_errors(biped, biped_urdf, data):
    how = data.draw(st.sampled_from([mutated, with_other_values]))
    text = data.draw(how(biped_urdf))
    (biped.parent / "small.urdf").write_bytes(text.encode("utf-8", "surrogatepass"))
    read_all(biped)


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text("ab-: mkg1.", max_size=6),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text("ab", max_size=3), inner, max_size=3)
    ),
    max_leaves=6,
)
KEYS = ["sensors", "feet", "plates", "motors", "imu", "noise", "tolerances", "sources", "limits"]


@QUICK
@given(key=st.sampled_from([*KEYS, "urdf", "chain", "gravity", "base", "name"]), value=JSON)
def test_any_value_under_any_key_is_answered_with_our_own_errors(biped, biped_yaml, key, value):
    lines = [line for line in biped_yaml.split("\n") if not line.startswith(f"{key}:")]
    text = json.dumps(value).replace("NaN", ".nan").replace("Infinity", ".inf")
    biped.write_text("\n".join([*lines[:3], f"{key}: {text}"]))
    read_all(biped)
