# SPDX-License-Identifier: Apache-2.0
"""Parts of logs: times, compressed files, sensors that stop, stated errors and tares."""

from __future__ import annotations

import gzip
import shutil
from pathlib import Path

import numpy as np
import pytest

from comcal.errors import ConfigError, DataError
from comcal.measure.importer import Imported, import_csv
from comcal.measure.session_poses import session_poses
from comcal.measure.table import PoseTable
from comcal.robot.description import load_robot

URDF = """<robot name="swinger">
  <link name="body"><inertial><mass value="10"/><origin xyz="0 0 0.3"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="foot"><inertial><mass value="1"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><geometry><box size="0.4 0.2 0.06"/></geometry></collision></link>
  <link name="arm"><inertial><mass value="2"/><origin xyz="0.1 0 0"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="ankle" type="fixed"><parent link="body"/><child link="foot"/></joint>
  <joint name="shoulder" type="revolute"><parent link="body"/><child link="arm"/>
    <origin xyz="0 0 0.3"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" effort="9" velocity="9"/></joint>
</robot>"""
ROBOT = """format: comcal-robot/1
name: swinger
urdf: swinger.urdf
gravity: 10
sensors: {foot: {joint: ankle}, arm: {joint: shoulder}}
feet: {stand: {link: foot, sensor: foot}}
"""
MAP = """format: comcal-map/1
robot: robot.yaml
columns: {t: t, q.shoulder: q}
quasi_static: {window: 0.3 s, spread: 0.05, per_posture: 9}
"""
CHANNELS = ("fx", "fy", "fz", "tx", "ty", "tz")
T = np.arange(0.0, 10.0, 0.02)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A robot that swings its arm slowly, and a map without sensors."""
    (tmp_path / "swinger.urdf").write_text(URDF)
    (tmp_path / "robot.yaml").write_text(ROBOT)
    return tmp_path


def readings() -> dict[str, np.ndarray]:
    """Return a log in which the arm's sensor stops from 4 to 6 s."""
    rng = np.random.default_rng(7)
    q = 0.4 * np.sin(0.5 * T)
    log = {"t": T, "q": q}
    for sensor, weight, lever in (("foot", 120.0, 0.0), ("arm", -20.0, 0.1)):
        wrench = rng.normal(0.0, 0.05, (T.size, 6))
        wrench[:, 2] += weight if sensor == "foot" else weight * np.cos(q)
        wrench[:, 4] -= weight * lever
        if sensor == "foot":
            wrench[:, 4] -= 2.0 * 10.0 * 0.1 * np.cos(q)
        log |= {f"{sensor}.{c}": wrench[:, k] for k, c in enumerate(CHANNELS)}
    return log


def stop(log: dict[str, np.ndarray], sensor: str, start: float, end: float) -> None:
    held = np.flatnonzero((start - 1e-9 <= T) & (end + 1e-9 >= T))
    for c in CHANNELS:
        log[f"{sensor}.{c}"][held] = log[f"{sensor}.{c}"][held[0]]


def run(
    folder: Path,
    log: dict[str, np.ndarray],
    extra: str = "",
    *,
    between: tuple[float, float] | None = None,
    constants: str = "constants: {support: stand}\n",
) -> Imported:
    sensors = "".join(
        f"  ft.{s}.{c}: {s}.{c}\n" for s in ("foot", "arm") for c in CHANNELS if f"{s}.{c}" in log
    )
    columns = "columns:\n  t: t\n  q.shoulder: q\n" + sensors
    text = MAP.replace("columns: {t: t, q.shoulder: q}\n", columns) + constants + extra
    (folder / "map.yaml").write_text(text)
    rows = [",".join(log)] + [
        ",".join(repr(float(x)) for x in r) for r in zip(*log.values(), strict=True)
    ]
    (folder / "log.csv.gz").write_bytes(gzip.compress("\n".join(rows).encode()))
    return import_csv(
        folder / "log.csv.gz",
        folder / "map.yaml",
        folder / "out",
        quasi_static=True,
        between=between,
    )


def table_of(done: Imported) -> PoseTable:
    return session_poses(done.session, load_robot(done.session.robot_yaml))


def test_a_sensor_that_stops_loses_its_windows_and_no_other_sensor_does(folder: Path) -> None:
    log = readings()
    stop(log, "arm", 4.0, 6.0)
    done = run(folder, log)
    table = table_of(done)
    t = table.t
    stopped = (t > 4.0 - 0.16) & (t < 6.0 + 0.16)
    assert stopped.sum() >= 3
    np.testing.assert_array_equal(np.isnan(table.wrench["arm"]).all(axis=1), stopped)
    assert np.isfinite(table.wrench["foot"]).all()
    assert "arm repeats its samples for 2.0 s (1 time, longest 4.00 s to 6.00 s): masked" in (
        done.notes
    )


def test_windows_in_which_a_carrying_sensor_stops_are_not_taken(folder: Path) -> None:
    log = readings()
    stop(log, "foot", 4.0, 6.0)
    t = table_of(run(folder, log)).t
    assert not ((t > 4.0 - 0.14) & (t < 6.0 + 0.14)).any()
    assert (t < 4.0).any()
    assert (t > 6.0).any()


@pytest.mark.parametrize("length", [0.06, 0.16])
def test_short_repetitions_are_let_pass(folder: Path, length: float) -> None:
    log = readings()
    stop(log, "arm", 4.0, 4.0 + length)
    assert not any("repeats" in note for note in run(folder, log).notes)


def test_only_the_times_asked_for_are_used(folder: Path) -> None:
    done = run(folder, readings(), between=(2.0, 5.0))
    t = table_of(done).t
    assert t.min() >= 2.0
    assert t.max() < 5.0
    text = done.session.session_yaml.read_text("utf-8")
    assert "between:" in text


def test_times_outside_of_the_log_are_refused(folder: Path) -> None:
    with pytest.raises(DataError, match=r"no sample lies between 20 s and inf s.*0 s to 9.98 s"):
        run(folder, readings(), between=(20.0, np.inf))
    assert not (folder / "out").exists()


def test_a_stated_error_comes_on_top_of_that_of_a_window(folder: Path) -> None:
    log = readings()
    plain = table_of(run(folder, log))
    shutil.rmtree(folder / "out")
    more = "constants: {support: stand, se.ft.arm.fz: 3 N, se.q.shoulder: 2 deg}\n"
    stated = table_of(run(folder, log, constants=more))
    before, after = (x.wrench_cov["arm"][:, 2, 2] for x in (plain, stated))
    np.testing.assert_allclose(after - before, 9.0, rtol=1e-3)
    np.testing.assert_allclose(stated.q_cov - plain.q_cov, np.radians(2.0) ** 2, rtol=1e-3)


def test_tares_of_the_map_are_subtracted_once_and_their_error_is_shared(folder: Path) -> None:
    log = readings()
    log["foot.fz"] = log["foot.fz"] + 200.0
    extra = "tares:\n  foot: {value: [0, 0, 0.2 kN, 0, 0, 0], sigma: [0, 0, 5 N, 0, 0, 0]}\n"
    table = table_of(run(folder, log, extra))
    np.testing.assert_allclose(table.wrench["foot"][:, 2], 120.0, atol=0.2)
    np.testing.assert_allclose(np.diag(table.tare_cov["foot"]), [0, 0, 25.0, 0, 0, 0])


@pytest.mark.parametrize(
    ("tare", "words"),
    [
        ("fot: {value: [0,0,0,0,0,0], sigma: [0,0,0,0,0,0]}", "no sensor or plate"),
        ("foot: {value: [0,0,0], sigma: [0,0,0,0,0,0]}", "six numbers"),
        ("foot: {value: [0,0,0,0,0,0], sigma: [0,0,-1,0,0,0]}", "never negative"),
        ("foot: {value: [0,0,0,0,0,0]}", "sigma"),
    ],
)
def test_wrong_tares_are_refused(folder: Path, tare: str, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        run(folder, readings(), f"tares:\n  {tare}\n")


def test_a_damaged_compressed_file_is_refused(folder: Path) -> None:
    run(folder, readings())
    packed = (folder / "log.csv.gz").read_bytes()
    (folder / "log.csv.gz").write_bytes(packed[: len(packed) // 2])
    with pytest.raises(DataError, match="is compressed, and damaged"):
        import_csv(folder / "log.csv.gz", folder / "map.yaml", folder / "again")
