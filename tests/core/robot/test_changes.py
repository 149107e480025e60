# SPDX-License-Identifier: Apache-2.0
"""Changes as data: what is typed, written and read back is the same; what is wrong is named.

What a change does to a robot is not covered here (tests/sims/faults).
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from comcal.errors import ConfigError, UsageError
from comcal.robot.changes import Change, check_changes
from comcal.robot.changes_kinds import EffectSpec, KeyKind, TargetKind
from comcal.robot.changes_table import EFFECTS
from comcal.robot.changes_text import change_text, parse_change
from comcal.robot.changes_yaml import KnownChange, extension_text, read_extension
from comcal.robot.healthy import draw_healthy, healthy_spreads
from comcal.robot.model import Foot, Motor, Robot, Sensor, Tolerances
from comcal.robot.tree import Joint, JointType, Link, Tree
from comcal.robot.units import LARGEST

CONTRACT = [
    "ft_bias",
    "ft_gain",
    "ft_crosstalk",
    "ft_mounting",
    "ft_position",
    "ft_drift",
    "ft_temperature",
    "payload",
    "link_mass",
    "link_com",
    "link_length",
    "sole_mass",
    "joint_offset",
    "joint_compliance",
    "backlash",
    "hysteresis",
    "joint_friction",
    "torque_constant",
    "current_offset",
    "sole_compliance",
    "ground_tilt",
    "imu_mounting",
    "foot_placement",
    "cable_pull",
    "tether",
    "external_contact",
    "not_settled",
    "timing_skew",
    "inertia",
    "internal_torque_term",
    "channel_swap",
    "sign_flip",
    "unit_error",
    "frame_handedness",
    "left_right_swap",
    "frozen_sensor",
    "saturation",
    "quantisation",
    "unknown",
]


@pytest.fixture(scope="module")
def robot() -> Robot:
    """A leg: hip turns, sensor between shin and sole."""
    inertia = np.eye(3)
    links = tuple(Link(n, 2.0, np.zeros(3), inertia) for n in ("waist", "shin", "sole"))
    joints = (
        Joint("hip", JointType.REVOLUTE, "waist", "shin", np.eye(4), np.array([0.0, 1.0, 0.0])),
        Joint("cut", JointType.FIXED, "shin", "sole", np.eye(4), np.zeros(3)),
    )
    sole = np.array([[0.1, 0.1], [-0.1, 0.1], [-0.1, -0.1], [0.1, -0.1]])
    return Robot(
        "leg",
        Tree("leg", links, joints),
        sensors={"l_foot": Sensor("l_foot", "cut")},
        feet={"left": Foot("left", "sole", "l_foot", sole, np.eye(4), None)},
        motors={"hip": Motor("hip", 0.1)},
        imu_link="waist",
    )


def value_of(spec: EffectSpec) -> st.SearchStrategy[Change]:
    """Changes of one effect with any keys and values that it allows."""
    values = {}
    for key in spec.keys.values():
        if key.kind is KeyKind.POSES:
            values[key.name] = st.lists(st.integers(1, 99), min_size=1, max_size=3).map(tuple)
        elif key.kind is KeyKind.WORDS:
            values[key.name] = st.lists(
                st.sampled_from(("fx", "q", "x")), min_size=1, max_size=3
            ).map(tuple)
        else:
            least = max(key.least, -1e6)
            values[key.name] = st.floats(least, 1e6, exclude_min=key.above)
    required = {name: v for name, v in values.items() if spec.keys[name].required}
    optional = {name: v for name, v in values.items() if name not in required}
    target = "" if spec.targets == {TargetKind.NONE} else "somewhere"
    return (
        st.fixed_dictionaries(required, optional=optional)
        .filter(bool)
        .map(lambda parameters: Change(spec.name, target, parameters))
    )


any_change = st.sampled_from(list(EFFECTS.values())).flatmap(value_of)


def test_the_table_has_exactly_the_names_of_the_contract() -> None:
    assert list(EFFECTS) == CONTRACT
    assert len(EFFECTS["ft_crosstalk"].keys) == 30
    assert EFFECTS["ft_crosstalk"].keys["fz_to_ty"].unit == "m"


@given(any_change)
def test_what_is_printed_is_read_back_to_the_last_bit(change: Change) -> None:
    assert parse_change(change_text(change)) == change


@given(st.lists(any_change, max_size=4))
def test_extended_yaml_is_read_back_to_the_last_bit(
    tmp_path_factory: pytest.TempPathFactory, changes: list[Change]
) -> None:
    known = tuple(
        KnownChange(c, {k: 0.25 for k, v in c.parameters.items() if not isinstance(v, tuple)})
        for c in changes
    )
    path = tmp_path_factory.mktemp("extended") / "extended.yaml"
    path.write_text(extension_text(known), "utf-8")
    assert read_extension(path) == known


def test_a_change_is_called_by_effect_and_target() -> None:
    names = [parse_change(text).name for text in ("payload@torso:mass=5", "ground_tilt:roll=0.1")]
    assert names == ["payload@torso", "ground_tilt"]


def test_units_may_be_typed() -> None:
    change = parse_change("payload@torso:mass=500 g,com_z=20 cm")
    assert change.parameters == {"mass": 0.5, "com_z": 0.2}
    assert parse_change("external_contact@arm:force_z=3,poses=4+7").poses() == (4, 7)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("paylod@torso:mass=5", "no effect 'paylod'; did you mean 'payload'"),
        ("zzz@torso:mass=5", "no effect 'zzz'; there are ft_bias, ft_gain,"),
        ("payload@torso:mas=5", "no parameter 'mas'; did you mean 'mass'"),
        ("payload@torso:com_x=1", "payload lacks mass"),
        ("payload@torso", "no parameters here"),
        ("payload:mass=5", "needs a target; name a link"),
        ("payload@all:mass=5", "for all targets at once"),
        ("payload@torso:mass=-5", "-5 kg, limit above 0 kg"),
        ("payload@torso:mass=5 lb", "not a unit of mass"),
        ("payload@torso:mass=5,mass=6", "given twice"),
        ("payload@torso:mass", "not key=value"),
        ("payload@torso:mass=nan", "not a mass"),
        ("ground_tilt@floor:roll=0.1", "has no target"),
        ("external_contact@arm:force_z=3,poses=a", "joined by +"),
        (":mass=5", "must have a name"),
    ],
)
def test_what_is_wrong_is_named(text: str, words: str) -> None:
    with pytest.raises(UsageError) as caught:
        parse_change(text)
    assert words in str(caught.value)
    assert text.strip() in str(caught.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("payload@shi:mass=5", "no link 'shi'.*did you mean 'shin'"),
        ("joint_offset@cut:offset=0.1", "cut is fixed"),
        ("ft_bias@left:fx=1", "no sensor 'left'.*'l_foot'"),
        ("sole_compliance@right:tilt_x=1", "no foot 'right'.*left"),
        ("sign_flip@l_foot:channels=q", "no channel 'q'"),
        ("channel_swap@l_foot:channels=fx", "two channels"),
        ("channel_swap@hip:channels=i", "the other joint"),
        ("frame_handedness@l_foot:axis=w", "there is no axis 'w'"),
    ],
)
def test_targets_are_checked_against_the_robot(robot: Robot, text: str, words: str) -> None:
    with pytest.raises(UsageError, match=words):
        check_changes([parse_change(text)], robot)


@pytest.mark.parametrize(
    "text",
    [
        "payload@shin:mass=5",
        "joint_friction@all:coulomb=1",
        "joint_offset@hip:offset=0.1",
        "link_length@cut:z=0.01",
        "sole_compliance@all:tilt_x=1e-4",
        "sign_flip@imu:channels=ax",
        "ground_tilt:roll=0.01",
    ],
)
def test_what_the_robot_has_is_accepted(robot: Robot, text: str) -> None:
    check_changes([parse_change(text)], robot)


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ("- {effect: paylod, target: a, parameters: {mass: {value: 1}}}", r":3.*'payload'"),
        ("- {effect: payload, target: a, parameters: {mas: {value: 1}}}", r":3.*'mass'"),
        ("- {effect: payload, target: a, parameters: {mass: {value: 1, unit: g}}}", "is in kg"),
        ("- {effect: payload, target: a, parameters: {mass: {value: -1}}}", "out of its range"),
        ("- {effect: payload, target: a, parameters: {mass: {valu: 1}}}", "unknown key 'valu'"),
        ("- {effect: payload, target: a, parameters: {mass: {value: [1]}}}", "finite number"),
    ],
)
def test_mistakes_in_extended_yaml_are_named_with_their_line(
    tmp_path: Path, lines: str, words: str
) -> None:
    path = tmp_path / "extended.yaml"
    path.write_text(f"format: comcal-extension/1\neffects:\n{lines}\n")
    with pytest.raises(ConfigError, match=words):
        read_extension(path)


def test_healthy_draws_are_valid_reproducible_and_as_large_as_stated(robot: Robot) -> None:
    draws = [draw_healthy(robot, np.random.default_rng(seed)) for seed in range(200)]
    check_changes(draws[0], robot)
    assert draws[0] == draw_healthy(robot, np.random.default_rng(0)) != draws[1]
    spread = healthy_spreads(robot)
    zeros = [c.number("offset") for d in draws for c in d if c.effect == "joint_offset"]
    assert np.std(zeros) == pytest.approx(spread["joint_offset"], rel=0.2)
    springs = [
        1 / c.number("stiffness") for d in draws for c in d if c.effect == "joint_compliance"
    ]
    assert np.min(springs) > 0.0
    assert np.sqrt(np.mean(np.square(springs))) == pytest.approx(
        spread["joint_compliance"], rel=0.2
    )


def test_springs_too_stiff_to_be_written_down_are_none(robot: Robot) -> None:
    """About two thirds of these joints would be stiffer than any number that may be typed."""
    stiff = replace(robot, tolerances=Tolerances(other={"joint_compliance": 1.0 / LARGEST}))
    rngs = [np.random.default_rng(seed) for seed in range(20)]
    drawn = [change for rng in rngs for change in draw_healthy(stiff, rng, ["joint_compliance"])]
    assert 0 < len(drawn) < 20 * len(robot.tree.joint_names)
    assert [parse_change(change_text(change)) for change in drawn] == drawn


def test_leaving_a_family_out_does_not_change_the_others(robot: Robot) -> None:
    everything = draw_healthy(robot, np.random.default_rng(5))
    some = draw_healthy(robot, np.random.default_rng(5), families=("ft_bias", "link_com"))
    assert some == tuple(c for c in everything if c.effect in ("ft_bias", "link_com"))
