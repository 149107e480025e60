# SPDX-License-Identifier: Apache-2.0
"""What the simulator hides, the effect of the same name takes back: two codes, one contract.

The world hides a change in its bodies, joints, sensor frames and motors; the finder corrects what
it assumes and what it reads. Nothing but names, units and signs is shared.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from comcal.cli.main import main
from comcal.effects.registry import corrected, effects
from comcal.measure.poses_csv import read_poses
from comcal.measure.table import PoseTable
from comcal.predict.assumed import Assumed
from comcal.predict.parity import Parity, parity
from comcal.robot.changes_text import parse_change
from comcal.robot.description import load_robot
from comcal.robot.model import Robot
from comcal_sims.robots import biped14

HIDDEN = {
    "ft_bias@l_foot:fz=5,ty=0.5": {"equilibrium", "sensor", "torque"},
    "ft_gain@r_foot:gain_fz=0.05": {"equilibrium", "sensor", "torque"},
    "ft_crosstalk@l_foot:fz_to_ty=0.005": {"equilibrium", "sensor", "torque"},
    "ft_mounting@l_foot:rx=0.02,ry=-0.01": {"equilibrium", "sensor", "torque"},
    "ft_position@r_foot:x=0.01,z=0.02": {"equilibrium", "sensor", "torque"},
    "ft_drift@l_foot:fz=0.01": {"equilibrium", "sensor", "torque"},
    "ft_temperature@l_foot:fz=0.5": {"equilibrium", "sensor", "torque"},
    "payload@torso:mass=5,com_x=0.1,com_z=0.2": {"equilibrium", "torque"},
    "link_mass@l_thigh:mass=1": {"equilibrium", "torque"},
    "link_com@torso:com_x=0.02,com_y=0.01": {"equilibrium", "torque"},
    "sole_mass@r_foot:mass=0.2": {"equilibrium", "sensor", "torque"},
    "link_length@l_knee:z=0.01": {"equilibrium", "torque", "closure"},
    "joint_offset@waist_pitch:offset=0.02": {"equilibrium", "torque"},
    "joint_offset@l_knee:offset=0.01": {"equilibrium", "torque", "closure", "imu", "sensor"},
    "joint_compliance@waist_pitch:stiffness=2000": {"equilibrium", "torque"},
    "joint_compliance@l_knee:stiffness=5000": {
        "equilibrium",
        "torque",
        "closure",
        "imu",
        "sensor",
    },
    "backlash@l_shoulder:half_width=0.01": {"equilibrium", "torque"},
    "hysteresis@waist_pitch:half_width=0.01": {"equilibrium", "torque"},
    "torque_constant@l_knee:relative=0.1": {"torque"},
    "current_offset@r_knee:offset=0.3": {"torque"},
    "joint_friction@l_knee:coulomb=2,load_factor=0.1": {"torque"},
    "ground_tilt:roll=0.02,pitch=-0.01": {"equilibrium", "sensor", "torque", "imu"},
    "imu_mounting:roll=0.02": {"imu", "torque", "sensor"},
    "sole_compliance@left:tilt_x=1e-4,tilt_y=1e-4": {
        "equilibrium",
        "sensor",
        "torque",
        "imu",
        "closure",
    },
    "foot_placement@right:z=0.004,roll=0.01,pitch=-0.01": {
        "equilibrium",
        "sensor",
        "torque",
        "imu",
        "closure",
    },
    "foot_placement@left:x=0.01,z=-0.003,roll=0.01": {
        "equilibrium",
        "sensor",
        "torque",
        "imu",
        "closure",
    },
    "cable_pull@torso:force_x=8,force_y=3": {"equilibrium"},
    "tether@torso:force_x=5,k_xx=80": {"equilibrium"},
    "external_contact@l_arm:force_x=10,poses=5": {"equilibrium", "torque"},
}
"""What is hidden, and the kinds of rows that must move: no others."""

NOT_HIDDEN = {"internal_torque_term", "inertia", "not_settled", "timing_skew"}
"""Effects that a simulator at rest cannot have: a mistake of a model, and what shows in motion. A
late sensor is hidden below; a sway, which slopes cannot take back, is left to the gates."""


def readings(
    folder: Path, *hidden: str, source: str = "builtin", most: int | None = None
) -> tuple[Robot, PoseTable]:
    robot_yaml = biped14.generate(folder / "robot")
    header, *rows = robot_yaml.with_name("plan.csv").read_text("utf-8").splitlines()
    chosen = [*rows[:40:4], *[row for row in rows if ",none" in row][:2]]
    plan = folder / "plan.csv"
    plan.write_text("\n".join([header, *dict.fromkeys(chosen[:most])]) + "\n", "utf-8")
    session = folder / "session"
    words = ["record", str(robot_yaml), "-s", str(session), "--source", source, "--no-noise"]
    words += [word for change in hidden for word in ("--effect", change)]
    assert main([*words, "--poses", str(plan), "--seed", "1"]) == 0
    robot = load_robot(session / "robot.yaml")
    return robot, read_poses(session / "poses.csv", robot)


def norms(found: Parity, approached: np.ndarray) -> dict[str, float]:
    """Norm of the residuals of every kind, over the poses that are asked for."""
    total: dict[str, float] = {}
    for value, i, row in zip(found.values, found.pose, found.row, strict=True):
        if np.isfinite(value) and approached[i]:
            total[row.kind] = float(np.hypot(total.get(row.kind, 0.0), value))
    return total


@pytest.mark.parametrize("hidden", HIDDEN)
def test_the_effect_of_the_same_name_takes_back_what_was_hidden(
    hidden: str, tmp_path: Path
) -> None:
    robot, table = readings(tmp_path, hidden)
    change = parse_change(hidden)
    known = np.ones(len(table), np.bool_)
    if change.effect in ("joint_friction", "hysteresis"):  # the first pose came from nowhere
        known = np.isfinite(table.approach).all(axis=1)
    before = norms(parity(Assumed(robot), table), known)
    after = norms(parity(*corrected(Assumed(robot), table, [change])), known)
    moved = {kind for kind, size in before.items() if size > 1e-5}
    assert moved == HIDDEN[hidden]
    for kind, size in after.items():
        assert size < 0.01 * before[kind] + 1e-6, kind


def test_a_late_sensor_of_a_swaying_robot_is_brought_up_to_date(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    sway, late = "not_settled:time=3", "timing_skew@l_foot:time=0.02"
    _, on_time = readings(tmp_path / "sway", sway, source="mujoco", most=5)
    robot, table = readings(tmp_path / "late", sway, late, source="mujoco", most=5)
    np.testing.assert_array_equal(table.t, on_time.t)  # the same windows
    change = parse_change(late)
    _, undone = corrected(Assumed(robot), table, [change])
    off = np.abs(table.wrench["l_foot"] - on_time.wrench["l_foot"]).max(axis=0)
    left = np.abs(undone.wrench["l_foot"] - on_time.wrench["l_foot"]).max(axis=0)
    assert np.all(off[[0, 2, 4]] > 0.005)
    assert np.all(left < 0.2 * off)
    np.testing.assert_array_equal(undone.wrench["r_foot"], on_time.wrench["r_foot"])


def test_every_effect_that_is_looked_for_is_hidden_here() -> None:
    # Mistakes of wiring, which have no size, are hidden in test_mistakes_are_undone.py.
    sized = {name for name, effect in effects().items() if effect.fault}
    assert {parse_change(text).effect for text in HIDDEN} | NOT_HIDDEN == sized
