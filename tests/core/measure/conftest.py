# SPDX-License-Identifier: Apache-2.0
"""A small biped by hand: torso, two legs with hip and ankle pitch, a sensor above each sole."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest

from comcal.robot.frames import transform_from
from comcal.robot.kinematics import place_links
from comcal.robot.model import Foot, Noise, Robot, Sensor
from comcal.robot.tree import Joint, JointType, Link, Tree

SOLE = np.array([[0.12, 0.09], [-0.08, 0.09], [-0.08, -0.09], [0.12, -0.09]])
CHANNELS = ("fx", "fy", "fz", "tx", "ty", "tz")


def _link(name: str, mass: float, com: Sequence[float]) -> Link:
    return Link(name, mass, np.array(com), np.eye(3) * mass * 0.01)


def _joint(name: str, kind: JointType, parent: str, child: str, p: Sequence[float]) -> Joint:
    axis = np.array([0.0, 1.0, 0.0]) if kind is not JointType.FIXED else np.zeros(3)
    return Joint(name, kind, parent, child, transform_from(np.eye(3), p), axis, -1.5, 1.5)


def _leg(side: str, y: float) -> tuple[list[Link], list[Joint]]:
    links = [
        _link(f"{side}_leg", 5.0, [0.0, 0.0, -0.25]),
        _link(f"{side}_foot", 0.5, [0.0, 0.0, -0.03]),
        _link(f"{side}_sole", 0.2, [0.02, 0.0, -0.01]),
    ]
    joints = [
        _joint(f"{side}_hip", JointType.REVOLUTE, "torso", f"{side}_leg", [0, y, 0]),
        _joint(f"{side}_ankle", JointType.REVOLUTE, f"{side}_leg", f"{side}_foot", [0, 0, -0.5]),
        _joint(f"{side}_ft", JointType.FIXED, f"{side}_foot", f"{side}_sole", [0, 0, -0.06]),
    ]
    return links, joints


@pytest.fixture
def biped() -> Robot:
    left_links, left_joints = _leg("l", 0.1)
    right_links, right_joints = _leg("r", -0.1)
    tree = Tree(
        "small",
        (_link("torso", 30.0, [0.01, 0.03, 0.2]), *left_links, *right_links),
        (*left_joints, *right_joints),
    )
    return Robot(
        "small",
        tree,
        sensors={"l": Sensor("l", "l_ft"), "r": Sensor("r", "r_ft")},
        feet={
            "left": Foot("left", "l_sole", "l", SOLE, np.eye(4), "l_ankle"),
            "right": Foot("right", "r_sole", "r", SOLE, np.eye(4), "r_ankle"),
        },
        noise=Noise(),
    )


def static_wrenches(
    robot: Robot, q: Sequence[float], support: str, share: float = 0.5
) -> dict[str, np.ndarray]:
    """Return ground on robot at rest on level ground, soles parallel to it (vertical forces)."""
    placed = place_links(robot.tree, q)
    masses, coms, g = robot.tree.masses, placed.coms[0], robot.gravity
    below = {name: robot.below_cut[name] for name in robot.sensors}
    weight = {"l": 0.0, "r": 0.0}
    above = ~(below["l"] | below["r"])
    if support == "double":
        weight = {"l": share, "r": 1 - share}
    else:
        weight["l" if support == "left" else "r"] = 1.0
        above = above | below["r" if support == "left" else "l"]
    out: dict[str, np.ndarray] = {}
    m, c = masses[above].sum(), (masses[above, None] * coms[above]).sum(0) / masses[above].sum()
    for name in ("l", "r"):
        R, p = placed.joint(f"{name}_ft")
        force, moment = np.zeros(3), np.zeros(3)
        if weight[name]:  # a share of the weight, and of its moment about this sensor
            force = np.array([0.0, 0.0, weight[name] * m * g])
            total_moment = np.cross(c - p[0], [0.0, 0.0, m * g])
            moment = weight[name] * total_moment
            if support == "double":  # in x the share moves with the CoM, in y the feet differ
                moment[0] = 0.0
        else:  # what hangs below the cut pulls on what is above it
            hung = below[name]
            for mk, ck in zip(masses[hung], coms[hung], strict=True):
                f = np.array([0.0, 0.0, -mk * g])
                force = force + f
                moment = moment + np.cross(ck - p[0], f)
        out[name] = np.concatenate([R[0].T @ force, R[0].T @ moment])
    return out


def share_of(robot: Robot, q: Sequence[float]) -> float:
    """Return the share of the left foot that puts the CoP under the CoM laterally."""
    placed = place_links(robot.tree, q)
    above = ~(robot.below_cut["l"] | robot.below_cut["r"])
    m = robot.tree.masses[above]
    y = float((m * placed.coms[0, above, 1]).sum() / m.sum())
    return (y + 0.1) / 0.2


WriteTable = Callable[..., Path]


@pytest.fixture
def rows(biped: Robot) -> list[dict[str, object]]:
    """Rows of a valid poses.csv of the biped: double, left, right."""
    shapes = [
        (1, "double", [0.1, -0.1, 0.1, -0.1]),
        (2, "double", [-0.05, 0.05, -0.05, 0.05]),
        (3, "left", [0.0, 0.0, -0.3, 0.3]),
        (4, "right", [-0.3, 0.3, 0.0, 0.0]),
    ]
    table: list[dict[str, object]] = []
    for pose, support, q in shapes:
        wrench = static_wrenches(biped, q, support, share_of(biped, q))
        row: dict[str, object] = {"pose": pose, "support": support}
        row |= {f"q.{j}": x for j, x in zip(biped.tree.joint_names, q, strict=True)}
        for name, w in wrench.items():
            row |= {f"ft.{name}.{c}": float(x) for c, x in zip(CHANNELS, w, strict=True)}
        table.append(row)
    return table


@pytest.fixture
def write_table(tmp_path: Path) -> WriteTable:
    """Return a function that writes rows (dicts) as a CSV file."""

    def write(rows: Sequence[Mapping[str, object]], name: str = "poses.csv") -> Path:
        header = list(dict.fromkeys(key for row in rows for key in row))
        lines = [",".join(header)]
        lines += [",".join(str(row.get(key, "")) for key in header) for row in rows]
        path = tmp_path / name
        path.write_text("\n".join(lines) + "\n")
        return path

    return write
