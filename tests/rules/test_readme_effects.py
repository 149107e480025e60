# SPDX-License-Identifier: Apache-2.0
"""README's tables of effects and of healthy tolerances say what the program says."""

from __future__ import annotations

import re
from pathlib import Path

from comcal.effects.registry import effects
from comcal.robot.changes_kinds import EffectSpec, TargetKind
from comcal.robot.changes_table import EFFECTS
from comcal.robot.healthy import USUAL_SPREADS

MOST_KEYS = 9
GATES = ("not_settled", "frozen_sensor", "saturation", "quantisation")
UNITS = {
    "link_mass": "of the mass",
    "link_com": "m",
    "link_length": "m",
    "ft_bias_force": "N",
    "ft_bias_moment": "N m",
    "ft_gain": "1",
    "ft_crosstalk": "SI",
    "ft_mounting": "rad",
    "ft_position": "m",
    "sole_mass": "kg",
    "joint_offset": "rad",
    "joint_compliance": "rad/(N m)",
    "backlash": "rad",
    "hysteresis": "rad",
    "joint_friction": "N m",
    "torque_constant": "1",
    "current_offset": "A",
    "sole_compliance": "rad/(N m)",
    "ground_tilt": "rad",
    "imu_mounting": "rad",
    "foot_placement": "m",
    "foot_placement_angle": "rad",
    "cable_pull": "N",
    "timing_skew": "s",
}


def looked_for(name: str) -> str:
    """How the diagnosis finds an effect."""
    known = effects().get(name)
    kinds = ["gate"] if name in GATES else []
    if known is not None:
        kinds.append("cause" if known.fault else "mistake")
    return ", ".join(kinds) or "by its place"


def keys_of(spec: EffectSpec) -> str:
    """The keys of an effect, each with its unit or that of the next; of many, the ends."""
    keys = list(spec.keys.values())
    if len(keys) > MOST_KEYS:
        return f"`{keys[0].name}` to `{keys[-1].name}` [SI]"
    parts = list[str]()
    for key, after in zip(keys, [*keys[1:], None], strict=True):
        ends = after is None or after.unit != key.unit
        parts.append(f"`{key.name}`" + (f" [{key.unit}]" if ends and key.unit else ""))
    return ", ".join(parts)


def row(spec: EffectSpec) -> str:
    """The row of an effect."""
    order = [kind for kind in TargetKind if kind in spec.targets and kind is not TargetKind.NONE]
    at = ", ".join([kind.value for kind in order] + (["`all`"] if spec.has_all else [])) or "-"
    found = looked_for(spec.name)
    return f"| `{spec.name}` | {spec.summary} | {at} | {keys_of(spec)} | {found} |"


def spread_row(name: str) -> str:
    """The row of a family of tolerances."""
    return f"| `{name}` | {USUAL_SPREADS[name]:g} | {UNITS[name]} |"


def section(root: Path, title: str) -> str:
    text = (root / "README.md").read_text("utf-8")
    return re.split(rf"^## {title}$", text, flags=re.MULTILINE)[1].split("\n## ")[0]


def test_readme_lists_every_effect_and_no_other(root: Path) -> None:
    found = re.findall(r"^\| `\w+` \|.*\|.*\|.*\|.*\|$", section(root, "Effects"), re.MULTILINE)
    assert found == [row(spec) for spec in EFFECTS.values()]


def test_readme_lists_every_tolerance_with_what_counts_where_none_is_stated(root: Path) -> None:
    found = re.findall(r"^\| `\w+` \| [^|]+ \| [^|]+ \|$", section(root, "Effects"), re.MULTILINE)
    assert found == [spread_row(name) for name in USUAL_SPREADS]
