# SPDX-License-Identifier: Apache-2.0
"""What is known of all effects without physics: the catalogue's, and those of other packages.

A package that brings an effect says by the entry point ``comcal.effect_specs`` where it may sit and
what its parameters are, with an :class:`~comcal.robot.changes_kinds.EffectSpec` or a sequence of
them; what it does, by the entry point ``comcal.effects``.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from types import MappingProxyType

from comcal.robot.brought import brought
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
    found.update({spec.name: spec for spec, _ in brought(GROUP, EffectSpec, EFFECTS)})
    return MappingProxyType(found)
