# SPDX-License-Identifier: Apache-2.0
"""The convex solids that links fill: primitives of the URDF, and hulls of its STL meshes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]  # a compiled module
from scipy.spatial import ConvexHull, QhullError

from comcal.robot.frames import rotation_from_rpy, transform_from
from comcal.robot.model import Robot
from comcal.robot.soles import box_corners
from comcal.robot.tree import Array, Box

STL_HEADER, STL_TRIANGLE = 84, 50
"""Bytes of the header and of each triangle of a binary STL file."""


@dataclass(frozen=True)
class Solid:
    """One convex piece of a link.

    Parameters
    ----------
    link : int
    points : array, shape (k, 3)
        Its corners, or those of a box around it, in the link frame [m].
    box : Box or None
        The primitive; None: the hull of *points*.
    """

    link: int
    points: Array
    box: Box | None = None


@dataclass(frozen=True)
class Solids:
    """What is known about the shape of a robot.

    Parameters
    ----------
    solids : tuple of Solid
    unread : tuple of str
        Links whose meshes could not be read, in tree order.
    shapeless : tuple of str
        Links with mass but without collision geometry.
    """

    solids: tuple[Solid, ...]
    unread: tuple[str, ...]
    shapeless: tuple[str, ...]


def solids_of(robot: Robot) -> Solids:
    """Return the collision geometry of *robot* as convex solids.

    Parameters
    ----------
    robot : Robot

    Returns
    -------
    Solids
        Meshes are taken as their convex hulls, which hold more than they do. STL files are found
        from the URDF: ``package://`` paths in a folder above it.
    """
    found: list[Solid] = []
    for k, link in enumerate(robot.tree.links):
        found += [Solid(k, box_corners(box), box) for box in link.boxes]
    unread: list[str] = []
    index = robot.tree.link_index
    if robot.urdf_path is not None:
        for link, path, T_link_mesh, scale in _meshes(robot.urdf_path):
            hull = None if path is None else _hull(path, scale)
            if hull is None:
                unread.append(link)
            elif link in index:
                found.append(Solid(index[link], hull @ T_link_mesh[:3, :3].T + T_link_mesh[:3, 3]))
    shaped = {solid.link for solid in found}
    names = [link.name for link in robot.tree.links]
    return Solids(
        tuple(found),
        tuple(name for name in names if name in unread),
        tuple(
            link.name
            for k, link in enumerate(robot.tree.links)
            if k not in shaped and link.mass > 0.0 and link.name not in unread
        ),
    )


def _meshes(urdf: Path) -> Iterator[tuple[str, Path | None, Array, Array]]:
    """Yield link, file, pose and scale of every collision mesh of a URDF."""
    parser = etree.XMLParser(resolve_entities=False, no_network=True, remove_comments=True)
    for link in etree.parse(str(urdf), parser).getroot().iterfind("link"):
        for collision in link.iterfind("collision"):
            mesh = collision.find("geometry/mesh")
            if mesh is None:
                continue
            origin = collision.find("origin")
            xyz, rpy = (
                _numbers(None if origin is None else origin.get(key), "0 0 0")
                for key in ("xyz", "rpy")
            )
            T = transform_from(rotation_from_rpy(rpy), xyz)
            scale = _numbers(mesh.get("scale"), "1 1 1")
            yield link.get("name", ""), _file(urdf, mesh.get("filename", "")), T, scale


def _numbers(text: str | None, default: str) -> Array:
    return np.array([float(x) for x in (text or default).split()])


def _file(urdf: Path, name: str) -> Path | None:
    """Return the file a URDF means, or None where it is not there or not STL."""
    plain = name.split("://", 1)[-1]
    if not plain.lower().endswith(".stl"):
        return None
    if not name.startswith("package://"):
        path = Path(plain) if Path(plain).is_absolute() else urdf.parent / plain
        return path if path.is_file() else None
    in_package = plain.split("/", 1)[-1]
    for folder in urdf.resolve().parents:
        for path in (folder / plain, folder / in_package):
            if path.is_file():
                return path
    return None


def _hull(path: Path, scale: Array) -> Array | None:
    """Return the corners of a mesh's convex hull, shape (k, 3) [m]; None where it has no volume."""
    corners = read_stl(path)
    if corners is None:
        return None
    try:
        return corners[ConvexHull(corners).vertices] * scale
    except (QhullError, ValueError):
        return None


def read_stl(path: Path) -> Array | None:
    """Return the corners of the triangles of an STL file, shape (k, 3), or None if it is not one.

    Parameters
    ----------
    path : Path
        Binary or text.
    """
    data = path.read_bytes()
    if len(data) >= STL_HEADER:
        count = int.from_bytes(data[STL_HEADER - 4 : STL_HEADER], "little")
        if len(data) == STL_HEADER + STL_TRIANGLE * count:
            triangles = np.frombuffer(data, np.uint8, offset=STL_HEADER).reshape(-1, STL_TRIANGLE)
            # A normal (3 numbers), three corners, and two bytes that mean nothing.
            numbers = np.ascontiguousarray(triangles[:, 12:48]).view("<f4")
            return numbers.reshape(-1, 3).astype(np.float64)
    try:
        lines = [line.split() for line in data.decode("ascii").splitlines()]
        corners = [[float(x) for x in line[1:4]] for line in lines if line[:1] == ["vertex"]]
    except ValueError:
        return None
    return np.array(corners) if corners and all(len(c) == 3 for c in corners) else None
