# SPDX-License-Identifier: Apache-2.0
"""At least one physics engine has to be there; and engines are imported in silence.

The engines' own tests are skipped where theirs is missing. Were both missing, nothing but this
file would notice that no simulation was tested.
"""

from __future__ import annotations

import os
import subprocess
import sys
from importlib.util import find_spec

import pytest

from comcal.errors import MissingExtraError
from comcal_sims.engines import import_engine, silenced


def test_at_least_one_physics_engine_is_importable() -> None:
    found = [engine for engine in ("pybullet", "mujoco") if find_spec(engine) is not None]
    assert found, "neither pybullet nor mujoco is installed: pip install 'comcal[sim,mujoco]'"


def test_missing_engine_names_the_extra_to_install() -> None:
    with pytest.raises(MissingExtraError, match=r"comcal\[mujoco\]") as caught:
        import_engine("no_such_engine", "mujoco")
    assert caught.value.exit_code == 6


def test_silence_ends_with_the_block_even_on_error(capfd: pytest.CaptureFixture[str]) -> None:
    def fail_noisily() -> None:
        with silenced():
            os.write(1, b"hidden")
            os.write(2, b"hidden")
            raise RuntimeError

    os.write(1, b"before ")
    with pytest.raises(RuntimeError):
        fail_noisily()
    os.write(1, b"after")
    assert capfd.readouterr() == ("before after", "")


@pytest.mark.engine
def test_pybullet_says_nothing_on_its_way_in_and_out() -> None:
    pytest.importorskip("pybullet")
    code = (
        "from comcal_sims.engines import import_engine; print('a'); "
        "p, _ = import_engine('pybullet', 'sim'); print('b')"
    )
    run = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )
    assert (run.stdout, run.stderr) == ("a\nb\n", "")
