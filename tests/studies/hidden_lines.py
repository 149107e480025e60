# SPDX-License-Identifier: Apache-2.0
"""The lines of the study: what each hides, how large, in which poses, and what is assumed of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from importlib.util import find_spec

import numpy as np
from hidden_columns import BUILTIN, BY_LOAD, MUJOCO
from hidden_draw import contacts, gate, heavy, mistake, of_size, scaled, unknown_of_size
from hidden_ruler import Size, ruler
from hidden_scenario import Pair, scenario, tolerances

from comcal.robot.changes import Change
from comcal.robot.model import Robot

CLEAR = 8.0
"""Separation from which an effect has to be named by itself."""
LARGE = (15.0, 40.0)
SMALL = (8.0, 10.0)
PYBULLET_SHARE = 0.8
"""Of the trials in an engine; the others are MuJoCo's."""
SAME_SIZE = 0.03
DRAWS = 2000
FAMILIES_OF_TEN = (
    "link_mass",
    "link_com",
    "link_length",
    "ft_gain",
    "ft_crosstalk",
    "joint_offset",
    "joint_compliance",
    "backlash",
    "hysteresis",
    "joint_friction",
    "torque_constant",
    "current_offset",
)
SMALL_FAMILIES = (
    "ft_bias_force",
    "ft_bias_moment",
    "ft_mounting",
    "ft_position",
    "sole_compliance",
    "ground_tilt",
    "imu_mounting",
)


@dataclass(frozen=True)
class Case:
    """One trial before it is recorded.

    Parameters
    ----------
    poses : str
        Name of the pose set.
    engine : str
    hidden : tuple of Change
        Beside what a healthy robot has.
    sizes : tuple of Size
        Of each hidden effect; empty where sizes have no meaning.
    assumed : Robot
        What the diagnosis is told of the robot: tolerances may be others than the true ones.
    currents : bool
        Whether there are any.
    published : bool
        Whether the model has the term of the paper, which the robot has not.
    again : str
        Pose set in which the extended model is run again; empty: it is not.
    note : str
        What was special, for the table.
    """

    poses: str = "mixed"
    engine: str = "pybullet"
    hidden: tuple[Change, ...] = ()
    sizes: tuple[Size, ...] = ()
    assumed: Robot = field(default_factory=lambda: scenario().robot)
    currents: bool = True
    published: bool = False
    again: str = ""
    note: str = ""


def an_engine(rng: np.random.Generator) -> str:
    """Draw an engine among those that are installed."""
    first = "pybullet" if rng.random() < PYBULLET_SHARE else "mujoco"
    other = {"pybullet": "mujoco", "mujoco": "pybullet"}[first]
    return first if find_spec(first) is not None else other


def any_pair(rng: np.random.Generator, poses: str) -> Pair:
    """Draw one of all effects at all targets, but for those that these poses are blind to."""
    pairs, blind = ruler(poses).pairs, set(ruler(poses).blind(LARGE[0]))
    seen = [pair for pair in pairs if pair not in blind]
    return seen[rng.integers(len(seen))]


def single(
    rng: np.random.Generator,
    engine: str,
    sizes: tuple[float, float],
    separations: tuple[float, float] = (0.0, np.inf),
    poses: str = "mixed",
) -> Case:
    """Draw one effect with size and separation in a range."""
    measure = ruler(poses)
    for _ in range(DRAWS):
        pair, wanted = any_pair(rng, poses), rng.uniform(*sizes)
        drawn = of_size(measure, pair, wanted, rng)
        if drawn is None:
            continue
        # First order tells quickly whether it is worth asking the engine.
        if separations[0] <= measure.left(pair, drawn[1])[0] < separations[1]:
            change, size = _sized(pair, drawn[0], wanted, poses, engine)
            return Case(poses, engine, (change,), (size,))
    raise LookupError("no effect of this size and separation was drawn")


def _sized(
    pair: Pair, change: Change, wanted: float, poses: str, engine: str
) -> tuple[Change, Size]:
    """Return a change of a size that is the wanted one where it is measured.

    How two feet share the load is another matter in MuJoCo, and with it what depends on it.
    """
    engine = _ruled_in(engine, pair)
    found = ruler(poses, engine).size(pair, (change,), engine)
    factor = wanted / max(found.s, 0.5 * wanted)
    if abs(factor - 1.0) < SAME_SIZE:
        return change, found
    change = scaled(change, factor)
    return change, ruler(poses, engine).size(pair, (change,), engine)


def _ruled_in(engine: str, pair: Pair) -> str:
    """Return the world in which a size is measured: plain statics, where the engine agrees.

    Of 40 draws pybullet gave sizes within 0.5 % of it; MuJoCo shares loads of two feet otherwise.
    """
    return engine if engine == MUJOCO and pair[0] in BY_LOAD else BUILTIN


def healthy(rng: np.random.Generator, engine: str) -> Case:
    """Hide nothing; one of five robots stands in an engine."""
    return Case(engine=engine if rng.random() < 0.2 else BUILTIN)


def two(rng: np.random.Generator, engine: str) -> Case:
    """Draw two effects that can be told from each other and from their rivals."""
    measure = ruler("mixed")
    for _ in range(DRAWS):
        pairs = [any_pair(rng, "mixed") for _ in range(2)]
        maybe = [of_size(measure, pair, 20.0, rng) for pair in pairs]
        drawn = [one for one in maybe if one is not None]
        if pairs[0] == pairs[1] or len(drawn) < 2:
            continue
        apart = [
            measure.left(pair, x, beside=(other,))[0]
            for pair, (_, x), other in zip(pairs, drawn, reversed(pairs), strict=True)
        ]
        if min(apart) >= CLEAR:
            sized = [
                _sized(p, c, 20.0, "mixed", engine) for p, (c, _) in zip(pairs, drawn, strict=True)
            ]
            sizes = [replace(size, d=d) for (_, size), d in zip(sized, apart, strict=True)]
            return Case("mixed", engine, tuple(c for c, _ in sized), tuple(sizes))
    raise LookupError("no two effects were drawn")


def unknown(rng: np.random.Generator, engine: str, sizes: tuple[float, float]) -> Case:
    """Draw something outside the catalogue."""
    measure = ruler("mixed")
    for _ in range(DRAWS):
        change = unknown_of_size(measure, rng.uniform(*sizes), rng)
        if change is not None:
            s = float(np.linalg.norm(measure.difference((change,))[0]))
            return Case("mixed", engine, (change,), (Size(s, s, ("", "")),))
    raise LookupError("nothing of this size was drawn")


def discrete(rng: np.random.Generator, engine: str) -> Case:
    """Draw a mistake that shows."""
    measure = ruler("mixed")
    for _ in range(DRAWS):
        change = mistake(rng)
        s = float(np.linalg.norm(measure.difference((change,))[0]))
        if s >= LARGE[0]:
            return Case("mixed", engine, (change,), (Size(s, s, ("", "")),))
    raise LookupError("no mistake was drawn")


def contact(rng: np.random.Generator, engine: str) -> Case:
    """Draw a hand that touches something in one to three poses, each time so that it shows.

    A robot that hangs feels no force that points through its shoulder.
    """
    measure = ruler("mixed")
    poses = tuple(pose.pose for pose in measure.stage.poses)
    for _ in range(DRAWS):
        hands = contacts(rng, poses)
        norms = [float(np.linalg.norm(measure.difference((hand,))[0])) for hand in hands]
        if min(norms) >= LARGE[0]:
            return Case("mixed", engine, hands, tuple(Size(s, s, ("", "")) for s in norms))
    raise LookupError("no hand that shows was drawn")


def gated(rng: np.random.Generator, engine: str) -> Case:
    """Draw readings that should not be fitted."""
    poses = tuple(pose.pose for pose in scenario().stage("mixed").poses)
    return Case("mixed", engine, (gate(rng, poses),))


def published(rng: np.random.Generator, engine: str) -> Case:
    """Let the model have the term of the paper."""
    truth = Change("internal_torque_term", "", {"factor": -1.0})
    return Case("mixed", engine, (truth,), published=True)


def mistold(rng: np.random.Generator, engine: str, factors: Mapping[str, float], note: str) -> Case:
    """Tell the diagnosis other tolerances than the robot has."""
    case = single(rng, engine, LARGE, (CLEAR, np.inf))
    return replace(case, assumed=robot_told(factors), note=note)


def robot_told(factors: Mapping[str, float]) -> Robot:
    """Return the robot with tolerances that are stated wrong by these factors."""
    families = {
        family: sigma * factors.get(family, factors.get("", 1.0))
        for family, sigma in scenario().data["tolerances"].items()
    }
    return replace(scenario().robot, tolerances=tolerances(families))


def one_family(rng: np.random.Generator, engine: str) -> Case:
    """State the tolerance of one large family three times too small or too large."""
    family = FAMILIES_OF_TEN[rng.integers(len(FAMILIES_OF_TEN))]
    factor = 3.0 if rng.random() < 0.5 else 1.0 / 3.0
    return mistold(rng, engine, {family: factor}, f"{family} x {factor:.2g}")


def small_family(rng: np.random.Generator, engine: str) -> Case:
    """State the tolerance of one small family three times too small; nothing else is hidden."""
    family = SMALL_FAMILIES[rng.integers(len(SMALL_FAMILIES))]
    told = robot_told({family: 1.0 / 3.0})
    return Case(engine=engine, assumed=told, note=family)


def five_kg(rng: np.random.Generator, engine: str, *, currents: bool) -> Case:
    """Strap 5 kg to a random link."""
    return Case("mixed", engine, (heavy(rng, 5.0),), currents=currents)


def ambiguous(
    rng: np.random.Generator,
    engine: str,
    pairs: tuple[Pair, ...],
    poses: str,
    sizes: tuple[float, float],
    judged_in: str,
    keep: tuple[str, ...] = (),
) -> Case:
    """Draw one of some effects that look alike, of a size that the poses *judged_in* give it.

    Parameters
    ----------
    keep : tuple of str
        Keys that are hidden, where not all.
    """
    measure = ruler(judged_in)
    for _ in range(DRAWS):
        pair = pairs[rng.integers(len(pairs))]
        drawn = of_size(measure, pair, rng.uniform(*sizes), rng, largest=8.0)
        if drawn is None:
            continue
        change = drawn[0]
        if keep and set(keep) & set(change.parameters):
            kept = {k: v for k, v in change.parameters.items() if k in keep}
            change = replace(change, parameters=kept)
        ruled_in = _ruled_in(engine, pair)
        size = ruler(judged_in, ruled_in).size(pair, (change,), ruled_in)
        if size.s >= sizes[0]:
            return Case(poses, engine, (change,), (size,))
    raise LookupError("none of these effects was drawn")


def _drift(rng: np.random.Generator, engine: str, poses: str) -> Case:
    sensor = str(rng.choice(list(scenario().robot.sensors)))
    pairs = (("ft_drift", sensor), ("ft_temperature", sensor))
    return ambiguous(rng, engine, pairs, poses, LARGE, "warming")


def _cable(rng: np.random.Generator, engine: str, poses: str) -> Case:
    pairs = (("cable_pull", "torso"), ("link_mass", "torso"))
    return ambiguous(rng, engine, pairs, poses, (15.0, 25.0), "upright", ("force_z", "mass"))


def _shoulder(rng: np.random.Generator, engine: str) -> Case:
    side = str(rng.choice(["l", "r"]))
    pairs = (("joint_offset", f"{side}_shoulder"), ("link_com", f"{side}_arm"))
    return ambiguous(rng, engine, pairs, "mixed", (15.0, 25.0), "mixed", ("offset", "com_x"))


LINES: Mapping[str, Callable[[np.random.Generator, str], Case]] = {
    "single": lambda rng, engine: single(rng, engine, LARGE, (CLEAR, np.inf)),
    "close": lambda rng, engine: single(rng, engine, LARGE, (0.0, CLEAR)),
    "small": lambda rng, engine: single(rng, engine, SMALL, (CLEAR, np.inf)),
    "healthy": healthy,
    "two": two,
    "unknown": lambda rng, engine: unknown(rng, engine, (25.0, 50.0)),
    "unknown_small": lambda rng, engine: unknown(rng, engine, (4.0, 12.0)),
    "discrete": discrete,
    "contact": contact,
    "gate": gated,
    "published": published,
    "half": lambda rng, engine: mistold(rng, engine, {"": 0.5}, "all x 0.5"),
    "double": lambda rng, engine: mistold(rng, engine, {"": 2.0}, "all x 2"),
    "family": one_family,
    "small_family": small_family,
    "five_kg": lambda rng, engine: five_kg(rng, engine, currents=True),
    "five_kg_no_currents": lambda rng, engine: five_kg(rng, engine, currents=False),
    "drift": lambda rng, engine: _drift(rng, engine, "warming"),
    "drift_revisited": lambda rng, engine: _drift(rng, engine, "mixed"),
    "cable": lambda rng, engine: _cable(rng, engine, "upright"),
    "cable_moved": lambda rng, engine: _cable(rng, engine, "mixed"),
    "shoulder": _shoulder,
    "again": lambda rng, engine: replace(
        single(rng, engine, LARGE, (CLEAR, np.inf)), again="other"
    ),
}
"""By name."""
