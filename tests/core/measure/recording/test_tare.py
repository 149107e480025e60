# SPDX-License-Identifier: Apache-2.0
"""Tares of sensors in the air. The command is in tests/cli/test_tare.py."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from comcal.errors import DataError, NotBalancedError, NotFiniteError, NotStillError, UsageError
from comcal.measure.hanging import Up, hanging_wrench, up_of
from comcal.measure.plan import NONE, PlannedPose
from comcal.measure.session import Session, create_session
from comcal.measure.source import Block
from comcal.measure.tare import LOADED, still_window, store_tares, tares_of
from comcal.robot.description import load_robot
from comcal.robot.model import Robot, Sense
from comcal_sims.builtin_world import static_state
from comcal_sims.robots.biped14 import generate

RATE = 100.0


@pytest.fixture(scope="module")
def biped(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    return load_robot(generate(tmp_path_factory.mktemp("biped14")))


@pytest.fixture(scope="module")
def hung(biped: Robot) -> PlannedPose:
    """Bent, so that no foot hangs straight down."""
    q = np.linspace(-0.3, 0.3, len(biped.tree.joint_names))
    joints = [biped.tree.joints[biped.tree.joint_index[n]] for n in biped.tree.joint_names]
    return PlannedPose(0, np.clip(q, [j.lower for j in joints], [j.upper for j in joints]), NONE)


class Hanging:
    """A source whose robot hangs in a pose, with given offsets."""

    name = "hanging 1.0"

    def __init__(self, robot: Robot, pose: PlannedPose, bias: dict[str, np.ndarray]) -> None:
        self.state = static_state(robot, pose)
        self.bias = bias
        self.t = 0.0
        self.swing = 0.0
        self.rng = np.random.default_rng(0)

    def read(self, duration: float) -> Block:
        n = round(duration * RATE)
        t = self.t + np.arange(1, n + 1) / RATE
        self.t = float(t[-1])
        swing = self.swing * np.sin(3.0 * t)[:, None]
        wrenches = {
            name: w + self.bias[name] + swing + 0.2 * self.rng.standard_normal((n, 6)) * SCALE
            for name, w in self.state.wrenches.items()
        }
        assert self.state.imu is not None
        return Block(
            t,
            np.tile(self.state.q, (n, 1)),
            wrenches,
            imu=np.tile(self.state.imu, (n, 1)),
            temperatures={"l_foot": np.full(n, 31.5)},
        )

    def close(self) -> None:
        self.t = np.nan


SCALE = np.repeat([1.0, 0.1], 3)
BIAS = {
    "l_foot": np.array([20.0, -7.0, 12.0, 0.5, -0.3, 0.2]),
    "r_foot": np.array([-3.0, 4.0, 30.0, 0.0, 0.8, -0.6]),
}


@pytest.fixture
def source(biped: Robot, hung: PlannedPose) -> Hanging:
    return Hanging(biped, hung, BIAS)


def window(biped: Robot, source: Hanging) -> Block:
    return still_window(biped, source, ("l_foot", "r_foot"), 3.0, 20.0)


def test_offsets_come_back_within_their_sigma(biped: Robot, source: Hanging) -> None:
    for tare in tares_of(window(biped, source), biped, NONE, hanging=True):
        error = (tare.value - BIAS[tare.sensor]) / tare.sigma
        assert np.abs(error).max() < 4.0
        assert np.all(tare.sigma[:3] < 0.1)
        assert tare.temperature == (31.5 if tare.sensor == "l_foot" else None)
        assert tare.up == "the IMU on pelvis"


def test_a_bare_sensor_gets_no_weight_back(biped: Robot, source: Hanging) -> None:
    seen = window(biped, source)
    bare = tares_of(seen, biped, NONE, hanging=False)
    for with_foot, tare in zip(tares_of(seen, biped, NONE, hanging=True), bare, strict=True):
        assert tare.hangs is None
        assert with_foot.hangs is not None
        np.testing.assert_allclose(tare.value - with_foot.value, with_foot.hangs)
        assert np.linalg.norm(with_foot.hangs[:3]) == pytest.approx(0.3 * 9.81)


def test_the_weight_follows_the_sense_of_the_sensor(biped: Robot, hung: PlannedPose) -> None:
    sensor = biped.sensors["l_foot"]
    turned = replace(biped, sensors={"l_foot": replace(sensor, sense=Sense.ON_GROUND)})
    up = Up(np.array([0.0, 0.0, 1.0]), 0.01, "")
    plain, sigma = hanging_wrench(biped, "l_foot", hung.q, up)
    other, same = hanging_wrench(turned, "l_foot", hung.q, up)
    np.testing.assert_allclose(plain, -other)
    np.testing.assert_allclose(sigma, same)
    np.testing.assert_allclose(plain, static_state(biped, hung).wrenches["l_foot"], atol=1e-9)


def test_the_sigma_covers_a_base_that_leans(biped: Robot, hung: PlannedPose) -> None:
    level = up_of(biped, hung.q, None, NONE)
    c, s = np.cos(level.sigma), np.sin(level.sigma)
    leaning = replace(level, direction=np.array([s, 0.0, c]))
    taken, sigma = hanging_wrench(biped, "l_foot", hung.q, level)
    true, _ = hanging_wrench(biped, "l_foot", hung.q, leaning)
    assert np.all(np.abs(true - taken) <= 1.1 * sigma + 1e-9)
    assert np.linalg.norm(true - taken) > 0.01


def test_up_is_taken_from_the_best_that_there_is(biped: Robot, hung: PlannedPose) -> None:
    imu = static_state(biped, hung).imu
    assert up_of(biped, hung.q, imu, NONE).source == "the IMU on pelvis"
    assert "sole of foot left" in up_of(biped, hung.q, None, "left").source
    assert "upright" in up_of(biped, hung.q, None, NONE).source
    with pytest.raises(DataError, match="does not read gravity"):
        up_of(biped, hung.q, np.array([0.0, 0.0, 1.0]), NONE)


def test_a_loaded_sensor_is_refused_and_believed_when_told_to(
    biped: Robot, hung: PlannedPose
) -> None:
    load = LOADED * biped.tree.total_mass * biped.gravity * 1.05
    bias = {**BIAS, "r_foot": np.array([0.0, 0.0, load, 0.0, 0.0, 0.0])}
    seen = window(biped, Hanging(biped, hung, bias))
    with pytest.raises(NotBalancedError, match="r_foot: is loaded"):
        tares_of(seen, biped, NONE, hanging=True)
    assert len(tares_of(seen, biped, NONE, hanging=True, limit=200.0)) == 2


def test_a_swinging_robot_is_not_tared(biped: Robot, source: Hanging) -> None:
    source.swing = 5.0
    with pytest.raises(NotStillError, match="not still for 3 s"):
        window(biped, source)
    assert source.t == pytest.approx(20.2, abs=0.5)


def test_other_sensors_may_do_as_they_like(biped: Robot, source: Hanging) -> None:
    source.swing = 5.0
    quiet = Hanging.read

    def read(duration: float) -> Block:
        block = quiet(source, duration)
        calm = block.wrenches["l_foot"] - source.swing * np.sin(3.0 * block.t)[:, None]
        return replace(block, wrenches={**block.wrenches, "l_foot": calm})

    source.read = read  # type: ignore[method-assign]
    seen = still_window(biped, source, ("l_foot",), 3.0, 20.0)
    assert list(seen.wrenches) == ["l_foot"]


def test_missing_and_empty_readings_are_told(biped: Robot, source: Hanging) -> None:
    with pytest.raises(DataError, match="no readings of waist"):
        still_window(biped, source, ("waist",), 3.0, 20.0)
    seen = window(biped, source)
    seen.wrenches["l_foot"][5, 2] = np.nan
    with pytest.raises(NotFiniteError, match="l_foot"):
        tares_of(seen, biped, NONE, hanging=True)


def test_what_hangs_below_a_held_base_is_not_known(biped: Robot, hung: PlannedPose) -> None:
    below = {**biped.below_cut, "l_foot": ~biped.below_cut["l_foot"]}
    held = replace(biped)
    held.__dict__["below_cut"] = below
    with pytest.raises(UsageError, match="base of the robot is below"):
        hanging_wrench(held, "l_foot", hung.q, up_of(biped, hung.q, None, NONE))


def test_an_older_tare_is_replaced_only_when_asked_and_kept(
    biped: Robot, source: Hanging, tmp_path: Path
) -> None:
    session: Session = create_session(tmp_path / "s", biped)
    first = tares_of(window(biped, source), biped, NONE, hanging=True)
    store_tares(session, first, again=False)
    value, sigma = session.tares()["l_foot"]
    np.testing.assert_allclose(value, first[0].value, rtol=1e-8)
    np.testing.assert_allclose(sigma, first[0].sigma, rtol=1e-8)
    before = session.session_yaml.read_bytes()
    second = tuple(replace(tare, value=tare.value + 1.0) for tare in first[:1])
    with pytest.raises(UsageError, match="l_foot already"):
        store_tares(session, second, again=False)
    assert session.session_yaml.read_bytes() == before
    store_tares(session, second, again=True)
    np.testing.assert_allclose(session.tares()["l_foot"][0], first[0].value + 1.0, rtol=1e-8)
    np.testing.assert_allclose(session.tares()["r_foot"][0], first[1].value, rtol=1e-8)
    (old,) = session.metadata["tare_history"]
    assert old["sensor"] == "l_foot"
    np.testing.assert_allclose(old["value"], first[0].value, rtol=1e-8)
