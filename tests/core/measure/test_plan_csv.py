# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from comcal.errors import ComcalError, ConfigError, MissingColumnError, NotFiniteError
from comcal.measure.plan import PlannedPose
from comcal.measure.plan_csv import read_plan, write_plan

JOINTS: tuple[str, ...] = ("ankle", "hip")
FAST = settings(
    deadline=None,
    max_examples=60,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
finite = st.floats(-1e9, 1e9)
words = st.text(st.characters(codec="ascii", categories=["L", "N"]), max_size=6)


@st.composite
def plans(draw: st.DrawFn) -> list[PlannedPose]:
    ids = draw(st.lists(st.integers(0, 10**6), min_size=1, max_size=5, unique=True))
    return [
        PlannedPose(
            pose=i,
            q=np.array(draw(st.tuples(finite, finite))),
            support=draw(st.sampled_from(["double", "none", "left"])),
            configuration=draw(words),
            tilt=draw(st.none() | finite),
            approach=draw(st.dictionaries(st.sampled_from(JOINTS), st.sampled_from([-1, 0, 1]))),
            floor_roll=draw(finite),
            floor_pitch=draw(finite),
        )
        for i in ids
    ]


def same(a: PlannedPose, b: PlannedPose) -> bool:
    return (
        np.array_equal(a.q, b.q)
        and (a.pose, a.support, a.configuration, a.tilt)
        == (b.pose, b.support, b.configuration, b.tilt)
        and dict(a.approach) == dict(b.approach)
        and (a.floor_roll, a.floor_pitch) == (b.floor_roll, b.floor_pitch)
    )


@FAST
@given(plans())
def test_a_written_plan_is_read_back_exactly(
    tmp_path_factory: pytest.TempPathFactory, poses: list[PlannedPose]
) -> None:
    path = tmp_path_factory.mktemp("plan") / "plan.csv"
    write_plan(path, poses, JOINTS)
    back = read_plan(path, JOINTS)
    assert len(back) == len(poses)
    assert all(same(a, b) for a, b in zip(poses, back, strict=True))


def test_unused_optional_columns_are_left_out(tmp_path: Path) -> None:
    write_plan(tmp_path / "plan.csv", [PlannedPose(1, np.array([0.1, 0.2]))], JOINTS)
    assert (tmp_path / "plan.csv").read_text() == "pose,support,q.ankle,q.hip\n1,double,0.1,0.2\n"


def test_an_existing_plan_is_never_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "plan.csv"
    path.write_text("mine")
    with pytest.raises(ConfigError, match="exists already"):
        write_plan(path, [PlannedPose(1, np.zeros(2))], JOINTS)
    assert path.read_text() == "mine"


@pytest.mark.parametrize(
    ("text", "error", "words"),
    [
        ("pose,q.ankle\n1,0\n", MissingColumnError, "q.hip"),
        ("q.ankle,q.hip\n1,0\n", MissingColumnError, "pose"),
        ("pose,q.ankle,q.hip\n1,0,\n", NotFiniteError, "plan.csv:2.*q.hip"),
        ("pose,q.ankle,q.hip\n1,0,nan\n", NotFiniteError, "plan.csv:2.*q.hip"),
        ("pose,q.ankle,q.hip\n1,0,1e999\n", NotFiniteError, "q.hip"),
        ("pose,q.ankle,q.hip\n1,0,1e99\n", ConfigError, "nothing on a robot"),
        ("pose,q.ankle,q.hip\n1,0,1_0\n", ConfigError, "not a number"),
        ("pose,q.ankle,q.hip\n1.5,0,0\n", ConfigError, "not an integer"),
        ("pose,q.ankle,q.hip\n1,0,0\n1,0,0\n", ConfigError, "plan.csv:3.*twice"),
        ("pose,q.ankle,q.hip,q.hip\n1,0,0,0\n", ConfigError, "twice"),
        ("pose,q.ankle,q.hip,aproach.hip\n1,0,0,1\n", ConfigError, "did you mean approach.hip"),
        ("pose,q.ankle,q.hip,approach.hip\n1,0,0,2\n", ConfigError, "approach.hip is 2"),
        ("pose;q.ankle;q.hip\n1;0;0\n", ConfigError, "commas"),
        ("pose,q.ankle,q.hip\n1,0\n", ConfigError, "plan.csv:2.*2 cells"),
        ('pose,q.ankle,q.hip\n1,0,"0\n', ConfigError, "CSV"),
        ("pose,q.ankle,q.hip\n", ConfigError, "no rows"),
        ("", ConfigError, "empty"),
    ],
)
def test_a_faulty_plan_is_refused_with_its_place(
    tmp_path: Path, text: str, error: type[ComcalError], words: str
) -> None:
    path = tmp_path / "plan.csv"
    path.write_text(text)
    with pytest.raises(error, match=words):
        read_plan(path, JOINTS)


def test_a_missing_file_is_a_configuration_error(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot be read"):
        read_plan(tmp_path / "absent.csv", JOINTS)


@FAST
@given(st.binary(max_size=80))
def test_rubbish_is_refused_in_our_own_words(
    tmp_path_factory: pytest.TempPathFactory, rubbish: bytes
) -> None:
    path = tmp_path_factory.mktemp("plan") / "plan.csv"
    path.write_bytes(b"pose,q.ankle,q.hip\n" + rubbish)
    try:
        read_plan(path, JOINTS)
    except ComcalError:
        return
    for line in rubbish.decode().splitlines():  # what was accepted is made of numbers only
        for cell in line.split(","):
            assert not cell.strip() or np.isfinite(float(cell.strip().strip('"')))
