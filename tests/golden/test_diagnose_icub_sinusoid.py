# SPDX-License-Identifier: Apache-2.0
"""iCub weighs 3.2 % more than its URDF: a mass is missing, or forces read too much. Which, is open.

The session is that of the import map beside this file, with two more assumptions: encoders may be
off by a degree, since two soles that are both flat on the floor miss one another by 1.7 deg, and
the vertical forces by 0.5 N in all windows alike.
"""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from comcal.diagnose.diagnosis import Cause, Diagnosis, Verdict
from comcal.diagnose.rivals import UNDECIDED
from comcal.effects.registry import effects
from comcal.measure.importer import import_csv
from comcal.workflow.diagnose import diagnose_session

HERE = Path(__file__).parent / "icub_com_sinusoid"
EXCESS = (334.9 - 324.5) / 9.81
"""Sum of the feet's forces over the URDF's weight, as others find it [kg]."""


@pytest.fixture(scope="module")
def diagnosis(shared_dir: Path, tmp_path_factory: pytest.TempPathFactory) -> Diagnosis:
    data = shared_dir / "data" / "icub_com_sinusoid"
    if not (data / "com-sinusoid.csv").is_file():
        pytest.skip(f"no log in {data}")
    folder = tmp_path_factory.mktemp("sinusoid")
    shutil.copyfile(data / "model.urdf", folder / "model.urdf")
    robot = (HERE / "robot.yaml").read_text("utf-8")
    (folder / "robot.yaml").write_text(f"{robot}tolerances: {{joint_offset: 1 deg}}\n", "utf-8")
    plan = (HERE / "map.yaml").read_text("utf-8")
    assert plan.count("sigma: [0, 0, 2 N,") == 2
    plan = plan.replace("sigma: [0, 0, 2 N,", "sigma: [0, 0, 0.5 N,")
    (folder / "map.yaml").write_text(plan, "utf-8")
    session = folder / "session"
    log = data / "com-sinusoid.csv"
    import_csv(log, folder / "map.yaml", session, quasi_static=True, between=(9.2, float("inf")))
    # Looked for by name, so that tolerances are those stated, not learnt.
    looked_for = tuple(effect.name for effect in effects().values() if effect.fault)
    return diagnose_session(session, causes=looked_for).diagnosis


@pytest.fixture(scope="module")
def weight(diagnosis: Diagnosis) -> Cause:
    (cause,) = diagnosis.causes
    return cause


def test_excess_of_weight_is_all_that_is_found(diagnosis: Diagnosis, weight: Cause) -> None:
    fz = next(c for c in diagnosis.channels if c.name == "equilibrium Fz")
    assert fz.before == pytest.approx(10.4, abs=0.5)
    assert fz.after < 1.5
    assert weight.gain is not None
    assert weight.gain.is_real
    assert diagnosis.misfit.chance > 1e-3


def test_mass_and_gain_cannot_be_told_apart(diagnosis: Diagnosis, weight: Cause) -> None:
    assert diagnosis.verdict is Verdict.AMBIGUOUS
    possible = {weight.change.effect: 0.0}
    for rival in weight.rivals:
        if rival.log_odds < UNDECIDED:
            possible.setdefault(rival.effect, rival.log_odds)
    assert {"link_mass", "payload", "ft_gain"} <= set(possible)


def test_size_is_three_per_cent_of_the_weight(weight: Cause) -> None:
    if "mass" in weight.estimates:
        mass = weight.estimates["mass"]
        assert mass.interval[0] < EXCESS < mass.interval[1]
        assert mass.interval[1] - mass.interval[0] < 1.0
    else:
        assert weight.change.effect == "ft_gain"
        assert 0.02 < weight.estimates["gain_fz"].value < 0.1


def test_no_encoder_is_blamed_for_what_a_degree_explains(diagnosis: Diagnosis) -> None:
    closure = [c for c in diagnosis.channels if c.name.startswith("closure")]
    assert len(closure) == 3
    assert all(c.sigmas_after < 1.5 for c in closure)
