# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from comcal.errors import (
    ComcalError,
    ConfigError,
    DataError,
    MissingColumnError,
    NotBalancedError,
    NotFiniteError,
    NotStillError,
    SignError,
    UnitsError,
)
from comcal.measure.importer import import_csv
from comcal.measure.map_file import unit_factor
from comcal.measure.poses_csv import read_poses
from comcal.measure.session import create_session
from comcal.measure.session_poses import session_poses
from comcal.robot.description import load_robot

URDF = """<robot name="bower">
  <link name="foot"><inertial><mass value="2"/><origin xyz="0 0 0.03"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><geometry><box size="0.4 0.2 0.06"/></geometry></collision></link>
  <link name="leg"><inertial><mass value="20"/><origin xyz="0 0 0.4"/>
    <inertia ixx="1" iyy="1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="torso"><inertial><mass value="30"/><origin xyz="0 0 0.3"/>
    <inertia ixx="1" iyy="1" izz="0.3" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="ankle" type="revolute"><parent link="foot"/><child link="leg"/>
    <origin xyz="0 0 0.06"/><axis xyz="0 1 0"/>
    <limit lower="-0.8" upper="0.8" effort="100" velocity="1"/></joint>
  <joint name="hip" type="revolute"><parent link="leg"/><child link="torso"/>
    <origin xyz="0 0 0.8"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="2" effort="100" velocity="1"/></joint>
</robot>"""
ROBOT = """format: comcal-robot/1
name: bower
urdf: bower.urdf
gravity: 10
feet: {stand: {link: foot}}
plates: {floor: {frame: foot, feet: [stand]}}
"""
MAP = """format: comcal-map/1
robot: robot.yaml
columns:
  t: {column: ms, unit: ms}
  q.ankle: {column: ankle, unit: deg, sign: -1}
  q.hip: {column: hip, unit: deg, offset: 2 deg}
  ft.floor.fz: {column: F, unit: kN}
  ft.floor.ty: {column: M, unit: N cm}
constants: {support: stand}
"""


def pressure(ankle: np.ndarray, hip: np.ndarray) -> np.ndarray:
    """Return x of the CoM over all masses [m]: a plane chain by hand."""
    x_leg = 0.4 * np.sin(ankle)
    x_torso = 0.8 * np.sin(ankle) + 0.3 * np.sin(ankle + hip)
    return (20 * x_leg + 30 * x_torso) / 52


def log_text(t: np.ndarray, ankle: np.ndarray, hip: np.ndarray) -> str:
    moment = -520.0 * pressure(ankle, hip)
    lines = ["# a logger", "ms,ankle,hip,F,M,state"]
    for i in range(t.size):
        state = int(t[i] // 1.0) if t[i] % 1.0 > 0.3 else ""
        lines.append(
            f"{1e3 * t[i]!r},{-np.degrees(ankle[i])!r},{np.degrees(hip[i]) - 2!r},0.52,"
            f"{100 * moment[i]!r},{state}".replace("np.float64(", "").replace(")", "")
        )
    return "\n".join(lines) + "\n"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A robot, a map and a log of three postures, one second each."""
    (tmp_path / "bower.urdf").write_text(URDF)
    (tmp_path / "robot.yaml").write_text(ROBOT)
    (tmp_path / "map.yaml").write_text(MAP)
    t = np.arange(0.0, 3.0, 0.02)
    posture = np.floor(t)
    (tmp_path / "log.csv").write_text(log_text(t, 0.02 - 0.02 * posture, 0.1 * posture))
    return tmp_path


def run(folder: Path, extra: str = "", *, quasi_static: bool = False, out: str = "out"):
    (folder / "map.yaml").write_text((folder / "map.yaml").read_text() + extra)
    return import_csv(
        folder / "log.csv", folder / "map.yaml", folder / out, quasi_static=quasi_static
    )


def test_declared_windows_become_poses_in_si(folder: Path) -> None:
    done = run(folder, "windows: [[0.2, 0.9], [1.2, 1.9], [2200 ms, 2.9]]\n")
    robot = load_robot(done.session.robot_yaml)
    table = session_poses(done.session, robot)
    assert table.pose == (1, 2, 3)
    np.testing.assert_allclose(table.q, [[0.02, 0.0], [0.0, 0.1], [-0.02, 0.2]], atol=1e-12)
    np.testing.assert_allclose(table.wrench["floor"][:, 2], 520.0)
    np.testing.assert_allclose(
        table.wrench["floor"][:, 4], -520.0 * pressure(table.q[:, 0], table.q[:, 1])
    )
    assert done.session.metadata["source"] == "import"
    assert {"log.csv", "map.yaml", "robot.yaml", "bower.urdf"} <= set(
        done.session.metadata["sha256"]  # type: ignore[arg-type]
    )


def test_rows_of_equal_number_become_one_pose(folder: Path) -> None:
    done = run(folder, "pose_ids: state\n")
    table = read_poses(done.session.poses_csv, load_robot(done.session.robot_yaml))
    assert table.pose == (0, 1, 2)
    np.testing.assert_allclose(table.q[:, 1], [0.0, 0.1, 0.2], atol=1e-12)


def test_every_row_is_a_pose_when_nothing_else_is_said(folder: Path) -> None:
    table = read_poses(run(folder).session.poses_csv, load_robot(folder / "robot.yaml"))
    assert len(table) == 150
    assert table.pose[:3] == (1, 2, 3)


def test_averaged_noise_comes_with_its_standard_error(folder: Path) -> None:
    generator = np.random.default_rng(4)
    t = np.arange(0.0, 3.0, 0.001)
    lines = ["ms,ankle,hip,F,M,state"]
    lines += [f"{1e3 * x:.6f},0,-2,{0.52 + 0.002 * generator.normal():.9f},0," for x in t]
    (folder / "log.csv").write_text("\n".join(lines) + "\n")
    done = run(folder, "windows: [[0, 1], [1, 2], [2, 3]]\n")
    table = session_poses(done.session, load_robot(done.session.robot_yaml))
    sigma = np.sqrt(table.wrench_cov["floor"][:, 2, 2])
    np.testing.assert_allclose(sigma, 2.0 / np.sqrt(1000), rtol=0.2)
    assert np.abs(table.wrench["floor"][:, 2] - 520.0).max() < 4 * sigma[0]


@pytest.mark.parametrize(
    ("old", "new", "error", "words"),
    [
        ("q.ankle:", "q.ankel:", ConfigError, r"map\.yaml:5.*did you mean 'q\.ankle'"),
        ("column: ankle", "column: ankl", MissingColumnError, r"map\.yaml:5.*did you mean 'ankle'"),
        ("unit: deg, sign", "unit: mm, sign", ConfigError, r"map\.yaml:5.*not a unit of angle"),
        ("sign: -1", "sgn: -1", ConfigError, r"map\.yaml:5.*did you mean 'sign'"),
        ("sign: -1", "sign: 2", ConfigError, r"map\.yaml:5"),
        ("format: comcal-map/1", "format: comcal-map/9", ConfigError, r"map\.yaml:1"),
        ("support: stand", "support: stand, q.hip: 1", ConfigError, "mapped to a column and"),
        ("support: stand", "suport: stand", ConfigError, "did you mean 'support'"),
        ("constants: {support: stand}", "", MissingColumnError, "column support is absent"),
        ("support: stand", "support: left", DataError, r"log\.csv:3.*not one of"),
        ("robot: robot.yaml", "", ConfigError, "'robot' is missing"),
        ("robot: robot.yaml", "robot: no.yaml", ConfigError, "no such file"),
        ("unit: deg, offset: 2 deg", "offset: 2 deg", UnitsError, r"log\.csv.*q\.hip.*degrees"),
        ("unit: kN", "unit: kN, sign: -1", SignError, "pulls the feet down"),
        ("unit: N cm", "unit: N m", UnitsError, "moments look like N cm"),
        ("unit: kN", "unit: kgf", NotBalancedError, "carry the robot's weight"),
    ],
)
def test_a_wrong_map_is_refused_and_leaves_nothing(
    folder: Path, old: str, new: str, error: type[ComcalError], words: str
) -> None:
    text = (folder / "map.yaml").read_text()
    assert old in text
    (folder / "map.yaml").write_text(text.replace(old, new))
    before = sorted(folder.iterdir())
    with pytest.raises(error, match=words):
        import_csv(folder / "log.csv", folder / "map.yaml", folder / "out")
    assert sorted(folder.iterdir()) == before


@pytest.mark.parametrize(
    ("extra", "error", "words"),
    [
        ("windows: [[0, 1], [0.5, 2]]\n", ConfigError, "overlaps another"),
        ("windows: [[1, 1]]\n", ConfigError, "no length"),
        ("windows: []\n", ConfigError, "no window"),
        ("windows: [[8, 9]]\n", DataError, "too few samples"),
        ("windows: [[0, 1]]\npose_ids: state\n", ConfigError, "two ways"),
        ("pose_ids: stat\n", MissingColumnError, "did you mean 'state'"),
        ("windows: [[0.5, 1.5]]\n", NotStillError, "says that the robot moved"),
    ],
)
def test_a_wrong_choice_of_windows_is_refused(
    folder: Path, extra: str, error: type[ComcalError], words: str
) -> None:
    if error is NotStillError:
        t = np.arange(0.0, 3.0, 0.02)
        (folder / "log.csv").write_text(log_text(t, 0.0 * t, 0.2 * t))
    with pytest.raises(error, match=words):
        run(folder, extra)
    assert not (folder / "out").exists()


@pytest.mark.parametrize(
    ("text", "error"), [("nan", NotFiniteError), ("", NotFiniteError), ("x", DataError)]
)
def test_a_bad_cell_is_named_by_the_line_of_the_log(
    folder: Path, text: str, error: type[ComcalError]
) -> None:
    lines = (folder / "log.csv").read_text().splitlines()
    cells = lines[20].split(",")
    cells[2] = text
    lines[20] = ",".join(cells)
    (folder / "log.csv").write_text("\n".join(lines) + "\n")
    with pytest.raises(error, match=r"log\.csv:21"):
        run(folder, "windows: [[0.2, 0.9]]\n")


def test_nothing_that_exists_is_overwritten(folder: Path) -> None:
    (folder / "out").mkdir()
    (folder / "out" / "mine").write_text("mine")
    with pytest.raises(ConfigError, match="exists already"):
        run(folder)
    assert (folder / "out" / "mine").read_text() == "mine"
    run(folder, out="new")
    with pytest.raises(ConfigError, match="exists already"):
        run(folder, out="new")


def test_an_imported_session_is_a_session(folder: Path) -> None:
    done = run(folder)
    again = create_session(
        done.session.directory, load_robot(done.session.robot_yaml), source="import"
    )
    assert len(again.finished_poses()) == done.poses


def slow_bow(folder: Path) -> np.ndarray:
    t = np.arange(0.0, 12.0, 0.02)
    hip = 0.4 - 0.4 * np.cos(0.8 * t)
    (folder / "log.csv").write_text(log_text(t, 0.0 * t, hip))
    return t


def test_a_slow_motion_becomes_poses_with_the_error_of_its_inertia(folder: Path) -> None:
    slow_bow(folder)
    done = run(folder, "quasi_static: {window: 0.3 s, spread: 0.1}\n", quasi_static=True)
    robot = load_robot(done.session.robot_yaml)
    table = session_poses(done.session, robot)
    assert np.ptp(table.q[:, 1]) > 0.6
    acceleration = 0.4 * 0.8**2
    expected = (1.0 + 30 * 0.3**2 + 30 * 0.3 * 0.86) * acceleration  # at the upright posture
    sigma = np.sqrt(table.wrench_cov["floor"][:, 4, 4])
    assert (sigma < expected).all()
    assert (sigma > 0.1 * expected).all()
    assert any("quasi-static" in note for note in done.notes)


def test_measured_accelerations_are_preferred_to_differentiated_ones(folder: Path) -> None:
    t = slow_bow(folder)
    lines = (folder / "log.csv").read_text().splitlines()
    header, rows = lines[1] + ",qd1,qdd1,qd2,qdd2", lines[2:]
    lines = [header, *(f"{row},0,0,0,200" for row in rows)]
    (folder / "log.csv").write_text("\n".join(lines) + "\n")
    assert len(rows) == t.size
    text = (folder / "map.yaml").read_text()
    extra = (
        "  qd.ankle: qd1\n  qdd.ankle: qdd1\n  qd.hip: qd2\n"
        "  qdd.hip: {column: qdd2, unit: deg/s^2}\n"
    )
    (folder / "map.yaml").write_text(text.replace("constants", extra + "constants"))
    table = session_poses(run(folder, quasi_static=True).session, load_robot(folder / "robot.yaml"))
    qdd = np.radians(200.0)
    shape = table.q[:, 1]
    moment = (1.0 + 30 * (0.09 + 0.3 * 0.86 * np.cos(shape))) * qdd
    rms = np.sqrt(np.mean(moment**2))
    assert np.sqrt(table.wrench_cov["floor"][0, 4, 4]) == pytest.approx(rms, rel=0.02)


@pytest.mark.parametrize(
    ("extra", "words"),
    [
        ("windows: [[0, 1]]\n", "none may be declared"),
        ("quasi_static: {windw: 1}\n", "did you mean 'window'"),
        ("quasi_static: {window: 99 s}\n", "shorter than one window"),
    ],
)
def test_a_wrong_quasi_static_map_is_refused(folder: Path, extra: str, words: str) -> None:
    with pytest.raises(ComcalError, match=words):
        run(folder, extra, quasi_static=True)


def test_a_chain_without_urdf_is_imported_in_degrees_and_millimetres(tmp_path: Path) -> None:
    (tmp_path / "robot.yaml").write_text(
        "format: comcal-robot/1\nname: chain\n"
        "chain: [{name: a, axis: x}, {name: b, parent: a, axis: x}]\n"
    )
    (tmp_path / "map.yaml").write_text(
        "format: comcal-map/1\nrobot: robot.yaml\ncolumns:\n  pose: no\n"
        "  q.a: {column: a_deg, unit: deg}\n  q.b: {column: b_deg, unit: °}\n"
        "  com.x: {column: x_mm, unit: mm}\nconstants: {support: double}\n"
    )
    (tmp_path / "log.csv").write_text("no,a_deg,b_deg,x_mm\n4,30,-90,107\n7,0,180,-23\n")
    done = import_csv(tmp_path / "log.csv", tmp_path / "map.yaml", tmp_path / "out")
    table = session_poses(done.session, load_robot(done.session.robot_yaml))
    assert table.pose == (4, 7)
    np.testing.assert_allclose(table.q, np.radians([[30, -90], [0, 180]]))
    np.testing.assert_allclose(table.com[:, 0], [0.107, -0.023])
    with pytest.raises(ConfigError, match="chain without URDF"):
        import_csv(tmp_path / "log.csv", tmp_path / "map.yaml", tmp_path / "two", quasi_static=True)


@pytest.mark.parametrize(
    ("unit", "si", "factor"),
    [
        ("deg", "rad", np.pi / 180),
        ("deg/s", "rad/s", np.pi / 180),
        ("deg/s^2", "rad/s^2", np.pi / 180),
        ("mm/s", "m/s", 1e-3),
        ("mm/s^2", "m/s^2", 1e-3),
        ("N cm", "N*m", 1e-2),
        ("mA", "A", 1e-3),
        ("°C", "degC", 1.0),
        ("kgf", "N", 9.80665),
    ],
)
def test_units_are_converted(unit: str, si: str, factor: float) -> None:
    assert unit_factor(unit, si) == pytest.approx(factor)


@pytest.mark.parametrize(("unit", "si"), [("deg", "m"), ("K", "degC"), ("deg", "rad/s")])
def test_a_unit_of_another_kind_is_refused(unit: str, si: str) -> None:
    with pytest.raises(ConfigError, match="not a unit"):
        unit_factor(unit, si)


QUICK = settings(
    deadline=None,
    max_examples=40,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
values = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5)


@QUICK
@given(
    st.dictionaries(
        st.sampled_from(["format", "robot", "columns", "constants", "windows", "pose_ids", "x"]),
        st.recursive(
            values,
            lambda inner: (
                st.lists(inner, max_size=3)
                | st.dictionaries(
                    st.sampled_from(["t", "q.hip", "column", "unit", "window", "support"]), inner
                )
            ),
            max_leaves=6,
        ),
    )
)
def test_rubbish_maps_are_refused_in_our_own_words(
    folder: Path, content: Mapping[str, object]
) -> None:
    import json

    (folder / "rubbish.yaml").write_text(json.dumps({"format": "comcal-map/1"} | dict(content)))
    with pytest.raises(ComcalError):
        import_csv(folder / "log.csv", folder / "rubbish.yaml", folder / "never")
    assert not (folder / "never").exists()


@QUICK
@given(data=st.data())
def test_damaged_logs_are_refused_in_our_own_words(folder: Path, data: st.DataObject) -> None:
    content = bytearray((folder / "log.csv").read_bytes())
    place = data.draw(st.integers(0, len(content) - 1))
    content[place : place + 4] = data.draw(st.binary(max_size=4))
    (folder / "damaged.csv").write_bytes(bytes(content))
    number = sum(path.name.startswith("out") for path in folder.iterdir())
    try:
        import_csv(folder / "damaged.csv", folder / "map.yaml", folder / f"out{number}")
    except ComcalError:
        assert not (folder / f"out{number}").exists()
