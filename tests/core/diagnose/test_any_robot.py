# SPDX-License-Identifier: Apache-2.0
"""Any robot, any subset of channels: the cause is still found, or it is said what is missing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from comcal.diagnose.diagnose import diagnose
from comcal.diagnose.diagnosis import Verdict
from comcal.measure.table import PoseTable
from comcal.predict.assumed import Assumed
from comcal.robot.model import Robot


def with_body(robot: Robot, name: str, mass: float) -> Robot:
    """The robot with a body 0.1 m in front of a link's origin."""
    at = np.array([0.1, 0.0, 0.1])
    links = tuple(
        replace(k, mass=k.mass + mass, com=(k.mass * k.com + mass * at) / (k.mass + mass))
        if k.name == name
        else k
        for k in robot.tree.links
    )
    return replace(robot, tree=replace(robot.tree, links=links))


def without_imu(table: PoseTable) -> PoseTable:
    return replace(table, imu=np.full_like(table.imu, np.nan))


def without_torques(table: PoseTable) -> PoseTable:
    return replace(table, torque=np.full_like(table.torque, np.nan))


def wrenches_alone(table: PoseTable) -> PoseTable:
    return without_imu(without_torques(table))


def on_one_foot(table: PoseTable) -> PoseTable:
    return table.select([i for i, s in enumerate(table.support) if s in ("left", "right")])


@pytest.fixture
def loaded(biped14) -> PoseTable:
    """Half of the plan, measured with 3 kg on the torso."""
    true = with_body(biped14.robot, "torso", 3.0)
    exact = biped14.measure(biped14.plan[::2], true_robot=true)
    return biped14.noisy(exact, np.random.default_rng(6))


@pytest.mark.parametrize(
    ("some", "missing"),
    [
        (without_imu, "no IMU"),
        (without_torques, "no currents or joint torques"),
        (wrenches_alone, "no currents or joint torques"),
        (on_one_foot, "no pose on both feet"),
    ],
)
def test_a_body_is_found_with_fewer_channels_and_it_is_said_what_they_lack(
    some: Callable[[PoseTable], PoseTable], missing: str, biped14, loaded
) -> None:
    found = diagnose(Assumed(biped14.robot), some(loaded))
    told = {cause.name for cause in found.causes} | {r.name for g in found.groups for r in g}
    assert found.verdict in (Verdict.EXPLAINED, Verdict.AMBIGUOUS)
    assert "payload@torso" in told
    assert any(note.startswith(missing) for note in found.notes)


def test_a_planar_robot_of_four_links_is_diagnosed(table1) -> None:
    true = with_body(table1.robot, "waist", 1.0)
    rng = np.random.default_rng(7)
    healthy, loaded = (
        diagnose(Assumed(table1.robot), table1.noisy(table1.measure(true_robot=robot), rng))
        for robot in (table1.robot, true)
    )
    assert healthy.verdict is Verdict.NOTHING_WRONG
    assert loaded.verdict in (Verdict.EXPLAINED, Verdict.AMBIGUOUS)
    told = {c.name for c in loaded.causes} | {r.name for g in loaded.groups for r in g}
    assert any(name.endswith("@waist") for name in told), told


def test_the_paper_s_superfluous_term_is_named_with_its_factor(biped14) -> None:
    """Muscolo 2017 (10) adds the sum of all torques to the moment balance; truth lacks it: -1."""
    table = biped14.noisy(biped14.measure(biped14.plan[::3]), np.random.default_rng(8))
    found = diagnose(Assumed(biped14.robot, internal_torque=1.0), table)
    assert found.verdict is Verdict.EXPLAINED
    (cause,) = found.causes
    assert cause.name == "internal_torque_term"
    assert cause.estimates["factor"].value == pytest.approx(-1.0, abs=0.01)
