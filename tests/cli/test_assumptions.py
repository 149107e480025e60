# SPDX-License-Identifier: Apache-2.0
"""``comcal solve --prior`` and ``--consistent``: beside the measured result, never in it."""

from __future__ import annotations

import json
import shutil
import sys
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path

import jsonschema
import pytest

from comcal.cli.main import main
from comcal_sims.robots import table1

SCHEMA = json.loads(files("comcal.report").joinpath("result.schema.json").read_text("utf-8"))
needs_solver = pytest.mark.skipif(not find_spec("clarabel"), reason="no clarabel: comcal[identify]")


def outlined(link: str, x: float, size: float, urdf: str) -> str:
    """The URDF with a box around the CoM of a link, and its middle at x."""
    collision = (
        f'<collision><origin xyz="{x} 0 -0.1"/><geometry><box size="{size} 1 1"/></geometry>'
        "</collision>"
    )
    assert f'<link name="{link}">' in urdf
    return urdf.replace(f'<link name="{link}">', f'<link name="{link}">{collision}')


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("assumed")
    robot = table1.generate(folder / "robot", r_b=0.01, r_c=-0.02)
    arguments = ["record", str(robot), "-s", str(folder / "s"), "--source", "builtin"]
    assert main([*arguments, "--seed", "7"]) == 0
    return folder / "s"


def with_urdf(session: Path, to: Path, urdf: str) -> Path:
    """A session made by hand from every other of the same poses, with another URDF."""
    to.mkdir()
    shutil.copy(session / "robot.yaml", to)
    header, *poses = (session / "poses.csv").read_text("utf-8").splitlines()
    (to / "poses.csv").write_text("\n".join([header, *poses[::2], ""]), encoding="utf-8")
    (to / "table1.urdf").write_text(urdf, encoding="utf-8")
    return to


def solved(session: Path, capsys: pytest.CaptureFixture[str], *options: str) -> dict:
    capsys.readouterr()
    assert main(["solve", str(session), "--json", *options]) in (0, 3)
    return json.loads(capsys.readouterr().out)


@needs_solver
@pytest.mark.parametrize("more", [(), ("--free-masses",)])
def test_what_is_measured_does_not_depend_on_what_is_assumed(
    more: tuple[str, ...], session: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    alone = solved(session, capsys, *more)
    both = solved(session, capsys, "--prior", "1", "--consistent", *more)
    jsonschema.validate(both, SCHEMA)
    assert alone.pop("with_prior") is None
    assert alone.pop("consistent") is None
    prior, consistent = both.pop("with_prior"), both.pop("consistent")
    assert both == alone
    assert prior["strength"] == 1.0
    assert not prior["contradict"]
    for link in prior["links"]:
        for share, source in zip(link["prior_share"], link["source"], strict=True):
            assert source == ("prior" if share > 0.1 else "measured")
    assert consistent["feasible"]


@needs_solver
def test_an_export_is_the_same_after_a_prior(
    session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    texts = []
    for name, options in (("a", ()), ("b", ("--prior", "50", "--consistent"))):
        solved(session, capsys, *options)
        out = tmp_path / f"{name}.urdf"
        assert main(["export", str(session), "--urdf", str(out)]) == 0
        texts.append(out.read_bytes())
    assert texts[0] == texts[1]


def test_every_number_of_the_prior_says_so(
    session: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["solve", str(session), "--prior", "50"]) == 0
    out = capsys.readouterr().out
    block = out.split("Data and CAD together")[1].split("Verdict")[0]
    assert "strength 50" in block
    rows = [line for line in block.splitlines() if line.startswith(("l_shin", "r_thigh", "waist"))]
    assert rows
    assert all(row.count("prior)") == 3 for row in rows)
    assert "none of this table is exported" in " ".join(block.split())
    assert all(len(line) <= 100 for line in block.splitlines() if not line.startswith("wrote"))


@needs_solver
def test_a_box_that_the_data_contradict_is_named(
    session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    urdf = (session / "table1.urdf").read_text("utf-8")
    # As believed, the CoM of the waist is 30 mm in front of where it is, and the box ends between.
    link = urdf.index('<link name="waist">')
    start = urdf.index("xyz=", link)
    end = urdf.index('"', start + 5)
    x, y, z = (float(v) for v in urdf[start + 5 : end].split())
    moved = f"{urdf[: start + 5]}{x + 0.03} {y} {z}{urdf[end:]}"
    other = with_urdf(session, tmp_path / "s", outlined("waist", x + 0.03, 0.02, moved))
    described = other / "robot.yaml"  # with currents the waist is seen well enough
    trusted = f"{described.read_text('utf-8')}\ntolerances: {{joint_friction: 0.0}}\n"
    described.write_text(trusted, "utf-8")
    consistent = solved(other, capsys, "--consistent")["consistent"]
    assert consistent["contradicted"]
    words = consistent["active"][0]["bound"]
    assert words.startswith("waist CoM x at its lower bound")
    assert main(["solve", str(other), "--consistent", "--method", "lstsq"]) in (0, 5)
    out = " ".join(capsys.readouterr().out.split())
    assert f"the data CONTRADICT this bound: {words}" in out
    assert "l_shin" in out.split("not bounded: ")[1].split(" no box")[0]


@needs_solver
def test_no_possible_robot_is_exit_3_and_says_why(
    session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    urdf = (session / "table1.urdf").read_text("utf-8")
    extra = (
        '<link name="balloon"><inertial><mass value="-0.0001"/>'
        '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        '<joint name="string" type="fixed"><parent link="waist"/><child link="balloon"/></joint>'
    )
    other = with_urdf(session, tmp_path / "s", urdf.replace("</robot>", f"{extra}</robot>"))
    assert main(["solve", str(other), "--consistent"]) == 3
    out = capsys.readouterr().out
    assert "these bounds contradict one another" in out
    assert "balloon mass, given as -0.0001 kg, has to be positive" in out


def test_without_the_solver_nothing_is_written_and_the_line_to_type_is_said(
    session: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "clarabel", None)
    before = sorted((session / "results").iterdir()) if (session / "results").exists() else []
    assert main(["solve", str(session), "--consistent"]) == 6
    assert "pip install 'comcal[identify]'" in capsys.readouterr().err
    after = sorted((session / "results").iterdir()) if (session / "results").exists() else []
    assert before == after
    assert main(["solve", str(session), "--prior", "1"]) == 0


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--prior", "0"), "positive number"),
        (("--prior", "nan"), "positive number"),
        (("--prior", "1", "--method", "cramer"), "all-data route"),
    ],
)
def test_what_cannot_be_assumed_is_refused(
    options: tuple[str, ...],
    words: str,
    session: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["solve", str(session), *options]) == 2
    assert words in capsys.readouterr().err
