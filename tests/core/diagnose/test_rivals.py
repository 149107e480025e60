# SPDX-License-Identifier: Apache-2.0
"""What cannot be excluded beside a cause: by evidence, by its fit, or where noise can hide it."""

from __future__ import annotations

import pytest

from comcal.diagnose.diagnosis import Rival
from comcal.diagnose.rivals import DISPROVED, UNDECIDED, UNSEEN, undecided
from comcal.diagnose.sentence import choices
from comcal.robot.changes import Change

FAR = 4.0 * UNSEEN
"""Sigmas that noise does not hide."""


def names(effect: str, *rivals: Rival) -> list[str]:
    return [rival.name for rival in undecided(Change(effect, "torso", {}), rivals)]


def test_evidence_excludes_what_noise_cannot_hide() -> None:
    near = Rival("ft_gain", "l_foot", UNDECIDED - 0.1, 0.5, FAR)
    far = Rival("ft_mounting", "l_foot", UNDECIDED + 0.1, 0.5, FAR)
    assert names("ft_bias", near, far) == ["ft_gain@l_foot"]


def test_an_effect_that_noise_can_hide_is_not_excluded_for_being_less_simple() -> None:
    cable = Rival("cable_pull", "torso", 4.0 * UNDECIDED, 0.1, 0.5 * UNSEEN)
    assert names("link_mass", cable) == ["cable_pull@torso"]


def unseen(effect: str, target: str, odds: float, chi2: float, *poses: int) -> Rival:
    """A rival of which noise can hide what it leaves."""
    return Rival(effect, target, odds, 0.1, 0.5 * UNSEEN, chi2_more=chi2, poses=poses)


def test_among_places_of_one_effect_the_fit_decides() -> None:
    """A force of 1 N at the trunk: five names were listed, two of them disproved by the readings.

    A cable and a hand are as many parameters at one point as at another.
    """
    here = unseen("external_contact", "pelvis", 2.1, 0.0)
    beside = Rival("cable_pull", "l_thigh", 1.2, 0.25, FAR, chi2_more=2.5)
    there = unseen("cable_pull", "torso", 4.5, 9.0)
    hand_there = unseen("external_contact", "torso", 6.6, 9.0)
    found = names("cable_pull", beside, here, there, hand_there)
    assert found == ["external_contact@pelvis", "cable_pull@l_thigh"]


def test_a_place_that_fits_as_well_is_not_excluded_by_its_prior() -> None:
    """Of a joint that stands still: the heavier side's CoM would move less, which is no proof."""
    torso = unseen("link_com", "torso", UNDECIDED + 0.5, 0.1)
    assert names("link_com", torso) == ["link_com@torso"]


@pytest.mark.parametrize("more", [DISPROVED - 0.1, DISPROVED + 0.1])
def test_another_place_counts_from_the_best_of_its_effect(more: float) -> None:
    best = unseen("tether", "pelvis", 30.0, -4.0)
    next_best = unseen("tether", "torso", 31.0, -4.0 + more)
    expected = ["tether@pelvis", "tether@torso"] if more < DISPROVED else ["tether@pelvis"]
    assert names("link_mass", best, next_best) == expected


def test_a_place_that_is_out_anyway_sets_no_measure() -> None:
    seen = Rival("tether", "pelvis", 30.0, 0.5, FAR, chi2_more=-20.0)
    hidden = unseen("tether", "torso", 31.0, 1.0)
    assert names("link_mass", seen, hidden) == ["tether@torso"]


def test_a_touch_in_one_pose_is_not_measured_by_a_lasting_force() -> None:
    lasting = unseen("external_contact", "torso", 9.0, -8.0)
    touch = unseen("external_contact", "torso", 8.0, 0.0, 4)
    found = names("tether", touch, lasting)
    assert found == ["external_contact@torso in pose 4", "external_contact@torso"]


def test_what_holds_the_cause_as_a_special_case_is_none_by_that_alone() -> None:
    general = Rival("payload", "torso", 2.0 * UNDECIDED, 0.0, 0.0)
    assert names("link_mass", general) == []
    better = Rival("payload", "torso", 2.0 * UNDECIDED, 0.0, 0.0, fits_better=True)
    assert names("link_mass", better) == ["payload@torso"]


def test_the_likeliest_of_each_other_kind_comes_first() -> None:
    places = [unseen("link_mass", name, 1.0 + k, 0.0) for k, name in enumerate(("pelvis", "waist"))]
    cable, hand = (
        unseen("cable_pull", "torso", 4.0, 0.0),
        unseen("external_contact", "torso", 5.0, 0.0),
    )
    found = names("link_mass", *places, cable, hand)
    expected = ["cable_pull@torso", "external_contact@torso", "link_mass@pelvis", "link_mass@waist"]
    assert found == expected


def test_a_sentence_names_four_of_a_set_and_counts_the_others() -> None:
    group = [unseen("cable_pull", f"link{k}", float(k), 0.0) for k in range(6)]
    four = " or ".join(f"cable_pull@link{k}" for k in range(4))
    assert choices([group[:4]]) == four
    assert choices([group[:5]]) == f"{four} or cable_pull@link4"
    assert choices([group, group[:2]]) == (
        f"{four} or one of 2 more; cable_pull@link0 or cable_pull@link1"
    )
