# SPDX-License-Identifier: Apache-2.0
"""Hands that touch something in a few poses are found there and nowhere else.

Each of these was once named otherwise: gains and crosstalk beside three strong hands, a couple that
no hand makes on a robot that hangs, another link while the second pose was still unknown, a flipped
sign of a sensor.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from comcal.diagnose.contacts import WHERE_ON_ITS_LINE
from comcal.diagnose.diagnose import diagnose
from comcal.diagnose.diagnosis import Verdict
from comcal.predict.assumed import Assumed
from comcal.robot.changes_text import parse_change
from comcal.robot.healthy import draw_healthy

HAND = "point_z=-0.6"
CASES = {
    "three strong hands": (
        f"external_contact@l_arm:force_x=-21.4,force_y=2.1,force_z=10.2,{HAND},poses=8",
        f"external_contact@l_arm:force_x=-1.2,force_y=-10.5,force_z=4.8,{HAND},poses=13",
        f"external_contact@l_arm:force_x=-11.8,force_y=10.9,force_z=1.8,{HAND},poses=18",
    ),
    "one of a robot that hangs": (
        f"external_contact@r_arm:force_x=-5.2,force_y=14.8,force_z=-23.7,{HAND},poses=6",
        f"external_contact@r_arm:force_x=3.1,force_y=-5.1,force_z=18.3,{HAND},poses=9",
    ),
    "one that looks like the torso": (
        f"external_contact@l_arm:force_x=23.1,force_y=-6.2,force_z=-14.5,{HAND},poses=4",
        f"external_contact@l_arm:force_x=-5.9,force_y=18.8,force_z=-11.5,{HAND},poses=6",
    ),
    "one that looks like a flipped sign": (
        f"external_contact@r_arm:force_x=-0.43,force_y=23.38,force_z=4.88,{HAND},poses=13",
    ),
}


DRAWN = {"one that looks like a flipped sign": 20}
"""Seeds of healthy robots, where it is not 8."""


@pytest.mark.parametrize("case", CASES)
def test_hands_are_found_in_their_poses_and_nothing_else(study: SimpleNamespace, case: str) -> None:
    scenario = study.scenario.scenario()
    hidden = [parse_change(text) for text in CASES[case]]
    healthy = draw_healthy(scenario.robot, np.random.default_rng(DRAWN.get(case, 8)))
    table = study.world.hidden_table(
        scenario.stage("mixed"), (*healthy, *hidden), scenario.samples, engine="builtin", seed=9
    )
    said = diagnose(Assumed(scenario.robot), table)
    assert said.verdict is Verdict.EXPLAINED
    assert {(c.change.effect, c.change.target, c.change.poses()) for c in said.causes} == {
        (h.effect, h.target, h.poses()) for h in hidden
    }
    for change in hidden:
        assert (
            f"{change.effect}@{change.target} (a link touches something) in pose" in said.sentence
        )
        assert all(str(pose) in said.sentence for pose in change.poses() or ())
    assert WHERE_ON_ITS_LINE in said.notes


def test_a_spring_that_one_pose_stretches_may_be_a_hand_in_that_pose(
    study: SimpleNamespace,
) -> None:
    """The tether was taken for a hand, for certain; a hand is its rival, with the pose."""
    scenario = study.scenario.scenario()
    tether = parse_change(
        "tether@r_shin:force_x=-0.27,force_y=-0.0216,force_z=-0.59,"
        "k_xx=1.3519,k_yy=0.0085,k_zz=6.345,k_xy=0.107,k_xz=2.929,k_yz=0.232"
    )
    healthy = draw_healthy(scenario.robot, np.random.default_rng(11))
    table = study.world.hidden_table(
        scenario.stage("mixed"), (*healthy, tether), scenario.samples, engine="builtin", seed=12
    )
    said = diagnose(Assumed(scenario.robot), table)
    assert said.verdict is Verdict.AMBIGUOUS
    assert [[rival.name for rival in group] for group in said.groups] == [
        ["tether@r_shin", "external_contact@r_shin in pose 3"]
    ]
