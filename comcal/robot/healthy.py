# SPDX-License-Identifier: Apache-2.0
"""The small changes of a healthy robot: everything is off by what ``tolerances`` call healthy."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from comcal.robot.changes import Change
from comcal.robot.changes_kinds import TargetKind
from comcal.robot.changes_table import CHANNELS, EFFECTS
from comcal.robot.model import Robot
from comcal.robot.tree import JointType
from comcal.robot.units import LARGEST

USUAL_SPREADS: Mapping[str, float] = MappingProxyType(
    {
        "link_mass": 0.005,
        "link_com": 0.001,
        "link_length": 0.0003,
        "ft_bias_force": 0.2,
        "ft_bias_moment": 0.02,
        "ft_gain": 0.002,
        "ft_crosstalk": 0.0005,
        "ft_mounting": 0.001,
        "ft_position": 0.0005,
        "sole_mass": 0.005,
        "joint_offset": 0.0007,
        "joint_compliance": 2e-6,
        "backlash": 5e-5,
        "hysteresis": 5e-5,
        "joint_friction": 0.1,
        "torque_constant": 0.01,
        "current_offset": 0.01,
        "sole_compliance": 2e-6,
        "ground_tilt": 0.001,
        "imu_mounting": 0.001,
        "foot_placement": 0.001,
        "foot_placement_angle": 0.001,
        "cable_pull": 0.0,
        "timing_skew": 0.0,
    }
)
"""One sigma of every family of ``tolerances`` where robot.yaml is silent: SI and radians, masses of
links relative."""

_FORCES, _MOMENTS = CHANNELS[:3], CHANNELS[3:]


@dataclass(frozen=True)
class _Row:
    """How one effect is drawn: its keys with the family of each, and whether one sign is possible.

    The number drawn is a compliance where ``inverse`` says that the key is a stiffness.
    """

    effect: str
    families: Mapping[str, str]
    one_sided: bool = False
    inverse: bool = False


def _same(effect: str, keys: Iterable[str], family: str = "") -> _Row:
    return _Row(effect, dict.fromkeys(keys, family or effect))


_ROWS = (
    _same("link_mass", ("mass",)),
    _same("link_com", EFFECTS["link_com"].keys),
    _same("link_length", EFFECTS["link_length"].keys),
    _Row(
        "ft_bias",
        dict.fromkeys(_FORCES, "ft_bias_force") | dict.fromkeys(_MOMENTS, "ft_bias_moment"),
    ),
    _same("ft_gain", EFFECTS["ft_gain"].keys),
    _same("ft_crosstalk", EFFECTS["ft_crosstalk"].keys),
    _same("ft_mounting", EFFECTS["ft_mounting"].keys),
    _same("ft_position", EFFECTS["ft_position"].keys),
    _same("sole_mass", ("mass",)),
    _same("joint_offset", ("offset",)),
    _Row("joint_compliance", {"stiffness": "joint_compliance"}, one_sided=True, inverse=True),
    _Row("backlash", {"half_width": "backlash"}, one_sided=True),
    _same("hysteresis", ("half_width",)),
    _Row("joint_friction", {"coulomb": "joint_friction"}, one_sided=True),
    _same("torque_constant", ("relative",)),
    _same("current_offset", ("offset",)),
    _Row(
        "sole_compliance",
        dict.fromkeys(EFFECTS["sole_compliance"].keys, "sole_compliance"),
        one_sided=True,
    ),
    _same("ground_tilt", EFFECTS["ground_tilt"].keys),
    _same("imu_mounting", EFFECTS["imu_mounting"].keys),
    _Row(
        "foot_placement",
        {
            key: "foot_placement_angle" if unit.unit == "rad" else "foot_placement"
            for key, unit in EFFECTS["foot_placement"].keys.items()
            if key != "yaw"  # legs without hip yaw could not take it
        },
    ),
    _same("cable_pull", EFFECTS["cable_pull"].keys),
    _Row("timing_skew", {"time": "timing_skew"}, one_sided=True),
)
"""The order is that of the random streams: new effects go to the end."""


def healthy_spreads(robot: Robot) -> dict[str, float]:
    """Return one sigma of every family: that of robot.yaml, else the usual one.

    Parameters
    ----------
    robot : Robot
        Whose ``tolerances`` count; link masses and CoMs always come from there.

    Returns
    -------
    dict from family to float
        By the keys of ``tolerances`` in robot.yaml; SI and radians, ``link_mass`` relative.
    """
    given = robot.tolerances
    return {
        **USUAL_SPREADS,
        **given.other,
        "link_mass": given.link_mass,
        "link_com": given.link_com,
        "link_length": given.link_length or USUAL_SPREADS["link_length"],
    }


def draw_healthy(
    robot: Robot, rng: np.random.Generator, families: Iterable[str] | None = None
) -> tuple[Change, ...]:
    """Draw the changes of one healthy robot of this design.

    Parameters
    ----------
    robot : Robot
        As designed.
    rng : numpy.random.Generator
    families : iterable of str, optional
        Effects to draw; default all that have a healthy spread.

    Returns
    -------
    tuple of Change
        Normal with the spreads of :func:`healthy_spreads`; the absolute value of such a draw where
        only one sign is possible (springs, play, friction). Every effect draws from a stream of
        its own, so leaving one out does not change the others.
    """
    spreads = healthy_spreads(robot)
    targets = _targets(robot)
    seeds = rng.integers(0, 2**63, size=len(_ROWS))
    wanted = None if families is None else set(families)
    return tuple(
        change
        for row, seed in zip(_ROWS, seeds, strict=True)
        if wanted is None or row.effect in wanted
        for change in _drawn(row, targets[row.effect], spreads, np.random.default_rng(int(seed)))
    )


def _drawn(
    row: _Row,
    targets: Mapping[str, float],
    spreads: Mapping[str, float],
    rng: np.random.Generator,
) -> Iterable[Change]:
    for target, scale in targets.items():
        parameters = dict[str, float]()
        for key, family in row.families.items():
            value = scale * spreads[family] * float(rng.standard_normal())
            value = abs(value) if row.one_sided else value
            # A spring stiffer than any number that may be typed is none.
            if value != 0.0 and not (row.inverse and LARGEST * abs(value) < 1.0):
                parameters[key] = 1.0 / value if row.inverse else value
        if parameters:
            yield Change(row.effect, target, parameters)


def _targets(robot: Robot) -> dict[str, dict[str, float]]:
    """Return the targets of every effect, and what their spread is to be multiplied with."""
    tree = robot.tree
    masses = {link.name: link.mass for link in tree.links if link.mass > 0.0}
    sensors, feet = dict.fromkeys(robot.sensors, 1.0), dict.fromkeys(robot.feet, 1.0)
    motors = {name: 1.0 for name in tree.joint_names if name in robot.motors}
    turning = {
        name: 1.0
        for name in tree.joint_names
        if tree.joints[tree.joint_index[name]].kind is not JointType.PRISMATIC
    }
    whole = {"": 1.0}
    of_feet = {foot.sensor: 1.0 for foot in robot.feet.values() if foot.sensor is not None}
    found = {
        "link_mass": masses,
        "link_com": dict.fromkeys(masses, 1.0),
        "link_length": {joint.name: 1.0 for joint in tree.joints if joint.is_movable},
        "sole_mass": of_feet,
        "sole_compliance": feet,
        "ground_tilt": whole if feet else {},
        "imu_mounting": whole if robot.imu_link is not None else {},
        "foot_placement": feet,
        "cable_pull": {tree.links[0].name: 1.0},
    }
    for row in _ROWS:
        if row.effect in found:
            continue
        kinds = EFFECTS[row.effect].targets
        motor = row.effect in ("joint_friction", "torque_constant", "current_offset")
        if TargetKind.SENSOR in kinds:
            found[row.effect] = sensors
        else:
            found[row.effect] = motors if motor else turning
    return found
