# SPDX-License-Identifier: Apache-2.0
"""The interval of a gain is the scatter of what the same robot gains when it is measured again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from comcal.diagnose.candidates import candidates
from comcal.diagnose.catalogue import catalogue
from comcal.diagnose.gain import Z, gains
from comcal.diagnose.naming import Named, name_causes
from comcal.diagnose.scene import scene
from comcal.predict.assumed import Assumed

DRAWS = 200
LEFT = 1e-3
"""Share of squares: a thirtieth of the offset."""


@pytest.fixture(scope="module")
def named(biped14) -> Named:
    """A healthy robot with 1 kg on its torso, and what was named."""
    table = biped14.noisy(biped14.measure(biped14.plan[::4]), np.random.default_rng(3))
    about = scene(
        catalogue(candidates(biped14.robot, table), biped14.robot), (Assumed(biped14.robot), table)
    )
    part = next(
        part
        for candidate, part in zip(about.of.candidates, about.of.slices, strict=True)
        if candidate.name == "payload@torso"
    )
    rng = np.random.default_rng(5)
    healthy = about.X @ (about.of.spread({}) * rng.standard_normal(about.X.shape[1]))
    load = np.zeros(about.X.shape[1])
    load[part] = [1.0, 0.1, 0.0, 0.2]
    return name_causes(replace(about, r=about.r + healthy + about.X @ load))


def test_the_interval_is_the_scatter_of_a_repetition(named: Named) -> None:
    about, rng = named.scene, np.random.default_rng(6)
    assert [about.of.candidates[i].name for i in named.causes] == ["payload@torso"]
    gained, half = list[float](), list[float]()
    for _ in range(DRAWS):
        again = replace(about, r=about.r + rng.standard_normal(len(about.r)))
        worth = gains(replace(named, scene=again))
        assert worth is not None
        gain = worth.of_cause[0]
        gained.append(gain.fraction * worth.before)
        half.append((gain.fraction - gain.interval[0]) * worth.before)
    assert np.std(gained) == pytest.approx(np.mean(half) / Z, rel=4.0 / np.sqrt(2.0 * DRAWS))


def test_the_gain_is_that_of_all_that_is_off(named: Named) -> None:
    """Without noise all of it goes; a part, taken for healthy, was left in the poses held out."""
    scene = named.scene
    i = scene.of.index["ft_bias@l_foot"]
    part = scene.of.slices[i]
    load = np.zeros(scene.X.shape[1])
    load[part] = 0.5 * scene.of.fault[part]
    # As much is healthy as a fault: half of it would be left.
    scales = dict(
        zip(scene.of.family[part], scene.of.fault[part] / scene.of.healthy[part], strict=True)
    )
    worth = gains(
        replace(named, causes=(i,), scene=replace(scene, r=scene.X @ load, scales=scales))
    )
    assert worth is not None
    assert worth.after < LEFT * worth.before
