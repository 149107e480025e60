# SPDX-License-Identifier: Apache-2.0
"""Simulated sources: reproducible, resumable, and clear about what they cannot do."""

from __future__ import annotations

from dataclasses import replace
from importlib.metadata import entry_points

import numpy as np
import pytest

from comcal.errors import MissingExtraError, UsageError
from comcal.measure.source import Block, SourceRequest
from comcal_sims import sources
from comcal_sims.builtin_world import static_state


def _request(generated, **changes):
    return replace(SourceRequest(generated.robot, seed=11), **changes)


def _measure(request, poses, duration=0.1) -> Block:
    """Samples of the last of *poses*, after having visited all of them."""
    with sources.open_builtin(request) as source:
        for pose in poses:
            source.move_to(pose)
            block = source.read(duration)
    return block


def _equal(one: Block, other: Block) -> bool:
    return (
        np.array_equal(one.t, other.t)
        and np.array_equal(one.q, other.q)
        and all(np.array_equal(one.wrenches[s], other.wrenches[s]) for s in one.wrenches)
        and np.array_equal(one.currents, other.currents)
    )


def test_equal_seeds_give_equal_samples_and_others_do_not(table1):
    request = _request(table1)
    block = _measure(request, table1.plan[:1])
    assert _equal(block, _measure(request, table1.plan[:1]))
    other = _measure(replace(request, seed=12), table1.plan[:1])
    assert not np.any(block.wrenches["l_foot"] == other.wrenches["l_foot"])
    assert not np.any(block.q == other.q)


def test_a_resumed_pose_reads_as_if_never_interrupted(biped14):
    request = _request(biped14)
    uninterrupted = _measure(request, biped14.plan[:6])
    assert _equal(uninterrupted, _measure(request, biped14.plan[5:6]))


def test_samples_come_at_120_per_second_on_one_clock(table1):
    with sources.open_builtin(_request(table1)) as source:
        source.move_to(table1.plan[0])
        t = np.concatenate([source.read(0.5).t, source.read(0.25).t])
        assert t.size == 90
        assert np.diff(t) == pytest.approx(1 / 120)
        source.move_to(table1.plan[1])
        assert source.read(0.0).t > t[-1]


def test_without_noise_the_truth_is_read(table1):
    pose = table1.plan[2]
    block = _measure(_request(table1, noise=False), [pose])
    truth = static_state(table1.robot, pose)
    assert np.all(block.q == truth.q)
    assert np.all(block.wrenches["l_foot"] == truth.wrenches["l_foot"])


def test_options_of_robot_yaml_reach_the_sensors(table1):
    options = {"encoder": 0.0, "ft_force": 0.0}
    block = _measure(_request(table1, options=options), table1.plan[:1])
    assert np.all(block.q == table1.plan[0].q)
    force, moment = np.split(block.wrenches["l_foot"], 2, axis=1)
    assert np.all(force == force[0])
    assert np.all(moment.std(axis=0) > 0.0)


def test_a_pose_beyond_a_limit_is_refused_before_moving(table1):
    pose = replace(table1.plan[0], q=np.array([0.0, 2.0, 0.0, 0.0, 0.0, 0.0]))
    with (
        sources.open_builtin(_request(table1)) as source,
        pytest.raises(UsageError, match=r"pose 1: joint l_knee .*2\.0000, limit -1\.7000 to"),
    ):
        source.move_to(pose)


def test_reading_before_the_first_pose_says_so(table1):
    with (
        sources.open_builtin(_request(table1)) as source,
        pytest.raises(UsageError, match="place a pose first"),
    ):
        source.read(0.1)


def test_wrong_effects_are_refused_by_name(table1):
    with pytest.raises(UsageError, match="--effect payload@waist"):
        sources.open_builtin(_request(table1, effects=("payload@waist:mas=1",)))


def test_a_hidden_payload_weighs(table1):
    request = _request(table1, noise=False)
    plain = _measure(request, table1.plan[:1])
    loaded = _measure(replace(request, effects=("payload@waist:mass=1",)), table1.plan[:1])
    added = sum(loaded.wrenches[s][-1, 2] - plain.wrenches[s][-1, 2] for s in plain.wrenches)
    assert added == pytest.approx(table1.robot.gravity)


def test_hidden_effects_survive_an_interruption(biped14):
    effects = (
        "hysteresis@l_knee:half_width=0.01",
        "joint_friction@all:coulomb=2",
        "tether@torso:force_x=2,k_xx=30",
        "ft_temperature@l_foot:fz=0.1",
        "joint_compliance@all:stiffness=4000",
    )
    request = _request(biped14, effects=effects, plan=biped14.plan)
    uninterrupted = _measure(request, biped14.plan[:6])
    assert _equal(uninterrupted, _measure(request, biped14.plan[4:6]))


@pytest.mark.parametrize("engine", ["pybullet", "mujoco"])
def test_a_missing_engine_names_the_line_to_type(table1, monkeypatch, engine):
    monkeypatch.setattr(sources, "find_spec", lambda _: None)
    extra = {"pybullet": r"comcal\[sim\]", "mujoco": r"comcal\[mujoco\]"}[engine]
    with pytest.raises(MissingExtraError, match=rf"pip install '{extra}'.*--source builtin"):
        getattr(sources, f"open_{engine}")(_request(table1))


def test_the_entry_points_lead_here():
    opened = {point.name: point.load() for point in entry_points(group="comcal.sources")}
    assert opened["builtin"] is sources.open_builtin
    assert opened["pybullet"] is sources.open_pybullet
    assert opened["mujoco"] is sources.open_mujoco
