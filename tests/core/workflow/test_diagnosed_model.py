# SPDX-License-Identifier: Apache-2.0
"""The model to go on with is what was given and what was found, and says how far to trust it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from comcal.diagnose.diagnosis import Cause, Diagnosis, Estimate, Misfit, Rival, Verdict
from comcal.effects.registry import corrected
from comcal.predict.assumed import Assumed
from comcal.predict.parity import parity
from comcal.robot.changes import Change
from comcal.robot.changes_yaml import KnownChange, read_extension
from comcal.workflow.diagnosed_model import ADDITIVE, extended_model, extended_text


def cause(effect: str, target: str, **values: float) -> Cause:
    estimates = {k: Estimate(v, 0.01, (v - 0.02, v + 0.02), "") for k, v in values.items()}
    return Cause(Change(effect, target, values), estimates, log_odds=30.0, size=12.0)


def diagnosis(*causes: Cause, verdict: Verdict = Verdict.EXPLAINED, groups=()) -> Diagnosis:
    misfit = Misfit(1.0, 1, 0.5, 1.0, 0.5)
    return Diagnosis(verdict, "Something.", causes, groups, (), None, misfit, (), ())


def test_the_published_term_and_its_correction_are_one_entry() -> None:
    given = [KnownChange(Change("internal_torque_term", "", {"factor": 1.0}))]
    model = extended_model(given, diagnosis(cause("internal_torque_term", "", factor=-0.98)))
    assert len(model) == 1
    assert model[0].change.number("factor") == pytest.approx(0.02)
    assert model[0].sigma == {"factor": 0.01}


def test_other_causes_follow_what_was_given_in_its_order() -> None:
    given = [KnownChange(Change("payload", "torso", {"mass": 2.0}), {"mass": 0.1})]
    found = diagnosis(cause("payload", "torso", mass=0.5), cause("link_mass", "torso", mass=0.2))
    model = extended_model(given, found)
    assert [k.change.effect for k in model] == ["payload", "payload", "link_mass"]
    assert model[0] == given[0]


def test_an_offset_comes_before_the_scale_that_was_found_first() -> None:
    """The scale was given: what is found after it is of readings that are scaled."""
    scale = cause("torque_constant", "l_knee", relative=0.2)
    offset = cause("current_offset", "l_knee", offset=0.5)
    both = diagnosis(scale, offset)
    assert [k.change for k in extended_model((), both)] == [offset.change, scale.change]
    assert both.changes == (offset.change, scale.change)
    given = [KnownChange(scale.change)]
    found = [k.change for k in extended_model(given, diagnosis(offset))]
    assert found == [scale.change, offset.change]


@pytest.mark.parametrize(
    ("effect", "target", "first", "second"),
    [
        ("ft_bias", "l_foot", {"fx": 2.0}, {"fx": -0.5, "ty": 0.3}),
        ("link_com", "torso", {"com_x": 0.01}, {"com_x": 0.002, "com_z": 0.01}),
        ("link_mass", "torso", {"mass": 0.4}, {"mass": -0.1}),
        ("link_length", "l_knee", {"z": 0.004}, {"z": 0.001}),
        ("sole_mass", "l_foot", {"mass": 0.1}, {"mass": 0.2}),
        ("joint_offset", "l_knee", {"offset": 0.01}, {"offset": -0.004}),
        ("cable_pull", "torso", {"force_x": 4.0}, {"force_z": 3.0}),
        ("internal_torque_term", "", {"factor": 1.0}, {"factor": -0.9}),
    ],
)
def test_a_sum_is_the_same_model_as_one_after_the_other(
    effect, target, first, second, biped14
) -> None:
    assert effect in ADDITIVE
    given = Change(effect, target, first)
    found = cause(effect, target, **second)
    (joined,) = extended_model([KnownChange(given)], diagnosis(found))
    table = biped14.measure()
    one = parity(*corrected(Assumed(biped14.robot), table, [joined.change])).values
    two = parity(*corrected(Assumed(biped14.robot), table, [given, found.change])).values
    np.testing.assert_allclose(one, two, rtol=0.0, atol=1e-9)
    alone = parity(*corrected(Assumed(biped14.robot), table, [given])).values
    assert np.nanmax(np.abs(alone - one)) > 1e-4, "the cause does something"


def test_the_file_is_a_model_again(tmp_path: Path) -> None:
    path = tmp_path / "extended.yaml"
    path.write_text(extended_text((), diagnosis(cause("ft_bias", "l_foot", fx=1.5))), "utf-8")
    (known,) = read_extension(path)
    assert known == KnownChange(Change("ft_bias", "l_foot", {"fx": 1.5}), {"fx": 0.01})


def test_the_file_says_how_far_to_trust_it() -> None:
    found = cause("ft_drift", "l_foot", fx=0.002)
    group = (Rival("ft_drift", "l_foot", 0.0, 0.0), Rival("ft_temperature", "l_foot", 0.5, 0.0))
    partial = extended_text((), diagnosis(found, verdict=Verdict.UNEXPLAINED))
    undecided = extended_text((), diagnosis(found, verdict=Verdict.AMBIGUOUS, groups=(group,)))
    assert "# PARTIAL: the verdict is unexplained" in partial
    assert "ft_drift@l_foot or ft_temperature@l_foot" in undecided
    assert "PARTIAL" not in extended_text((), diagnosis(found))
    nothing = extended_text((), diagnosis(verdict=Verdict.NOTHING_WRONG))
    assert "# no cause was named" in nothing
