# SPDX-License-Identifier: Apache-2.0
"""The table of effects: names, targets, parameter keys with their units and ranges.

What a value means is its sign convention: *what is true minus what the model assumes*.

- ``ft_*``: measured w' = R(rotvec) (I + diag(gain) + E) w + b about the displaced origin; rotvec
  and offset in the nominal sensor frame; b grows by rate * t, and by rate * (T - T_first).
- ``joint_offset``: q_true = q_encoder + offset; ``joint_compliance``: + tau_gravity / stiffness,
  tau_gravity being what gravity exerts on the distal side about +axis, that is minus the joint
  torque; ``backlash``: + half_width * sign(tau_gravity); ``hysteresis``: + half_width * approach.
- ``torque_constant``: tau = (1 + relative) K gear sign i; ``current_offset``: i_measured =
  i_true + offset; ``joint_friction``: motor torque = joint torque + (coulomb + load_factor |tau|)
  * approach.
- ``ground_tilt``: R_world_P = Ry(pitch) Rx(roll). ``payload``, ``link_*``: in the URDF link frame.
- ``imu_mounting``: R_link_imu = Ry(pitch) Rx(roll).
- ``foot_placement``: the true sole in the sole frame that is assumed (roll, pitch, yaw as in URDF).
- ``sole_compliance``: the foot turns against the floor by -(tilt_x tx, tilt_y ty, 0), with the
  ground's moment on the robot about the sensor origin, in sole axes: it sinks where it is loaded.
- ``timing_skew``: reading(t) = true(t - time); ``not_settled``: what is read at a slope of dw/dt
  comes to rest at reading + time dw/dt.
- Forces and stiffness: axes of P, at the link's origin unless a point (link frame) is given;
  tether: force - k (x - x_first).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType

from comcal.robot.changes_kinds import EffectSpec, Key, KeyKind, Realisation, TargetKind
from comcal.robot.units import UNITS, Dimension

CHANNELS: tuple[str, ...] = ("fx", "fy", "fz", "tx", "ty", "tz")
"""Of a force/torque sensor."""
IMU_CHANNELS: tuple[str, ...] = ("ax", "ay", "az")
"""Of an IMU."""
JOINT_CHANNELS: tuple[str, ...] = ("q", "i", "tau")
"""Of a joint: encoder, current, torque."""


def _key(
    name: str, of: Dimension | str, *, required: bool = False, least: float | None = None
) -> Key:
    dimension = of if isinstance(of, Dimension) else None
    unit = next(iter(UNITS[of])) if isinstance(of, Dimension) else of
    return Key(
        name,
        unit,
        required=required,
        least=-math.inf if least is None else least,
        dimension=dimension,
    )


def _above_zero(name: str, of: Dimension, *, required: bool = True) -> Key:
    unit = next(iter(UNITS[of]))
    return Key(name, unit, required=required, least=0.0, above=True, dimension=of)


def _each(names: tuple[str, ...], of: Dimension | str) -> tuple[Key, ...]:
    return tuple(_key(name, of) for name in names)


def _wrench(force: Dimension | str, moment: Dimension | str) -> tuple[Key, ...]:
    return (*_each(CHANNELS[:3], force), *_each(CHANNELS[3:], moment))


def _crosstalk() -> tuple[Key, ...]:
    """Return the key of every pair of channels; ``fz_to_ty``: N m per N, hence m."""

    def unit(a: str, b: str) -> Dimension | str:
        if a[0] == b[0]:
            return Dimension.RATIO
        return Dimension.LENGTH if a[0] == "f" else "1/m"

    return tuple(_key(f"{a}_to_{b}", unit(a, b)) for a in CHANNELS for b in CHANNELS if a != b)


_POSES = Key("poses", "", KeyKind.POSES)
_CHANNELS = Key("channels", "", KeyKind.WORDS)
_SOME_CHANNELS = Key("channels", "", KeyKind.WORDS, required=True)
_XYZ = ("x", "y", "z")
_FORCE = ("force_x", "force_y", "force_z")
_POINT = ("point_x", "point_y", "point_z")
_COM = ("com_x", "com_y", "com_z")
STIFFNESS = ("k_xx", "k_yy", "k_zz", "k_xy", "k_xz", "k_yz")
"""Keys of a tether's symmetric stiffness."""

_L, _A, _F, _M = Dimension.LENGTH, Dimension.ANGLE, Dimension.FORCE, Dimension.MOMENT


def _spec(
    name: str,
    summary: str,
    targets: tuple[TargetKind, ...],
    keys: tuple[Key, ...],
    realisation: Realisation,
    *,
    has_all: bool = False,
) -> EffectSpec:
    by_name = MappingProxyType({key.name: key for key in keys})
    return EffectSpec(name, summary, frozenset(targets), by_name, realisation, has_all)


_LINK, _JOINT, _SENSOR = (TargetKind.LINK,), (TargetKind.JOINT,), (TargetKind.SENSOR,)
_FOOT, _NOWHERE = (TargetKind.FOOT,), (TargetKind.NONE,)
_READINGS = (TargetKind.SENSOR, TargetKind.JOINT, TargetKind.IMU)
_ENGINE, _FRAME, _MODEL = Realisation.ENGINE, Realisation.SENSOR_FRAME, Realisation.MODEL

_ALL_SPECS = (
    _spec("ft_bias", "offset of a force/torque sensor", _SENSOR, _wrench(_F, _M), _MODEL),
    _spec(
        "ft_gain",
        "relative error of the scale of channels",
        _SENSOR,
        _each(tuple(f"gain_{c}" for c in CHANNELS), Dimension.RATIO),
        _MODEL,
    ),
    _spec("ft_crosstalk", "channels leak into one another", _SENSOR, _crosstalk(), _MODEL),
    _spec(
        "ft_mounting", "sensor is mounted turned", _SENSOR, _each(("rx", "ry", "rz"), _A), _FRAME
    ),
    _spec("ft_position", "sensor origin is elsewhere", _SENSOR, _each(_XYZ, _L), _FRAME),
    _spec("ft_drift", "offset grows with time", _SENSOR, _wrench("N/s", "N m/s"), _MODEL),
    _spec("ft_temperature", "offset follows temperature", _SENSOR, _wrench("N/K", "N m/K"), _MODEL),
    _spec(
        "payload",
        "a body that the model does not know",
        _LINK,
        (_above_zero("mass", Dimension.MASS), *_each(_COM, _L)),
        _ENGINE,
    ),
    _spec(
        "link_mass",
        "mass of a link at its CoM",
        _LINK,
        (_key("mass", Dimension.MASS, required=True),),
        _ENGINE,
    ),
    _spec("link_com", "CoM of a link at its mass", _LINK, _each(_COM, _L), _ENGINE),
    _spec("link_length", "origin of a joint in its parent", _JOINT, _each(_XYZ, _L), _ENGINE),
    _spec(
        "sole_mass",
        "mass below a sensor's cut",
        _SENSOR,
        (_key("mass", Dimension.MASS, required=True),),
        _ENGINE,
    ),
    _spec(
        "joint_offset",
        "zero of an encoder",
        _JOINT,
        (_key("offset", _A, required=True),),
        _ENGINE,
    ),
    _spec(
        "joint_compliance",
        "spring between encoder and joint",
        _JOINT,
        (_above_zero("stiffness", Dimension.STIFFNESS),),
        _ENGINE,
        has_all=True,
    ),
    _spec(
        "backlash",
        "play between encoder and joint",
        _JOINT,
        (_key("half_width", _A, required=True, least=0.0),),
        _ENGINE,
    ),
    _spec(
        "hysteresis",
        "encoder lags behind where the joint came from",
        _JOINT,
        (_key("half_width", _A, required=True),),
        _ENGINE,
    ),
    _spec(
        "joint_friction",
        "stiction between motor and joint",
        _JOINT,
        (_key("coulomb", _M, least=0.0), _key("load_factor", Dimension.RATIO, least=0.0)),
        Realisation.ACTUATOR,
        has_all=True,
    ),
    _spec(
        "torque_constant",
        "torque per current of a motor",
        _JOINT,
        (Key("relative", "1", required=True, least=-1.0, above=True, dimension=Dimension.RATIO),),
        _MODEL,
        has_all=True,
    ),
    _spec(
        "current_offset",
        "offset of a current sensor",
        _JOINT,
        (_key("offset", Dimension.CURRENT, required=True),),
        _MODEL,
        has_all=True,
    ),
    _spec(
        "sole_compliance",
        "pad between foot and floor",
        _FOOT,
        (
            _key("tilt_x", Dimension.COMPLIANCE, least=0.0),
            _key("tilt_y", Dimension.COMPLIANCE, least=0.0),
        ),
        _ENGINE,
        has_all=True,
    ),
    _spec("ground_tilt", "the floor slopes", _NOWHERE, _each(("roll", "pitch"), _A), _ENGINE),
    _spec("imu_mounting", "IMU is mounted turned", _NOWHERE, _each(("roll", "pitch"), _A), _FRAME),
    _spec(
        "foot_placement",
        "a foot stands elsewhere",
        _FOOT,
        (*_each(_XYZ, _L), *_each(("roll", "pitch", "yaw"), _A)),
        _ENGINE,
    ),
    _spec("cable_pull", "constant force on a link", _LINK, _each(_FORCE, _F), _ENGINE),
    _spec(
        "tether",
        "springy cable at a link",
        _LINK,
        (*_each(_FORCE, _F), *_each(STIFFNESS, "N/m")),
        _ENGINE,
    ),
    _spec(
        "external_contact",
        "a link touches something",
        _LINK,
        (*_each(_FORCE, _F), *_each(_POINT, _L), _POSES),
        _ENGINE,
    ),
    _spec(
        "not_settled",
        "readings are taken before the robot is at rest",
        _NOWHERE,
        (_key("time", Dimension.TIME, required=True, least=0.0),),
        _ENGINE,
    ),
    _spec(
        "timing_skew",
        "a sensor's readings are late",
        _SENSOR,
        (_key("time", Dimension.TIME, required=True, least=0.0),),
        _MODEL,
    ),
    _spec(
        "inertia",
        "wrench of the measured acceleration (quasi-static data)",
        _NOWHERE,
        (_key("factor", Dimension.RATIO, required=True),),
        Realisation.NONE,
    ),
    _spec(
        "internal_torque_term",
        "M_2 in the moment balance, Muscolo (10)",
        _NOWHERE,
        (_key("factor", Dimension.RATIO, required=True),),
        Realisation.NONE,
    ),
    _spec(
        "channel_swap",
        "two channels are exchanged, or the same channel of two joints",
        _READINGS,
        (_SOME_CHANNELS, Key("other", "", KeyKind.WORDS)),
        _MODEL,
    ),
    _spec("sign_flip", "channels have the wrong sign", _READINGS, (_CHANNELS,), _MODEL),
    _spec(
        "unit_error",
        "channels are in another unit: reading = factor * true",
        _READINGS,
        (_CHANNELS, Key("factor", "1", required=True, least=0.0, above=True)),
        _MODEL,
    ),
    _spec(
        "frame_handedness",
        "one axis of a sensor points the other way",
        (TargetKind.SENSOR, TargetKind.IMU),
        (Key("axis", "", KeyKind.WORDS, required=True),),
        _MODEL,
    ),
    _spec(
        "left_right_swap",
        "two sensors, or two joints, are exchanged",
        (TargetKind.SENSOR, TargetKind.JOINT),
        (Key("other", "", KeyKind.WORDS, required=True), _CHANNELS),
        _MODEL,
    ),
    _spec(
        "frozen_sensor",
        "readings repeat their last value",
        _READINGS,
        (_CHANNELS, _POSES),
        _MODEL,
    ),
    _spec(
        "saturation",
        "readings stop at a level, in the channel's unit",
        _READINGS,
        (_CHANNELS, Key("level", "SI", required=True, least=0.0, above=True)),
        _MODEL,
    ),
    _spec(
        "quantisation",
        "readings lie on a grid, in the channel's unit",
        _READINGS,
        (_CHANNELS, Key("step", "SI", required=True, least=0.0, above=True)),
        _MODEL,
    ),
    _spec(
        "unknown",
        "something outside this catalogue: amplitude of a function at a place",
        (TargetKind.LINK, TargetKind.JOINT, TargetKind.SENSOR, TargetKind.FOOT, TargetKind.IMU),
        (
            Key("function", "", KeyKind.WORDS, required=True),
            Key("amplitude", "SI", required=True),
            _key("phase", _A),
        ),
        _ENGINE,
    ),
)

EFFECTS: Mapping[str, EffectSpec] = MappingProxyType({spec.name: spec for spec in _ALL_SPECS})
"""Every effect by name."""
