# SPDX-License-Identifier: Apache-2.0
"""The cause that is there has the evidence on its side; healthy readings have none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from comcal.diagnose.candidates import Candidate, candidates, columns
from comcal.diagnose.evidence import explained
from comcal.diagnose.spread import Whitened, noise_covariance, whiten
from comcal.measure.table import PoseTable
from comcal.predict.assumed import Assumed
from comcal.predict.parity import Parity, parity
from comcal.robot.model import Robot

LOOKED_FOR = (
    "payload@torso",
    "payload@l_arm",
    "link_com@torso",
    "link_com@r_thigh",
    "ft_bias@l_foot",
    "ft_mounting@l_foot",
    "joint_offset@l_knee",
    "joint_offset@l_hip_pitch",
    "ground_tilt",
)


def scored(robot: Robot, table: PoseTable) -> tuple[Whitened, Parity, dict[str, float]]:
    """The residuals, whitened with noise and healthy CoMs, and the log odds of every cause."""
    assumed = Assumed(robot)
    at = parity(assumed, table)
    known = {c.name: c for c in candidates(robot, table)}
    moved = {n: columns(known[n], assumed, table, at) for n in LOOKED_FOR}
    healthy: list[tuple[Candidate, np.ndarray, np.ndarray]] = [
        (known[n], moved[n], np.full(3, robot.tolerances.link_com))
        for n in LOOKED_FOR
        if n.startswith("link_com")
    ]
    white = whiten(at, noise_covariance(assumed, table, at), healthy)
    odds = {
        n: explained(white.values, white.turned(np.nan_to_num(moved[n])), known[n].fault).log_odds
        for n in LOOKED_FOR
    }
    return white, at, odds


@pytest.fixture
def healthy(biped14) -> PoseTable:
    return biped14.measure(biped14.plan[::5])


def heavier(robot: Robot, name: str, mass: float, at: np.ndarray) -> Robot:
    links = tuple(
        replace(k, mass=k.mass + mass, com=(k.mass * k.com + mass * at) / (k.mass + mass))
        if k.name == name
        else k
        for k in robot.tree.links
    )
    return replace(robot, tree=replace(robot.tree, links=links))


def test_whitened_noise_is_white(biped14, healthy):
    """The covariance is that of the noise drawn: chi2 over its degrees of freedom is one."""
    rng = np.random.default_rng(4)
    total, freedom = 0.0, 0
    for _ in range(6):
        table = biped14.noisy(healthy, rng)
        assumed = Assumed(biped14.robot)
        at = parity(assumed, table)
        white = whiten(at, noise_covariance(assumed, table, at), [])
        total += float(white.values @ white.values)
        freedom += len(white.values)
    assert total / freedom == pytest.approx(1.0, abs=4 * np.sqrt(2 / freedom))


def test_healthy_readings_give_no_cause_any_odds(biped14, healthy):
    _, _, odds = scored(biped14.robot, biped14.noisy(healthy, np.random.default_rng(1)))
    assert max(odds.values()) < 3.0 + np.log(len(LOOKED_FOR))


def test_a_body_that_the_model_does_not_know_is_named(biped14):
    true = heavier(biped14.robot, "torso", 2.0, np.array([0.1, 0.0, 0.25]))
    table = biped14.measure(biped14.plan[::5], true_robot=true)
    white, at, odds = scored(biped14.robot, biped14.noisy(table, np.random.default_rng(2)))
    assert max(odds, key=odds.__getitem__) == "payload@torso"
    assert odds["payload@torso"] > 30.0
    assumed = Assumed(biped14.robot)
    cause = next(c for c in candidates(biped14.robot, table) if c.name == "payload@torso")
    found = explained(white.values, white.turned(columns(cause, assumed, table, at)), cause.fault)
    change = cause.change(found.coordinates)
    assert change.number("mass") == pytest.approx(2.0, abs=5 * np.sqrt(found.cov[0, 0]))
    assert change.number("com_z") == pytest.approx(0.25, abs=0.05)


def test_a_turned_sensor_is_told_from_a_sloping_floor(biped14, healthy):
    table = biped14.noisy(healthy, np.random.default_rng(3))
    turn = 0.03
    w = table.wrench["l_foot"].copy()
    c, s = np.cos(turn), np.sin(turn)
    for k in (0, 3):
        w[:, k + 1], w[:, k + 2] = (
            c * w[:, k + 1] - s * w[:, k + 2],
            s * w[:, k + 1] + c * w[:, k + 2],
        )
    table = replace(table, wrench={**table.wrench, "l_foot": w})
    _, _, odds = scored(biped14.robot, table)
    assert max(odds, key=odds.__getitem__) == "ft_mounting@l_foot"
    assert odds["ft_mounting@l_foot"] > odds["ground_tilt"] + 10.0
