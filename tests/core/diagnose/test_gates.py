# SPDX-License-Identifier: Apache-2.0
"""The gates find the channel and the poses that were spoilt, and nothing on healthy robots."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from comcal.diagnose.diagnose import diagnose
from comcal.diagnose.gates.gated import Gated
from comcal.diagnose.gates.run import gates
from comcal.measure.csv_file import format_cell
from comcal.measure.plan import PlannedPose
from comcal.measure.pose_row import approaches, pose_row
from comcal.measure.poses_csv import read_poses
from comcal.measure.source import SourceRequest
from comcal.measure.table import PoseTable
from comcal.predict.assumed import Assumed
from comcal.predict.parity import parity
from comcal.robot.changes_table import CHANNELS
from comcal.robot.model import Robot
from comcal.workflow.sources import open_source

SAMPLE_FORCE, SAMPLE_MOMENT = 0.5, 0.05
"""White noise of one sample of the simulated sensors [N], [N m]."""
SETTLE, WINDOW = 0.8, 0.21
"""As in a recording [s]."""
HEALTHY = [("builtin", seed) for seed in range(10)] + [("pybullet", 0), ("mujoco", 0)]


class Recorder:
    """Records the 14-joint robot in a world, one window for each pose of its plan."""

    def __init__(self, robot: Robot, plan: Sequence[PlannedPose], folder: Path) -> None:
        self.robot, self.plan, self.file = robot, plan, folder / "poses.csv"

    def __call__(
        self,
        *effects: str,
        source: str = "builtin",
        seed: int = 1,
        every: int = 1,
        most: int = 32,
        noise: bool = True,
    ) -> tuple[Robot, PoseTable]:
        robot, plan = self.robot, tuple(self.plan[:most:every])
        names = robot.tree.joint_names
        request = SourceRequest(robot, seed=seed, effects=effects, noise=noise, plan=plan)
        rows = []
        with open_source(source, request) as opened:
            for pose, before in zip(plan, (None, *plan[:-1]), strict=True):
                opened.move_to(pose)
                if source != "builtin":  # in plain statics nothing has to settle
                    opened.read(SETTLE)
                side = approaches(pose, before, names)
                rows.append(pose_row(pose, opened.read(WINDOW), robot, side, with_floor=False))
        lines = [",".join(rows[0]), *(",".join(map(format_cell, r.values())) for r in rows)]
        self.file.write_text("\n".join(lines) + "\n", "utf-8")
        return robot, read_poses(self.file, robot)


@pytest.fixture(scope="module")
def recorded(biped14, tmp_path_factory: pytest.TempPathFactory) -> Recorder:
    return Recorder(biped14.robot, biped14.plan, tmp_path_factory.mktemp("recorded"))


@pytest.fixture(scope="module")
def healthy(recorded: Recorder) -> tuple[Robot, PoseTable]:
    """One healthy recording for all tests that spoil it themselves, or compare with it."""
    return recorded()


def passed(robot: Robot, table: PoseTable) -> Gated:
    return gates(Assumed(robot), table)


def without_motion(table: PoseTable) -> PoseTable:
    """The same as a logger would write it that knows nothing of its windows."""
    return replace(table, motion={})


@pytest.mark.parametrize(("source", "seed"), HEALTHY)
def test_nothing_is_found_on_a_healthy_robot(recorded: Recorder, source: str, seed: int) -> None:
    pytest.importorskip(source if source != "builtin" else "numpy")
    robot, table = recorded(source=source, seed=seed, every=4, most=40)
    for read in (table, without_motion(table)):
        assert passed(robot, read).findings == ()


@pytest.mark.parametrize("source", ["builtin", "pybullet", "mujoco"])
def test_a_simulation_without_noise_is_not_suspected(recorded: Recorder, source: str) -> None:
    pytest.importorskip(source if source != "builtin" else "numpy")
    robot, table = recorded(source=source, every=6, most=40, noise=False)
    for read in (table, without_motion(table)):
        assert passed(robot, read).findings == ()


def test_numbers_rounded_to_the_decimals_of_a_file_are_no_grid(
    healthy: tuple[Robot, PoseTable],
) -> None:
    robot, table = healthy
    rounded = replace(
        table,
        q=np.round(table.q, 4),
        wrench={s: np.round(w, 2) for s, w in table.wrench.items()},
    )
    coarse = {f.target for f in passed(robot, rounded).findings}
    # Two decimals are a step of 0.01 N m, which does not matter against 0.01 N m either.
    assert coarse == set()


@pytest.mark.parametrize(
    ("effect", "channels", "poses"),
    [
        ("frozen_sensor@l_foot:poses=5", CHANNELS, (5,)),
        ("frozen_sensor@r_foot:poses=5+6+7+20+30", CHANNELS, (5, 6, 7, 20, 30)),
        ("frozen_sensor@l_foot:channels=fz,poses=9+13", ("fz",), (9, 13)),
        ("frozen_sensor@l_foot:channels=fx", ("fx",), ()),
        ("frozen_sensor@imu:poses=9+10+11", ("ax", "ay", "az"), (9, 10, 11)),
        ("frozen_sensor@l_knee:channels=i,poses=16+17+18", ("i",), (16, 17, 18)),
    ],
)
def test_frozen_readings_are_found_and_left_out(
    recorded: Recorder, effect: str, channels: tuple[str, ...], poses: tuple[int, ...]
) -> None:
    robot, table = recorded(effect)
    gated = passed(robot, table)
    (finding,) = gated.findings
    assert (finding.effect, finding.target) == ("frozen_sensor", effect[14:].split(":")[0])
    assert finding.change.words("channels") == channels
    assert finding.poses == poses
    assert (finding.change.poses() or ()) == poses
    refused = {table.pose[i] for i in missing(gated.table) - missing(table)}
    assert refused == set(poses or table.pose)


def missing(table: PoseTable) -> set[int]:
    """Rows in which any reading is missing that the robot of these tests has."""
    columns = [table.imu, table.current, table.q, *table.wrench.values()]
    there = [c[:, np.isfinite(c).any(axis=0)] for c in columns]
    gone = [c for c in table.wrench.values() if np.isnan(c).all(axis=0).any()]
    rows = set(np.flatnonzero(np.isnan(np.column_stack(there)).any(axis=1)).tolist())
    return rows | (set(range(len(table))) if gone else set())


def test_without_deviations_a_frozen_sensor_is_known_by_its_repetition(recorded: Recorder) -> None:
    robot, table = recorded("frozen_sensor@l_foot:poses=5+6+20")
    (finding,) = passed(robot, without_motion(table)).findings
    assert finding.poses == (5, 6)


def test_an_encoder_that_stays_while_its_joint_moves_is_left_out(
    healthy: tuple[Robot, PoseTable],
) -> None:
    robot, table = healthy
    k = robot.tree.joint_names.index("l_knee")
    table = replace(table, q=table.q.copy())
    row = next(i for i in range(1, 30) if np.all(table.approach[i : i + 2, k] != 0.0))
    table.q[row : row + 2, k] = table.q[row - 1, k]
    (finding,) = passed(robot, table).findings
    assert (finding.target, finding.change.words("channels")) == ("l_knee", ("q",))
    assert finding.poses == (table.pose[row], table.pose[row + 1])


def test_an_encoder_of_a_joint_that_did_not_move_may_repeat_itself(
    healthy: tuple[Robot, PoseTable],
) -> None:
    robot, table = healthy
    k = robot.tree.joint_names.index("l_shoulder")
    table = replace(table, q=table.q.copy(), approach=table.approach.copy())
    table.q[10:14, k], table.approach[10:14, k] = table.q[9, k], 0.0
    assert passed(robot, table).findings == ()


@pytest.mark.parametrize(
    ("target", "channel", "level", "noise"),
    [("r_foot", "fz", 330.0, SAMPLE_FORCE), ("l_foot", "ty", 3.0, SAMPLE_MOMENT)],
)
def test_readings_at_their_limit_are_left_out(
    recorded: Recorder,
    healthy: tuple[Robot, PoseTable],
    target: str,
    channel: str,
    level: float,
    noise: float,
) -> None:
    robot, table = recorded(f"saturation@{target}:channels={channel},level={level:g}")
    gated = passed(robot, table)
    (finding,) = gated.findings
    assert (finding.effect, finding.target) == ("saturation", target)
    assert finding.change.words("channels") == (channel,)
    assert finding.change.number("level") == pytest.approx(level)
    k = CHANNELS.index(channel)
    size = np.abs(healthy[1].wrench[target][:, k])
    assert set(finding.poses) >= ids(healthy[1], size > level - 2.0 * noise)
    assert set(finding.poses) <= ids(healthy[1], size > level - 4.0 * noise)
    assert ids(table, np.isnan(gated.table.wrench[target][:, k])) == set(finding.poses)


def ids(table: PoseTable, rows: np.ndarray) -> set[int]:
    return {table.pose[i] for i in np.flatnonzero(rows)}


@pytest.mark.parametrize(
    ("target", "channel", "step"),
    [("l_foot", "fz", 5.0), ("r_foot", "ty", 0.5), ("l_knee", "i", 0.2), ("l_knee", "q", 0.004)],
)
def test_a_coarse_channel_is_found_with_its_step_and_made_less_certain(
    recorded: Recorder, target: str, channel: str, step: float
) -> None:
    robot, table = recorded(f"quantisation@{target}:channels={channel},step={step:g}")
    gated = passed(robot, table)
    (finding,) = gated.findings
    assert (finding.effect, finding.target) == ("quantisation", target)
    assert finding.change.words("channels") == (channel,)
    assert finding.change.number("step") == pytest.approx(step, rel=1e-5)
    more = {
        "fz": lambda t: t.wrench_cov[target][:, 2, 2],
        "ty": lambda t: t.wrench_cov[target][:, 4, 4],
        "i": lambda t: t.current_var[:, robot.tree.joint_names.index(target)],
        "q": lambda t: t.q_cov[:, robot.tree.joint_names.index(target)],
    }[channel]
    np.testing.assert_allclose(more(gated.table) - more(table), step**2 / 12.0, rtol=1e-5)


def test_a_grid_that_noise_hides_is_let_pass(recorded: Recorder) -> None:
    robot, table = recorded("quantisation@l_foot:channels=fz,step=0.5", every=2)
    assert passed(robot, table).findings == ()


def test_a_grid_is_known_by_how_far_two_of_its_steps_scatter(recorded: Recorder) -> None:
    """Most windows see two steps; some see one, which was taken for a frozen sensor."""
    _, table = recorded("quantisation@l_foot:channels=fx+fy+fz,step=2")
    (finding,) = passed(recorded.robot, table).findings
    assert finding.change.words("channels") == CHANNELS[:3]
    assert finding.change.number("step") == pytest.approx(2.0)


def test_all_channels_of_a_converter_share_their_step(recorded: Recorder) -> None:
    robot, table = recorded("quantisation@imu:step=0.05")
    (finding,) = passed(robot, table).findings
    assert finding.change.words("channels") == ("ax", "ay", "az")
    assert finding.change.number("step") == pytest.approx(0.05)


def test_a_robot_that_sways_is_noticed_and_made_less_certain(recorded: Recorder) -> None:
    pytest.importorskip("mujoco")
    robot, table = recorded("not_settled:time=2", source="mujoco", every=3, most=30)
    gated = passed(robot, table)
    assert {f.effect for f in gated.findings} == {"not_settled"}
    assert gated.findings[-1].poses == ()
    assert gated.findings[-1].change.number("time") > 0.0
    more = {
        sensor: np.diagonal(gated.table.wrench_cov[sensor] - cov, axis1=1, axis2=2)
        for sensor, cov in table.wrench_cov.items()
    }
    # The sway is about the pitch axes of the ankles.
    assert any(np.all(m[:, CHANNELS.index("ty")] > 1e-4) for m in more.values())
    assert not any(m[:, CHANNELS.index("fy")].any() for m in more.values())


def test_poses_in_which_the_robot_plainly_moved_are_left_out(
    healthy: tuple[Robot, PoseTable],
) -> None:
    robot, table = healthy
    slopes = {name: v.copy() for name, v in table.motion.items()}
    slopes["slope.ft.l_foot.fx"][3] = -40.0
    gated = passed(robot, replace(table, motion=slopes))
    (finding,) = gated.findings
    assert (finding.effect, finding.poses) == ("not_settled", (table.pose[3],))
    assert np.isnan(gated.table.wrench["l_foot"][3]).all()
    assert np.isnan(gated.table.wrench["r_foot"][3]).all()
    assert np.isnan(gated.table.current[3]).all()
    assert gated.is_fit
    known = {f"qdd.{joint}": np.zeros(len(table)) for joint in robot.tree.joint_names}
    assert passed(robot, replace(table, motion={**slopes, **known})).findings == ()


def test_where_most_poses_moved_no_cause_is_looked_for(healthy: tuple[Robot, PoseTable]) -> None:
    """What moves in one pose in two is hardly still in the others."""
    robot, table = healthy
    slopes = {name: v.copy() for name, v in table.motion.items()}
    slopes["slope.ft.l_foot.fx"][::2] = -40.0
    moved = {s: w.copy() for s, w in table.wrench.items()}
    moved["l_foot"][:, 0] += 5.0
    table = replace(table, motion=slopes, wrench=moved)
    assert not passed(robot, table).is_fit
    said = diagnose(Assumed(robot), table)
    assert said.causes == ()
    assert "not looked for" in said.notes[0]
    assert "still moving" in said.sentence
    assert "no name for" not in said.sentence


def test_what_a_grid_does_to_a_reading_that_hardly_changes_is_no_fault(recorded: Recorder) -> None:
    """Rounded to 4 N, a force of 1 N is off by 1 N in every pose alike: an offset."""
    robot, table = recorded(every=3, most=40)
    shifted = {s: w.copy() for s, w in table.wrench.items()}
    for w in shifted.values():
        w[:, :3] = 4.0 * np.round(w[:, :3] / 4.0)
    still = {
        name: np.zeros_like(v) if name.startswith("sd.ft.") and name[-2] == "f" else v
        for name, v in table.motion.items()
    }
    coarse = replace(table, wrench=shifted, motion=still)
    gated = passed(robot, coarse)
    assert {f.effect for f in gated.findings} == {"quantisation"}
    assert gated.leaves["ft_bias", "l_foot", "fy"] == pytest.approx(4.0 / np.sqrt(12.0))
    assert diagnose(Assumed(robot), coarse).causes == ()


@pytest.mark.parametrize(
    "effect",
    [
        "frozen_sensor@l_foot:poses=5+30",
        "frozen_sensor@imu:poses=9+10+11+30+31",
        "frozen_sensor@l_knee:channels=i,poses=16+17+18",
        "saturation@r_foot:channels=fz,level=330",
    ],
)
def test_parity_lacks_the_rows_of_refused_readings_and_keeps_all_others(
    recorded: Recorder, effect: str
) -> None:
    robot, table = recorded(effect)
    gated = passed(robot, table)
    (finding,) = gated.findings
    before, after = parity(Assumed(robot), table), parity(Assumed(robot), gated.table)
    assert after.row == before.row
    gone = np.isfinite(before.values) & ~np.isfinite(after.values)
    assert {table.pose[i] for i in before.pose[gone]} == set(finding.poses)
    np.testing.assert_array_equal(after.values[~gone], before.values[~gone])
