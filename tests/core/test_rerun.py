# SPDX-License-Identifier: Apache-2.0
"""A simulation at measured poses: it is sent where the encoders are, and errs as little as they."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from comcal.errors import UsageError
from comcal.measure.table import PoseTable
from comcal.report.rerun import NO_PROOF, rerun_json, rerun_lines
from comcal.robot.changes import Change
from comcal.robot.changes_text import parse_change
from comcal.workflow.rerun import physical, rerun, rerun_gain
from comcal_sims.builtin_world import BuiltinWorld
from comcal_sims.faults.faulty_world import FaultyWorld

HIDDEN = (
    "payload@torso:mass=3,com_x=0.05,com_z=0.2",
    "joint_offset@waist_pitch:offset=0.02",
    "cable_pull@torso:force_x=10",
)
MEASURES = {"total foot force", "total foot moment", "total CoM", "joint torques"}


def changes(*texts: str) -> tuple[Change, ...]:
    return tuple(parse_change(text) for text in texts)


@pytest.fixture(scope="module")
def clean(biped14) -> PoseTable:
    return biped14.measure(biped14.plan[::3])


@pytest.fixture(scope="module")
def measured(biped14, clean) -> PoseTable:
    """The robot that hides three things, measured with noise: its currents are torques here."""
    table = rerun(biped14.robot, clean, "builtin", changes(*HIDDEN))
    rng = np.random.default_rng(3)
    current = table.current + 0.02 * rng.standard_normal(table.current.shape)
    return replace(
        biped14.noisy(table, rng), current=current, current_var=np.full(current.shape, 0.02**2)
    )


def test_encoders_read_what_was_measured(biped14, measured) -> None:
    """On one foot to the last bit; two feet that do not close give by what noise there was."""
    for known in ((), changes(*HIDDEN)):
        found = rerun(biped14.robot, measured, "builtin", known)
        assert found.pose == measured.pose
        gap = np.abs(found.q - measured.q).max(axis=1)
        single = np.array([support != "double" for support in measured.support])
        assert single.any()
        assert gap[single].max() < 1e-12
        assert gap.max() < 4e-3 if known else gap.max() < 1e-12


def test_the_extended_model_errs_no_more_than_readings_do(biped14, measured) -> None:
    rng = np.random.default_rng(1)
    gain = rerun_gain(biped14.robot, measured, "builtin", changes(*HIDDEN), rng)
    assert {m.what for m in gain.measures} == MEASURES
    for measure in (gain.whole, *gain.measures):
        assert measure.extended < 1.35 * measure.noise
        assert measure.extended_interval[0] <= measure.extended <= measure.extended_interval[1]
        assert measure.is_real
        assert measure.given > 5.0 * measure.noise
    assert gain.is_real
    lines = rerun_lines(gain)
    assert lines[-1] == NO_PROOF
    assert any(line.startswith("total CoM off by") and " mm rms" in line for line in lines)
    content = rerun_json(gain)
    assert content["is_real"] is True
    assert content["poses"] == list(measured.pose)


def test_a_change_that_is_not_there_gains_nothing(biped14, clean) -> None:
    noisy = biped14.noisy(clean, np.random.default_rng(7))
    rng = np.random.default_rng(1)
    wrong = changes("payload@torso:mass=0.5,com_x=0.1")
    gain = rerun_gain(biped14.robot, noisy, "builtin", wrong, rng)
    assert not gain.is_real
    assert gain.whole.gain < 0.0
    assert any(line.startswith("nothing is gained") for line in rerun_lines(gain))


def test_the_model_that_was_given_is_simulated_too(biped14, measured) -> None:
    """What was assumed already is no gain of what was found on top of it."""
    rng, all_of_it = np.random.default_rng(1), changes(*HIDDEN)
    gain = rerun_gain(
        biped14.robot,
        measured,
        "builtin",
        all_of_it[1:],
        rng,
        given=all_of_it[:1],
        chosen=[0, 1, 2],
    )
    assert gain.poses == tuple(p for p, s in zip(measured.pose, measured.support, strict=True))[:3]
    force = next(m for m in gain.measures if m.what == "total foot force")
    assert force.given < 12.0  # the cable's 10 N, and not the weight of the payload


def test_a_foot_stands_where_the_encoders_say_and_is_not_moved_twice(biped14) -> None:
    """Shifted in the plane once more, feet that closed already stood centimetres off."""
    robot, plan = biped14.robot, biped14.plan[:33:3]
    known = changes("foot_placement@right:x=-0.0067,y=0.001,z=0.0073,roll=0.035,pitch=0.0035")
    world = FaultyWorld(BuiltinWorld(robot), robot, known, plan)
    measured = biped14.noisy(biped14.measure(plan, world=world), np.random.default_rng(5))
    found = rerun(robot, measured, "builtin", known)
    both = np.isin(measured.pose, found.pose)
    assert np.abs(found.q - measured.q[both]).max() < 4e-3
    gain = rerun_gain(robot, measured, "builtin", known, np.random.default_rng(1))
    assert gain.whole.extended < 1.35 * gain.whole.noise
    assert gain.whole.given > 5.0 * gain.whole.noise
    assert physical(changes("foot_placement@right:x=0.01,yaw=0.02")) == ()


def test_errors_of_readings_are_taken_out_of_them(biped14, clean) -> None:
    """However the feet share: the gain of one sensor is not put into the simulated share."""
    robot = biped14.robot
    read = replace(clean, wrench={s: w.copy() for s, w in clean.wrench.items()})
    read.wrench["r_foot"][:, 2] *= 1.05
    rng = np.random.default_rng(1)
    found = changes("ft_gain@r_foot:gain_fz=0.05", "internal_torque_term:factor=-1")
    assert physical(found) == ()
    gain = rerun_gain(robot, read, "builtin", found, rng)
    force = next(m for m in gain.measures if m.what == "total foot force")
    assert force.extended < 1e-6
    assert force.given > 10.0
    assert gain.notes == ("left out of the simulation: internal_torque_term",)


def test_nothing_that_is_real_is_moved(biped14, clean) -> None:
    with pytest.raises(UsageError, match="does not simulate"):
        rerun(biped14.robot, clean, "can")


def test_poses_beyond_the_urdfs_limits_by_noise_are_simulated(biped14, clean) -> None:
    tree = biped14.robot.tree
    joints = tuple(
        replace(j, lower=-1e-6, upper=1e-6) if j.name in tree.joint_names else j
        for j in tree.joints
    )
    tight = replace(biped14.robot, tree=replace(tree, joints=joints))
    found = rerun(tight, clean, "builtin")
    standing = [p for p, s in zip(clean.pose, clean.support, strict=True) if s != "none"]
    assert list(found.pose) == standing
    np.testing.assert_allclose(
        found.wrench["l_foot"],
        clean.select([s != "none" for s in clean.support]).wrench["l_foot"],
        atol=1e-9,
    )


@pytest.mark.engine
@pytest.mark.parametrize("engine", ["pybullet", "mujoco"])
def test_engines_agree_with_what_was_measured(engine, biped14, measured) -> None:
    pytest.importorskip(engine)
    rows = [i for i, s in enumerate(measured.support) if s != "none"][::5]
    rng = np.random.default_rng(1)
    gain = rerun_gain(biped14.robot, measured, engine, changes(*HIDDEN), rng, chosen=rows)
    assert engine in gain.engine.lower()
    assert gain.whole.extended < 2.0
    assert gain.whole.given > 10.0
