# SPDX-License-Identifier: Apache-2.0
"""All effects by name: those of the catalogue, and those that other packages bring.

A package adds its own by the entry point ``comcal.effects``, which names an
:class:`~comcal.effects.effect.Effect` or a sequence of them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cache
from importlib import metadata
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
from comcal.effects.effect import Effect, State
from comcal.errors import ConfigError
from comcal.measure.table import PoseTable
from comcal.predict.assumed import Assumed
from comcal.robot.changes import Change

GROUP = "comcal.effects"


@cache
def effects() -> Mapping[str, Effect]:
    """Return every effect that has a correction, by name.

    Raises
    ------
    ConfigError
        If two packages bring an effect of one name.
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
    for entry in metadata.entry_points(group=GROUP):
        brought: object = entry.load()
        for effect in brought if isinstance(brought, Iterable) else (brought,):
            if not isinstance(effect, Effect):
                raise ConfigError(
                    f"entry point {entry.name!r} brings something that is no effect",
                    where=entry.value,
                    next_step="let it name an Effect or a sequence of them",
                )
            if effect.name in found:
                raise ConfigError(
                    f"there are two effects called {effect.name!r}",
                    where=entry.value,
                    next_step="remove one of the packages",
                )
            found[effect.name] = effect
    return MappingProxyType(found)


def corrected(assumed: Assumed, table: PoseTable, changes: Iterable[Change]) -> State:
    """Apply changes one after the other: what is then assumed, and what the readings then mean.

    Raises
    ------
    ConfigError
        If an effect has no correction.
    """
    for change in changes:
        effect = effects().get(change.effect)
        if effect is None:
            raise ConfigError(
                f"effect {change.effect!r} has no correction",
                where=change.target,
                next_step=f"those that have: {', '.join(effects())}",
            )
        assumed, table = effect.correct(assumed, table, change)
    return assumed, table
