# SPDX-License-Identifier: Apache-2.0
"""Meshes as both kinds of STL, found from the URDF, and contacts as geometry has them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from comcal.plan.collision import collisions_of
from comcal.plan.solids import read_stl, solids_of
from comcal.robot.kinematics import place_links
from comcal.robot.model import Robot

CORNERS = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
FACES = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]


def binary() -> bytes:
    body = b"".join(
        np.zeros(3, "<f4").tobytes() + CORNERS[list(f)].astype("<f4").tobytes() + b"\0\0"
        for f in FACES
    )
    return b"\0" * 80 + len(FACES).to_bytes(4, "little") + body


def text() -> bytes:
    lines = ["solid s"]
    for face in FACES:
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += [f"vertex {' '.join(map(str, CORNERS[i]))}" for i in face]
        lines += ["endloop", "endfacet"]
    return "\n".join([*lines, "endsolid s"]).encode()


@pytest.mark.parametrize("content", [binary(), text()])
def test_both_kinds_of_stl_give_their_corners(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "mesh.stl"
    path.write_bytes(content)
    corners = read_stl(path)
    assert corners is not None
    np.testing.assert_array_equal(np.unique(corners, axis=0), np.unique(CORNERS, axis=0))


@pytest.mark.parametrize("content", [b"", b"solid nothing", b"\xff" * 200, b"vertex 1 2"])
def test_what_is_no_stl_is_not_read(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "mesh.stl"
    path.write_bytes(content)
    assert read_stl(path) is None


def test_meshes_of_a_published_robot_are_found(humanoid: Callable[[str], Robot]) -> None:
    robot = humanoid("g1")
    solids = solids_of(robot)
    assert not solids.unread
    assert "torso_link" in {robot.tree.links[s.link].name for s in solids.solids}


def test_missing_meshes_are_named(humanoid: Callable[[str], Robot], tmp_path: Path) -> None:
    robot = humanoid("g1")
    alone = tmp_path / "g1.urdf"
    alone.write_bytes(Path(str(robot.urdf_path)).read_bytes())
    assert "torso_link" in solids_of(replace(robot, urdf_path=alone)).unread


def test_feet_that_meet_touch_and_feet_that_stand_do_not(biped14: Any) -> None:
    pytest.importorskip("coal")
    tree = biped14.robot.tree
    collisions = collisions_of(tree, solids_of(biped14.robot))
    at_zero = place_links(tree, np.zeros((1, len(tree.joint_names))))
    inward = float(np.arctan2(at_zero.link("l_sole")[1][0, 1], -at_zero.link("l_sole")[1][0, 2]))
    crossed = biped14.pose(l_hip_roll=-inward, r_hip_roll=inward)
    apart = biped14.pose(l_hip_roll=0.3, r_hip_roll=-0.3)
    free = collisions.free(place_links(tree, np.stack([crossed, apart, 0.0 * apart])))
    assert free.tolist() == [False, True, True]
