# SPDX-License-Identifier: Apache-2.0
"""Effects that another package brings by entry points are named, written and read like any."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from importlib import metadata
from types import SimpleNamespace

import numpy as np
import pytest

from comcal.diagnose.diagnose import diagnose
from comcal.diagnose.diagnosis import Verdict
from comcal.effects.effect import Effect, State
from comcal.effects.readings import with_wrench
from comcal.effects.registry import effects
from comcal.errors import ConfigError
from comcal.measure.table import PoseTable
from comcal.predict.assumed import Assumed
from comcal.robot.changes import Change
from comcal.robot.changes_kinds import EffectSpec, Key, Realisation, TargetKind
from comcal.robot.changes_yaml import KnownChange, extension_text, read_extension
from comcal.robot.effect_specs import effect_specs

BENT = 1e-4
"""Of fz, per newton."""


def straight(assumed: Assumed, table: PoseTable, change: Change) -> State:
    """Undo fz' = fz + curvature fz^2."""
    wrench = table.wrench[change.target].copy()
    a = change.number("curvature")
    wrench[:, 2] = 2.0 * wrench[:, 2] / (1.0 + np.sqrt(1.0 + 4.0 * a * wrench[:, 2]))
    return assumed, with_wrench(table, change.target, wrench)


SPEC = EffectSpec(
    "ft_curvature",
    "a sensor that is not linear",
    frozenset({TargetKind.SENSOR}),
    {"curvature": Key("curvature", "1/N")},
    Realisation.NONE,
)
EFFECT = Effect(
    name="ft_curvature",
    correct=straight,
    fault={"curvature": BENT},
    signature="fz errs with the square of the load",
    separated_by="half and full load on that foot",
    remedy="calibrate the sensor over its range",
)


@pytest.fixture
def brought(monkeypatch: pytest.MonkeyPatch) -> Iterator[dict[str, object]]:
    """What the entry points of another package name, by their group."""
    named: dict[str, object] = {"comcal.effects": EFFECT, "comcal.effect_specs": SPEC}
    installed = metadata.entry_points

    def entry_points(*, group: str) -> list[object]:
        entry = SimpleNamespace(name="other", value="other:it", load=lambda: named[group])
        return [*installed(group=group), *([entry] if group in named else [])]

    monkeypatch.setattr(metadata, "entry_points", entry_points)
    for known in (effects, effect_specs):
        known.cache_clear()
    yield named
    for known in (effects, effect_specs):
        known.cache_clear()


@pytest.fixture
def bent(biped14) -> PoseTable:
    """Half of the plan, measured by a left foot whose fz is not linear."""
    table = biped14.noisy(biped14.measure(biped14.plan[::2]), np.random.default_rng(3))
    wrench = table.wrench["l_foot"].copy()
    wrench[:, 2] += BENT * wrench[:, 2] ** 2
    return replace(table, wrench={**table.wrench, "l_foot": wrench})


def test_what_another_package_brings_is_named_and_measured(biped14, bent, brought) -> None:
    found = diagnose(Assumed(biped14.robot), bent, learn=False)
    assert found.verdict is Verdict.EXPLAINED
    (cause,) = found.causes
    assert cause.name == "ft_curvature@l_foot"
    assert "a sensor that is not linear" in found.sentence
    estimate = cause.estimates["curvature"]
    assert estimate.unit == "1/N"
    assert estimate.interval[0] < BENT < estimate.interval[1]


def test_its_model_is_written_and_read(tmp_path, brought) -> None:
    known = KnownChange(Change("ft_curvature", "l_foot", {"curvature": BENT}), {"curvature": 1e-6})
    path = tmp_path / "extended.yaml"
    path.write_text(extension_text([known]), "utf-8")
    assert read_extension(path) == (known,)


def test_a_package_that_says_no_targets_is_refused(brought) -> None:
    del brought["comcal.effect_specs"]
    with pytest.raises(ConfigError, match=r"'ft_curvature' is not known.*comcal\.effect_specs"):
        effects()
