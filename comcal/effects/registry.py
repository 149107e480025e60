# SPDX-License-Identifier: Apache-2.0
"""All effects by name: those of the catalogue, and those that other packages bring.

A package adds its own by the entry point ``comcal.effects``, which names an
:class:`~comcal.effects.effect.Effect` or a sequence of them; their keys and targets it says by
another one, ``comcal.effect_specs`` (:mod:`comcal.robot.effect_specs`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cache
from types import MappingProxyType

from comcal.effects import (
    angles,
    bodies,
    feet,
    ft_reading,
    inertia,
    mistakes,
    motors,
    surroundings,
    timing,
)
from comcal.effects.effect import Effect, Stage, State
from comcal.errors import ConfigError
from comcal.measure.table import PoseTable
from comcal.predict.assumed import Assumed
from comcal.robot.brought import brought
from comcal.robot.changes import Change
from comcal.robot.effect_specs import GROUP as SPECS
from comcal.robot.effect_specs import effect_specs

GROUP = "comcal.effects"


@cache
def effects() -> Mapping[str, Effect]:
    """Return every effect that has a correction, by name.

    Raises
    ------
    ConfigError
        If two packages bring an effect of one name, or one whose keys and targets nobody says.
    """
    found: dict[str, Effect] = {}
    for module in (
        ft_reading,
        bodies,
        angles,
        motors,
        surroundings,
        feet,
        timing,
        inertia,
        mistakes,
    ):
        found.update({effect.name: effect for effect in module.EFFECTS})
    for effect, where in brought(GROUP, Effect, tuple(found)):
        _check_keys(effect, where)
        found[effect.name] = effect
    return MappingProxyType(found)


def _check_keys(effect: Effect, where: str) -> None:
    spec = effect_specs().get(effect.name)
    unknown = [key for key in effect.fault if spec is None or key not in spec.keys]
    if spec is None or unknown:
        what = "is not known" if spec is None else f"has no parameter {unknown[0]!r}"
        raise ConfigError(
            f"the effect {effect.name!r} {what}",
            where=where,
            next_step=f"say its targets and keys in an EffectSpec by the entry point {SPECS}",
        )


def corrected(assumed: Assumed, table: PoseTable, changes: Iterable[Change]) -> State:
    """Apply changes one after the other: what is then assumed, and what the readings then mean.

    Raises
    ------
    ConfigError
        If an effect has no correction, such as readings that are frozen or saturated.
    """
    for change in changes:
        effect = effects().get(change.effect)
        if effect is None:
            raise ConfigError(
                f"readings cannot be corrected for {change.effect}",
                where=change.name,
                next_step="leave it out of the model",
            )
        assumed, table = effect.correct(assumed, table, change)
    return assumed, table


def in_stages(state: State, changes: Iterable[tuple[Effect, Change]]) -> State:
    """Correct a state for changes that were found together, whichever was found first."""
    for effect, change in sorted(changes, key=lambda pair: pair[0].stage):
        state = effect.correct(*state, change)
    return state


def stage_of(change: Change) -> Stage:
    """Return when a change is corrected, among several that were found together."""
    effect = effects().get(change.effect)
    return Stage.ELSE if effect is None else effect.stage
