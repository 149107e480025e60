# SPDX-License-Identifier: Apache-2.0
"""What is known of all effects without physics: the catalogue's, and those of other packages.

A package that brings an effect says by the entry point ``comcal.effect_specs`` where it may sit and
what its parameters are, with an :class:`~comcal.robot.changes_kinds.EffectSpec` or a sequence of
them; what it does, by the entry point ``comcal.effects``.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cache
from importlib import metadata
from types import MappingProxyType

from comcal.errors import ConfigError
from comcal.robot.changes_kinds import EffectSpec
from comcal.robot.changes_table import EFFECTS

GROUP = "comcal.effect_specs"


@cache
def effect_specs() -> Mapping[str, EffectSpec]:
    """Return what is known of every effect, by name; those of the catalogue first.

    Raises
    ------
    ConfigError
        If an entry point names something else, or there are two effects of one name.
    """
    found = dict(EFFECTS)
    for entry in metadata.entry_points(group=GROUP):
        brought: object = entry.load()
        for spec in brought if isinstance(brought, Iterable) else (brought,):
            if not isinstance(spec, EffectSpec):
                raise ConfigError(
                    f"entry point {entry.name!r} brings something that is no EffectSpec",
                    where=entry.value,
                    next_step="let it name an EffectSpec or a sequence of them",
                )
            if spec.name in found:
                raise ConfigError(
                    f"there are two effects called {spec.name!r}",
                    where=entry.value,
                    next_step="remove one of the packages",
                )
            found[spec.name] = spec
    return MappingProxyType(found)
