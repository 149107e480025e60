# SPDX-License-Identifier: Apache-2.0
"""What cannot be excluded beside a cause: by evidence, by its fit, or where noise can hide it."""

from __future__ import annotations

import pytest

from comcal.diagnose.diagnosis import Rival
from comcal.diagnose.rivals import UNDECIDED, UNSEEN, undecided

FAR = 4.0 * UNSEEN
"""Sigmas that noise does not hide."""


def names(effect: str, *rivals: Rival) -> list[str]:
    return [rival.name for rival in undecided(effect, rivals)]


def test_evidence_excludes_what_noise_cannot_hide() -> None:
    near = Rival("ft_gain", "l_foot", UNDECIDED - 0.1, 0.5, FAR)
    far = Rival("ft_mounting", "l_foot", UNDECIDED + 0.1, 0.5, FAR)
    assert names("ft_bias", near, far) == ["ft_gain@l_foot"]


def test_an_effect_that_noise_can_hide_is_not_excluded_for_being_less_simple() -> None:
    cable = Rival("cable_pull", "torso", 4.0 * UNDECIDED, 0.1, 0.5 * UNSEEN)
    assert names("link_mass", cable) == ["cable_pull@torso"]


def test_among_places_of_one_effect_the_readings_decide() -> None:
    """A force of 1 N at the trunk: five names were listed, two of them disproved by the readings.

    A cable and a hand are as many parameters at one point as at another.
    """
    here = Rival("external_contact", "pelvis", 2.1, 0.001, 0.0)
    beside = Rival("cable_pull", "l_thigh", 1.2, 0.25, 1.1 * UNSEEN)
    there = Rival("cable_pull", "torso", 4.5, 0.16, 0.6 * UNSEEN)
    hand_there = Rival("external_contact", "torso", 6.6, 0.16, 0.6 * UNSEEN)
    found = names("cable_pull", beside, here, there, hand_there)
    assert found == ["cable_pull@l_thigh", "external_contact@pelvis"]


@pytest.mark.parametrize("odds", [UNDECIDED - 0.1, UNDECIDED + 0.1])
def test_another_place_counts_from_the_best_of_its_effect(odds: float) -> None:
    best = Rival("tether", "pelvis", 30.0, 0.001, 0.0)
    next_best = Rival("tether", "torso", 30.0 + odds, 0.1, 0.5 * UNSEEN)
    expected = ["tether@pelvis", "tether@torso"] if odds < UNDECIDED else ["tether@pelvis"]
    assert names("link_mass", best, next_best) == expected


def test_what_holds_the_cause_as_a_special_case_is_none_by_that_alone() -> None:
    general = Rival("payload", "torso", 2.0 * UNDECIDED, 0.0, 0.0)
    assert names("link_mass", general) == []
    better = Rival("payload", "torso", 2.0 * UNDECIDED, 0.0, 0.0, fits_better=True)
    assert names("link_mass", better) == ["payload@torso"]
