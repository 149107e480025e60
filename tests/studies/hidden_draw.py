# SPDX-License-Identifier: Apache-2.0
"""Draws of what is hidden: effects of a wanted size, mistakes of wiring, things without a name."""

from __future__ import annotations

import numpy as np
from hidden_columns import change_at, keys_of
from hidden_ruler import Ruler
from hidden_scenario import Pair, scenario, targets

from comcal.robot.changes import IMU, Change, names_of
from comcal.robot.changes_kinds import TargetKind
from comcal.robot.changes_table import CHANNELS, IMU_CHANNELS
from comcal_sims.faults.support import FUNCTIONS

ONE_SIDED = {
    "joint_compliance",
    "backlash",
    "joint_friction",
    "sole_compliance",
    "payload",
}
"""Effects whose parameters are positive, or none."""
SPARSE = 9
"""Effects with more parameters than this have one to three of them at once."""
PLACE = 0.10
"""How far from its link's CoM a payload sits, in every direction [m]."""
HEAVY_LINK = 0.5
"""Links that something can be strapped to weigh as much [kg]."""
TRIES = 40

WIRING = ("channel_swap", "sign_flip", "unit_error", "frame_handedness", "left_right_swap")
AMPLITUDES = {
    "eccentricity": 0.02,
    "hardening": 0.01,
    "torque_ripple": 5.0,
    "curvature": 3e-5,
    "creep": 0.05,
    "sliding_mass": 0.03,
    "uneven_floor": 0.01,
    "imu_curvature": 0.003,
}
"""Of functions outside the catalogue, about what a fault is."""
ARM_LENGTH = 0.6
"""From shoulder to hand [m]."""
KGF, LBF, DEGREE = 1.0 / 9.80665, 0.224809, 180.0 / np.pi


def coordinates(pair: Pair, rng: np.random.Generator) -> np.ndarray:
    """Draw a direction: parameters of the order of a fault."""
    effect, target = pair
    keys, fault = keys_of(pair), np.array(list(scenario().fault(effect).values()))
    c = fault * rng.uniform(-1.0, 1.0, len(keys))
    if effect == "payload":
        tree = scenario().robot.tree
        place = tree.links[tree.link_index[target]].com + rng.uniform(-PLACE, PLACE, 3)
        return np.array([1.0, *place])
    if effect == "tether":
        way = rng.standard_normal(3)
        way /= np.linalg.norm(way)
        k = rng.uniform(30.0, 150.0) * np.outer(way, way)
        return np.array([*(rng.uniform(3.0, 10.0) * way), *np.diag(k), k[0, 1], k[0, 2], k[1, 2]])
    if len(keys) > SPARSE:
        chosen = rng.permutation(len(keys))[: rng.integers(1, 4)]
        c[np.setdiff1d(np.arange(len(keys)), chosen)] = 0.0
    return np.abs(c) if effect in ONE_SIDED else c


def change_of(pair: Pair, c: np.ndarray) -> Change:
    """Return the change at coordinates: of a payload, mass and first moments."""
    if pair[0] == "payload":
        values = [float(c[0]), *(c[1:] / c[0]).tolist()]
        return Change(*pair, dict(zip(keys_of(pair), values, strict=True)))
    return change_at(pair, c)


def of_size(
    ruler: Ruler, pair: Pair, wanted: float, rng: np.random.Generator, largest: float | None = None
) -> tuple[Change, np.ndarray] | None:
    """Draw a change of an effect that has a wanted size if it is as linear as a small one.

    Parameters
    ----------
    ruler : Ruler
    pair : Pair
    wanted : float
        Size s.
    rng : numpy.random.Generator
    largest : float, optional
        Of any parameter, in faults; default the scenario's.

    Returns
    -------
    change : Change
    x : array, shape (m,)
        What it does to the whitened rows, to first order. None instead of both where a change of
        this size would be no plausible fault.
    """
    fault = np.array(list(scenario().fault(pair[0]).values()))
    most: float = scenario().data["largest"] if largest is None else largest
    faults = ruler.faults(pair)
    for _ in range(TRIES):
        c = coordinates(pair, rng)
        x = faults @ (c / fault)
        norm = float(np.linalg.norm(x))
        if norm <= 0.0:
            return None
        c *= wanted / norm
        if _plausible(pair, c, fault, most):
            return change_of(pair, c), x * (wanted / norm)
    return None


def scaled(change: Change, factor: float) -> Change:
    """Return a change with all parameters so many times as large; a body stays where it is."""
    held = ("com_x", "com_y", "com_z") if change.effect == "payload" else ()
    values = {key: change.number(key) for key in change.parameters}
    return Change(
        change.effect,
        change.target,
        {
            key: value if key in held else value / factor if key == "stiffness" else value * factor
            for key, value in values.items()
        },
    )


def _plausible(pair: Pair, c: np.ndarray, fault: np.ndarray, largest: float) -> bool:
    tree = scenario().robot.tree
    if pair[0] == "payload":
        return bool(c[0] <= largest * fault[0])
    if pair[0] == "link_mass" and c[0] < -0.8 * tree.links[tree.link_index[pair[1]]].mass:
        return False
    return bool(np.all(np.abs(c) <= largest * fault))


def unknown_of_size(ruler: Ruler, wanted: float, rng: np.random.Generator) -> Change | None:
    """Draw something outside the catalogue with a wanted size; None if none is plausible."""
    names = list(FUNCTIONS)
    function = names[rng.integers(len(names))]
    places = [
        place
        for place in names_of(scenario().robot, FUNCTIONS[function])
        if FUNCTIONS[function] is not TargetKind.LINK or _mass(place) > HEAVY_LINK
    ]
    target = places[rng.integers(len(places))]
    sign = 1.0 if function in ("hardening", "creep", "uneven_floor") else rng.choice([-1.0, 1.0])
    amplitude = AMPLITUDES[function] * sign
    phase = float(rng.uniform(0.0, 2.0 * np.pi))

    def change(size: float) -> Change:
        more = {"phase": phase} if function in ("eccentricity", "torque_ripple") else {}
        values = {"function": (function,), "amplitude": float(size), **more}
        return Change("unknown", target, values)

    for _ in range(2):
        found = float(np.linalg.norm(ruler.difference((change(amplitude),))[0]))
        if found <= 0.0 or not 0.02 < wanted / found * abs(amplitude) / AMPLITUDES[function] < 6.0:
            return None
        amplitude *= wanted / found
    return change(amplitude)


def _mass(link: str) -> float:
    tree = scenario().robot.tree
    return tree.links[tree.link_index[link]].mass


def mistake(rng: np.random.Generator) -> Change:
    """Draw a mistake of wiring or of a driver."""
    robot = scenario().robot
    sensors, joints = list(robot.sensors), list(robot.tree.joint_names)
    kind = WIRING[rng.integers(len(WIRING))]
    place = str(rng.choice(["sensor", "joint", "imu"], p=[0.5, 0.3, 0.2]))
    if kind == "left_right_swap":
        if rng.random() < 0.5:
            return Change(kind, sensors[0], {"other": (sensors[1],)})
        joint = str(rng.choice([name for name in joints if name.startswith("l_")]))
        channel = str(rng.choice(["q", "i"]))
        return Change(kind, joint, {"other": (f"r{joint[1:]}",), "channels": (channel,)})
    if kind == "frame_handedness":
        target = str(rng.choice([*sensors, IMU]))
        return Change(kind, target, {"axis": (str(rng.choice(["x", "y", "z"])),)})
    if place == "joint":
        joint, channel = str(rng.choice(joints)), str(rng.choice(["q", "i"]))
        if kind == "channel_swap":
            other = str(rng.choice([name for name in joints if name != joint]))
            return Change(kind, joint, {"channels": (channel,), "other": (other,)})
        more = {"factor": DEGREE if channel == "q" else 1000.0} if kind == "unit_error" else {}
        return Change(kind, joint, {"channels": (channel,), **more})
    if place == "imu":
        axes = tuple(map(str, rng.permutation(IMU_CHANNELS)))
        if kind == "channel_swap":
            return Change(kind, IMU, {"channels": axes[:2]})
        if kind == "unit_error":
            return Change(kind, IMU, {"channels": IMU_CHANNELS, "factor": KGF})
        return Change(kind, IMU, {"channels": axes[:1] if rng.random() < 0.5 else IMU_CHANNELS})
    sensor = str(rng.choice(sensors))
    if kind == "channel_swap":
        same_kind = CHANNELS[:3] if rng.random() < 0.5 else CHANNELS[3:]
        return Change(kind, sensor, {"channels": tuple(map(str, rng.permutation(same_kind)[:2]))})
    parts = [CHANNELS, CHANNELS[:3], CHANNELS[3:]]
    if kind == "unit_error":
        which = int(rng.integers(3))
        factor = float(rng.choice([[KGF, LBF], [KGF, LBF], [1000.0, 100.0]][which]))
        return Change(kind, sensor, {"channels": parts[which], "factor": factor})
    single = (str(rng.choice(CHANNELS)),)
    return Change(kind, sensor, {"channels": [*parts, single][rng.integers(4)]})


def contacts(rng: np.random.Generator, poses: tuple[int, ...]) -> tuple[Change, ...]:
    """Draw a hand that touches something in one to three poses, each time with another force."""
    arm = str(rng.choice(["l_arm", "r_arm"]))
    touched = sorted(rng.permutation(poses)[: rng.integers(1, 4)].tolist())
    found = list[Change]()
    for pose in touched:
        way = rng.standard_normal(3)
        force = rng.uniform(10.0, 30.0) * way / np.linalg.norm(way)
        values = dict(zip(("force_x", "force_y", "force_z"), force.tolist(), strict=True))
        values |= {"point_z": -ARM_LENGTH, "poses": (pose,)}
        found.append(Change("external_contact", arm, values))
    return tuple(found)


def gate(rng: np.random.Generator, poses: tuple[int, ...]) -> Change:
    """Draw readings that are not worth fitting.

    A sensor that is late is none of them: it shows in nothing that stands still.
    """
    robot = scenario().robot
    sensor, joint = str(rng.choice(list(robot.sensors))), str(rng.choice(robot.tree.joint_names))
    kinds = ("not_settled", "frozen_sensor", "saturation", "quantisation")
    kind = kinds[rng.integers(len(kinds))]
    if kind == "not_settled":
        return Change(kind, "", {"time": float(rng.uniform(3.0, 5.0))})
    if kind == "saturation":
        level = float(rng.uniform(300.0, 450.0))
        return Change(kind, sensor, {"channels": ("fz",), "level": level})
    if kind == "quantisation":
        if rng.random() < 0.5:
            return Change(kind, sensor, {"channels": CHANNELS[:3], "step": 4.0})
        return Change(kind, joint, {"channels": ("i",), "step": 0.4})
    first = int(rng.integers(3, len(poses) - 4))
    stuck = tuple(poses[first : first + int(rng.integers(2, 5))])
    if rng.random() < 0.5:
        return Change(kind, sensor, {"channels": CHANNELS, "poses": stuck})
    return Change(kind, joint, {"channels": ("q",), "poses": stuck})


def heavy(rng: np.random.Generator, mass: float) -> Change:
    """Draw a body of a given mass, strapped somewhere to a random link."""
    links = [name for name in targets(scenario().robot, "payload") if _mass(name) > HEAVY_LINK]
    pair = ("payload", str(rng.choice(links)))
    return change_of(pair, mass * coordinates(pair, rng))
