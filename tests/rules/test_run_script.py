# SPDX-License-Identifier: Apache-2.0
"""``./run`` finds a Python, makes the environment once, and says what is missing.

A made-up Python stands in for the real one: it makes an environment whose own Python only writes
down what it is asked to install, so nothing here needs the network or takes long.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPTS = ("run", ".ci/run", ".ci/full", ".ci/stages.sh")

FAKE_PYTHON = r"""#!/bin/sh
log=$LOG
case "$*" in
    *"sys.version_info < (3, 10)"*) exit "${TOO_OLD:-0}" ;;
    *"import ensurepip, venv"*) exit "${LACKS_VENV:-0}" ;;
    *sys.base_prefix*) echo "${VERSION:-3.11.2} /usr" ;;
    *venv%d*|*"%d.%d-venv"*) echo "python3.11-venv" ;;
    "-m venv --clear "*)
        printf 'venv\n' >>"$log"
        rm -rf "$4"
        mkdir -p "$4/bin"
        : >"$4/pyvenv.cfg"
        cp "$0" "$4/bin/python"
        printf '#!/bin/sh\nprintf "comcal:%%s\\n" "$*"; pwd\n' >"$4/bin/comcal"
        chmod +x "$4/bin/comcal"
        ;;
    "-m pip --version") ;;
    "-m pytest "*) echo "bytecode: ${PYTHONDONTWRITEBYTECODE-kept} in $PYTHONPYCACHEPREFIX" ;;
    "-m pip install"*uv) exit 1 ;;
    "-m pip install"*)
        for last; do :; done
        printf 'install %s\n' "${last##*/}" >>"$log"
        case "${last##*/}" in *"${FAILING:-nothing}"*) echo "no wheel"; exit 1 ;; esac
        ;;
    *) exit 3 ;;
esac
"""

TOOLS = "sh cat sed date mktemp touch mv rm cp mkdir find ls tail tr dirname readlink flock chmod"


class Checkout:
    """A copy of ``run`` in a folder with a blank in its name, and a PATH with one Python."""

    def __init__(self, folder: Path, root: Path) -> None:
        self.top = folder / "my robots" / "comcal"
        self.path = folder / "path"
        self.log = folder / "log"
        self.top.mkdir(parents=True)
        self.path.mkdir()
        self.log.touch()
        for name in ("run", "pyproject.toml"):
            shutil.copy2(root / name, self.top / name)
        (self.path / "python3").write_text(FAKE_PYTHON)
        (self.path / "python3").chmod(0o755)
        # Beside it the tools of a POSIX system, and no other Python.
        for tool in TOOLS.split():
            if where := shutil.which(tool):
                (self.path / tool).symlink_to(where)

    def environment(self, **changes: str) -> dict[str, str]:
        here = {"PATH": str(self.path), "LOG": str(self.log), "TMPDIR": str(self.path.parent)}
        return {**here, **changes}

    def run(
        self, *words: str, script: Path | None = None, cwd: Path | None = None, **changes: str
    ) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [str(script or self.top / "run"), *words],
            cwd=cwd or self.top,
            env=self.environment(**changes),
            capture_output=True,
            text=True,
            timeout=60,
        )

    def logged(self) -> list[str]:
        lines = self.log.read_text().splitlines()
        self.log.write_text("")
        return lines


@pytest.fixture
def checkout(tmp_path: Path, root: Path) -> Checkout:
    return Checkout(tmp_path, root)


def test_first_run_makes_the_environment_and_the_next_does_not(checkout: Checkout) -> None:
    first = checkout.run("comcal", "solve", "my data")
    assert first.returncode == 0, first.stderr
    assert first.stdout.splitlines()[0] == "comcal:solve my data"
    assert checkout.logged() == ["venv", "install comcal[sim,mujoco]"]
    assert checkout.run("demo").returncode == 0
    assert checkout.logged() == []


def test_environment_is_renewed_when_pyproject_is_newer(checkout: Checkout) -> None:
    checkout.run("demo")
    checkout.logged()
    later = (checkout.top / ".venv" / ".comcal-stamp").stat().st_mtime + 10
    os.utime(checkout.top / "pyproject.toml", (later, later))
    checkout.run("demo")
    assert checkout.logged() == ["install comcal[sim,mujoco]"]


def test_environment_is_made_anew_when_the_python_changed(checkout: Checkout) -> None:
    checkout.run("demo")
    checkout.logged()
    assert checkout.run("demo", VERSION="3.13.0").returncode == 0
    assert checkout.logged() == ["venv", "install comcal[sim,mujoco]"]


def test_extras_of_an_earlier_word_are_kept(checkout: Checkout) -> None:
    checkout.run("setup")
    every = "sim,mujoco,identify,plan,can,mf4,ros,test,lint"
    assert checkout.logged() == ["venv", f"install comcal[{every}]"]
    checkout.run("demo")
    assert checkout.logged() == []


def test_runs_in_the_callers_folder_through_a_link(checkout: Checkout, tmp_path: Path) -> None:
    (tmp_path / "hop").symlink_to(checkout.top / "run")
    link = tmp_path / "bin" / "comcal-run"
    link.parent.mkdir()
    link.symlink_to("../hop")
    run = checkout.run("comcal", "check", script=link, cwd=tmp_path)
    assert run.stdout.splitlines() == ["comcal:check", str(tmp_path)], run.stderr
    assert (checkout.top / ".venv").is_dir()


def test_environment_can_lie_elsewhere(checkout: Checkout, tmp_path: Path) -> None:
    checkout.run("demo", cwd=tmp_path, COMCAL_VENV="other env")
    assert (tmp_path / "other env" / ".comcal-stamp").is_file()
    assert not (checkout.top / ".venv").exists()


def test_folder_that_is_no_environment_is_not_touched(checkout: Checkout, tmp_path: Path) -> None:
    precious = tmp_path / "home" / "thesis.tex"
    precious.parent.mkdir()
    precious.write_text("x")
    run = checkout.run("demo", COMCAL_VENV=str(precious.parent))
    assert run.returncode == 2
    assert "not a virtual environment" in run.stderr
    assert precious.read_text() == "x"


def test_extra_that_cannot_be_had_is_left_out_aloud_and_not_retried(checkout: Checkout) -> None:
    run = checkout.run("demo", FAILING="sim")
    assert run.returncode == 0
    assert "'sim' could not be installed" in run.stderr
    assert "no wheel" in run.stderr
    assert checkout.logged()[-1] == "install comcal[mujoco]"
    checkout.run("demo")
    assert checkout.logged() == []


def test_tests_without_their_extra_exit_6(checkout: Checkout) -> None:
    run = checkout.run("test", FAILING="test")
    assert run.returncode == 6
    assert "'test' is needed" in run.stderr


def test_what_the_tests_compile_is_kept_in_the_environment(checkout: Checkout) -> None:
    """The hundreds of programs that they start take half as long; the sources stay as they are."""
    run = checkout.run("test", PYTHONDONTWRITEBYTECODE="1")
    assert run.stdout == f"bytecode: kept in {checkout.top}/.venv/pycache\n", run.stderr


def test_missing_venv_module_names_the_line_to_type(checkout: Checkout) -> None:
    run = checkout.run("demo", LACKS_VENV="1")
    assert run.returncode == 6
    assert run.stderr.rstrip().endswith("type: sudo apt-get install python3-venv")
    assert checkout.logged() == []


def test_missing_venv_module_of_a_versioned_python_names_its_package(checkout: Checkout) -> None:
    (checkout.path / "python3").rename(checkout.path / "python3.11")
    run = checkout.run("demo", LACKS_VENV="1")
    assert run.returncode == 6
    assert run.stderr.rstrip().endswith("type: sudo apt-get install python3.11-venv")


def test_no_python_new_enough_names_the_line_to_type(checkout: Checkout) -> None:
    run = checkout.run("demo", TOO_OLD="1")
    assert run.returncode == 6
    assert "sudo apt-get install python3 python3-venv" in run.stderr


def test_python_that_was_named_must_be_new_enough(checkout: Checkout) -> None:
    run = checkout.run("demo", COMCAL_PYTHON="python2")
    assert run.returncode == 2
    assert "COMCAL_PYTHON=python2" in run.stderr


def test_unknown_word_is_refused_with_a_way_on(checkout: Checkout) -> None:
    run = checkout.run("solve", "DIR")
    assert run.returncode == 2
    assert "./run comcal solve" in run.stderr
    assert checkout.logged() == []


def test_two_at_once_install_once(checkout: Checkout) -> None:
    if not shutil.which("flock"):
        pytest.skip("no flock here: util-linux has it")
    both = [
        subprocess.Popen(
            [str(checkout.top / "run"), "demo"],
            env=checkout.environment(),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        )
        for _ in range(2)
    ]
    for process in both:
        process.communicate(timeout=60)
    assert [process.returncode for process in both] == [0, 0]
    assert checkout.logged() == ["venv", "install comcal[sim,mujoco]"]


def test_run_is_executable(root: Path) -> None:
    assert os.access(root / "run", os.X_OK)


def test_shell_scripts_pass_shellcheck(root: Path) -> None:
    beside = Path(sys.executable).parent / "shellcheck"
    shellcheck = str(beside) if beside.exists() else shutil.which("shellcheck")
    if shellcheck is None:
        pytest.skip("no shellcheck: ./run setup has it")
    run = subprocess.run(
        [shellcheck, "--external-sources", *SCRIPTS], cwd=root, capture_output=True, text=True
    )
    assert run.returncode == 0, run.stdout
