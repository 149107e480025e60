# SPDX-License-Identifier: Apache-2.0
"""Loads of a robot in motion: Pinocchio's inverse dynamics, taken back by ``inertia``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from comcal.effects.registry import corrected
from comcal.measure.table import PoseTable
from comcal.predict.assumed import Assumed
from comcal.predict.parity import Parity, parity
from comcal.robot.changes import Change
from comcal.robot.kinematics import place_links
from comcal.robot.model import Base, Robot
from comcal.robot.urdf import read_urdf

FACTOR_ONE = Change("inertia", "", {"factor": 1.0})


class Moving:
    """Pinocchio's model of the robot, with one foot at rest on a level floor."""

    def __init__(self, robot: Robot, foot: str) -> None:
        self.robot, self.foot = robot, foot
        self.model = pin.buildModelFromUrdf(str(robot.urdf_path), pin.JointModelFreeFlyer())
        self.model.gravity.linear = np.array([0.0, 0.0, -robot.gravity])
        self.data = self.model.createData()
        names = robot.tree.joint_names
        self.index = [self.model.joints[self.model.getJointId(n)].idx_v for n in names]

    def expand(self, joints: np.ndarray, base: np.ndarray) -> np.ndarray:
        full = np.zeros(self.model.nv)
        full[:6], full[self.index] = base, joints
        return full

    def loads(
        self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Ground wrench about the root in root axes, torques (joint order), and up in root axes."""
        model, data = self.model, self.data
        frame = model.getFrameId(self.robot.feet[self.foot].link)
        config = pin.neutral(model)
        config[7:][np.array(self.index) - 6] = q
        pin.framesForwardKinematics(model, data, config)
        sole = data.oMf[frame].rotation @ self.robot.feet[self.foot].T_link_sole[:3, :3]
        config[3:7] = pin.Quaternion(sole.T).coeffs()  # the sole lies flat: its z is the world's
        J = pin.computeFrameJacobian(model, data, config, frame, pin.LOCAL)
        v = self.expand(qd, np.linalg.solve(J[:, :6], -J[:, self.index] @ qd))
        pin.forwardKinematics(model, data, config, v, self.expand(qdd, np.zeros(6)))
        a = pin.getFrameAcceleration(model, data, frame, pin.LOCAL).vector
        a = self.expand(qdd, np.linalg.solve(J[:, :6], -a))
        force = pin.rnea(model, data, config, v, a)
        ground = force[:6]  # on the root, in its axes: what the ground must give in all
        pin.framesForwardKinematics(model, data, config)
        to_foot = data.oMf[frame].inverse() * data.oMi[1]
        at_foot = to_foot.act(pin.Force(ground)).vector
        torques = (
            force - pin.computeFrameJacobian(model, data, config, frame, pin.LOCAL).T @ at_foot
        )
        assert np.abs(torques[:6]).max() < 1e-8
        return ground, torques[self.index], data.oMi[1].rotation.T @ [0.0, 0.0, 1.0]


def moving_table(bench, foot: str, n: int = 5, speed: float = 1.0) -> PoseTable:
    """Poses on one foot in motion, and what their sensors and joints then feel."""
    robot, rng = bench.robot, np.random.default_rng(3)
    plan = [p for p in bench.plan if p.support == foot][:n]
    table = bench.measure(plan)
    qd, qdd = (speed * rng.uniform(-1.0, 1.0, table.q.shape) for _ in range(2))
    oracle = Moving(robot, foot)
    at = place_links(robot.tree, table.q)
    wrench = {s: w.copy() for s, w in table.wrench.items()}
    torque = np.zeros_like(table.q)
    sensor = robot.sensors[str(robot.feet[foot].sensor)]
    below = np.flatnonzero(robot.below_cut[sensor.name])
    for i, q in enumerate(table.q):
        ground, torque[i], up = oracle.loads(q, qd[i], qdd[i])
        # The links below the sensor are at rest: it feels all but their weight.
        for k in below:
            weight = robot.tree.links[k].mass * robot.gravity * up
            ground = ground - np.concatenate([weight, np.cross(at.coms[i, k], weight)])
        wrench[sensor.name][i] = in_frame(ground, *(a[i] for a in at.joint(sensor.joint)))
    motion = {f"qd.{j}": qd[:, k] for k, j in enumerate(robot.tree.joint_names)}
    motion |= {f"qdd.{j}": qdd[:, k] for k, j in enumerate(robot.tree.joint_names)}
    return replace(table, wrench=wrench, torque=torque, motion=motion)


def in_frame(wrench: np.ndarray, R: np.ndarray, p: np.ndarray) -> np.ndarray:
    return np.concatenate([R.T @ wrench[:3], R.T @ (wrench[3:] - np.cross(p, wrench[:3]))])


def norms(found: Parity, leave_out: tuple[str, ...] = ()) -> dict[str, float]:
    total: dict[str, float] = {}
    for value, row in zip(found.values, found.row, strict=True):
        if row.kind not in leave_out and row.of not in leave_out:
            total[row.kind] = float(np.hypot(total.get(row.kind, 0.0), value))
    return total


@pytest.mark.parametrize("foot", ["left", "right"])
def test_the_loads_of_a_standing_robot_in_motion_agree_with_inverse_dynamics(biped14, foot: str):
    table = moving_table(biped14, foot)
    other = "r_foot" if foot == "left" else "l_foot"
    before = norms(parity(Assumed(biped14.robot), table), ("imu", other))
    after = norms(parity(*corrected(Assumed(biped14.robot), table, [FACTOR_ONE])), ("imu", other))
    assert before["equilibrium"] > 10.0
    assert before["torque"] > 10.0
    for kind, size in after.items():
        assert size < 1e-6 * before[kind], kind


def test_a_lifted_foot_in_motion_pulls_at_its_sensor(biped14):
    """Its sensor then feels the acceleration of what hangs below it, for a point mass m (a + g)."""
    table = moving_table(biped14, "left")
    robot = biped14.robot
    moved = parity(*corrected(Assumed(robot), table, [FACTOR_ONE]))
    still = parity(Assumed(robot), table)
    rows = [k for k, r in enumerate(still.row) if r.of == "r_foot" and r.axis[0] == "F"]
    felt = (still.values - moved.values)[rows].reshape(-1, 3)
    oracle = acceleration_of_what_hangs(robot, table, "left", "r_foot")
    below = robot.below_cut["r_foot"]
    # The sensor feels the part below pulling at the robot, so the load of its motion is reversed.
    np.testing.assert_allclose(felt, robot.tree.masses[below].sum() * oracle, rtol=1e-5, atol=1e-6)


def acceleration_of_what_hangs(
    robot: Robot, table: PoseTable, foot: str, sensor: str
) -> np.ndarray:
    """Of the CoM below a sensor, in the sensor's axes, by differences of its place; (N, 3)."""
    names, step = robot.tree.joint_names, 1e-4
    qd, qdd = (np.column_stack([table.motion[f"{d}.{j}"] for j in names]) for d in ("qd", "qdd"))
    below = robot.below_cut[sensor]
    places = []
    for s in (-step, 0.0, step):
        at = place_links(robot.tree, table.q + qd * s + 0.5 * qdd * s**2)
        R, p = at.link(robot.feet[foot].link)
        m = robot.tree.masses[below]
        com = (m[:, None] * at.coms[:, below]).sum(axis=1) / m.sum()
        places.append(np.einsum("nji,nj->ni", R, com - p))
    at = place_links(robot.tree, table.q)
    R_foot, R_sensor = at.link(robot.feet[foot].link)[0], at.joint(robot.sensors[sensor].joint)[0]
    acceleration = (places[0] - 2.0 * places[1] + places[2]) / step**2
    return -np.einsum("nji,njk,nk->ni", R_sensor, R_foot, acceleration)


def test_the_factor_scales_and_adds_up(biped14):
    table = moving_table(biped14, "left", n=3)
    at = [
        parity(Assumed(biped14.robot, inertia=factor), table).values for factor in (0.0, 0.5, 1.0)
    ]
    np.testing.assert_allclose(at[1] - at[0], at[2] - at[1], atol=1e-9)
    half = Change("inertia", "", {"factor": 0.5})
    twice, _ = corrected(Assumed(biped14.robot), table, [half, half])
    np.testing.assert_allclose(parity(twice, table).values, at[2], atol=1e-12)


def test_without_accelerations_nothing_changes(biped14):
    table = replace(moving_table(biped14, "left", n=2), motion={})
    found = parity(*corrected(Assumed(biped14.robot), table, [FACTOR_ONE])).values
    np.testing.assert_array_equal(found, parity(Assumed(biped14.robot), table).values)


def test_a_point_mass_on_a_swinging_rod(tmp_path: Path):
    """At rest in the middle of its swing a pendulum of length l needs m l^2 q'' + m g l sin q."""
    mass, length, speed, swing = 2.0, 0.5, 1.5, 0.7
    robot = pendulum(tmp_path, mass, length)
    q = np.array([[0.3]])
    torque = mass * length**2 * swing + mass * robot.gravity * length * np.sin(q)
    table = hanging(q, torque, {"qd.swing": np.array([speed]), "qdd.swing": np.array([swing])})
    before = parity(Assumed(robot), table).values
    after = parity(*corrected(Assumed(robot), table, [FACTOR_ONE])).values
    assert before == pytest.approx([mass * length**2 * swing], rel=1e-9)
    assert after == pytest.approx([0.0], abs=2e-6)


def pendulum(folder: Path, mass: float, length: float) -> Robot:
    urdf = folder / "pendulum.urdf"
    urdf.write_text(
        f"""<robot name="pendulum"><link name="root"/>
        <link name="rod"><inertial><origin xyz="0 0 {-length}"/><mass value="{mass}"/>
        <inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/></inertial></link>
        <joint name="swing" type="revolute"><parent link="root"/><child link="rod"/>
        <axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="9" velocity="9"/></joint></robot>""",
        "utf-8",
    )
    return Robot("pendulum", read_urdf(urdf), base=Base.FIXED)


def hanging(q: np.ndarray, torque: np.ndarray, motion: dict[str, np.ndarray]) -> PoseTable:
    nan3 = np.full((1, 3), np.nan)
    return PoseTable(
        pose=(1,),
        support=("none",),
        q=q,
        q_cov=np.zeros((1, 1)),
        wrench={},
        wrench_cov={},
        torque=torque,
        torque_var=np.ones((1, 1)),
        current=np.full((1, 1), np.nan),
        current_var=np.full((1, 1), np.nan),
        com=nan3,
        com_var=nan3,
        imu=nan3,
        configuration=("",),
        tilt=np.full(1, np.nan),
        motion=motion,
    )
