# SPDX-License-Identifier: Apache-2.0
"""What a foot is when ``robot.yaml`` does not say: sole frame, sole outline and ankle.

All of it is read off the robot as it stands at q = 0 with the z axis of its root link up and the
x axis of its root link pointing to the toes.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from comcal.robot.frames import transform_from
from comcal.robot.kinematics import Placements, place_links
from comcal.robot.tree import Array, Box, JointType, Shape, Tree

CONTACT_DEPTH = 1e-3
"""Points of the collision geometry this close to the lowest one touch the ground [m]."""
_SMALLEST_AREA = 1e-6
_EDGE_ON = 1e-6
_PITCH_TOLERANCE = 1e-4
"""As an angle [rad]; a URDF that writes 1.5708 for a right angle is off by 4e-6."""


def place_at_zero(tree: Tree) -> Placements:
    """Place the links of *tree* at q = 0, one pose."""
    return place_links(tree, np.zeros((1, len(tree.joint_names))))


def default_sole_frame(tree: Tree, link: str) -> Array:
    """Return the sole frame that the collision geometry of a foot link suggests.

    Parameters
    ----------
    tree : Tree
    link : str
        Name of the foot link.

    Returns
    -------
    T_link_sole : array, shape (4, 4)
        z: the axis of the foot link or of one of its collision boxes that is nearest to the z of
        the root, so the foot may be pitched at q = 0. x: the x of the root, projected on the sole.
        Origin: the origin of the foot link, projected on the lowest plane of the collision
        geometry. Without collision geometry (meshes do not count): the frame of the foot link.
    """
    boxes = tree.links[tree.link_index[link]].boxes
    if not boxes:
        return np.eye(4)
    R_root_link = place_at_zero(tree).link(link)[0][0]
    axes = np.hstack([np.eye(3), *(box.T_link_box[:3, :3] for box in boxes)]).T
    axes = np.vstack([axes, -axes])
    up = axes[int(np.argmax(axes @ R_root_link[2]))]
    # z is within 55 deg of the root's z, so the root's x is never along it.
    x = R_root_link[0] - (R_root_link[0] @ up) * up
    x /= np.linalg.norm(x)
    R_link_sole = np.column_stack([x, np.cross(up, x), up])
    lowest = min(float(point @ up) for box in boxes for point in _extremes(box, R_link_sole))
    return transform_from(R_link_sole, lowest * up)


def sole_rectangle(tree: Tree, link: str, T_link_sole: Array) -> Array | None:
    """Return the bounding rectangle of what a foot touches the ground with.

    Parameters
    ----------
    tree : Tree
    link : str
        Name of the foot link.
    T_link_sole : array, shape (4, 4)
        Sole frame in the foot link.

    Returns
    -------
    array, shape (4, 2), or None
        Corners in the sole frame, counter-clockwise [m]; several spheres span a rectangle between
        their lowest points. None where it has no area: a single sphere, or no geometry at all.
    """
    R, p = T_link_sole[:3, :3], T_link_sole[:3, 3]
    boxes = tree.links[tree.link_index[link]].boxes
    if not boxes:
        return None
    points = (np.array([point for box in boxes for point in _extremes(box, R)]) - p) @ R
    touching = points[points[:, 2] <= points[:, 2].min() + CONTACT_DEPTH, :2]
    (x0, y0), (x1, y1) = touching.min(axis=0), touching.max(axis=0)
    if (x1 - x0) * (y1 - y0) < _SMALLEST_AREA:
        return None
    return np.array([[x1, y1], [x0, y1], [x0, y0], [x1, y0]])


def default_ankle(tree: Tree, link: str) -> str | None:
    """Return the nearest pitch joint above a foot.

    A pitch joint is revolute or continuous, and at q = 0 its axis is within 1e-4 rad of +-y of
    the root. It is looked for from the foot towards the root. When nothing moves in between, the
    foot is the root itself, and the first pitch joint of the largest limb hanging on it counts.

    Parameters
    ----------
    tree : Tree
    link : str
        Name of the foot link.

    Returns
    -------
    str or None
        Joint name; None where the leg has no pitch joint.
    """
    axes = place_at_zero(tree).axes()[0]
    turning = (JointType.REVOLUTE, JointType.CONTINUOUS)
    is_pitch = [
        joint.kind in turning and float(np.hypot(axis[0], axis[2])) < _PITCH_TOLERANCE
        for joint, axis in zip(tree.joints, axes, strict=True)
    ]
    moves = False
    k = tree.link_index[link]
    while k > 0:
        if is_pitch[k - 1]:
            return tree.joints[k - 1].name
        moves = moves or tree.joints[k - 1].is_movable
        k = int(tree.parents[k])
    if moves:
        return None
    pitch = [joint.name for joint, is_it in zip(tree.joints, is_pitch, strict=True) if is_it]
    return max(pitch, key=lambda name: int(tree.subtree(name).sum()), default=None)


def box_corners(box: Box) -> Array:
    """Return the corners of a bounding box in the link frame, shape (8, 3) [m]."""
    signs = np.array(list(np.ndindex(2, 2, 2))) - 0.5
    return box.T_link_box[:3, 3] + (signs * box.size) @ box.T_link_box[:3, :3].T


def _extremes(box: Box, R_link_sole: Array) -> Iterator[Array]:
    """Yield the points of a collision geometry that can touch the ground, in the link frame [m]."""
    if box.shape is Shape.BOX:
        yield from box_corners(box)
        return
    centre, radius = box.T_link_box[:3, 3], 0.5 * box.size[0]
    if box.shape is Shape.SPHERE:
        yield centre - radius * R_link_sole[:, 2]
        return
    axis = box.T_link_box[:3, 2]
    for end in (-0.5, 0.5):
        for direction in R_link_sole.T:
            across = direction - (direction @ axis) * axis
            length = float(np.linalg.norm(across))
            # A disc seen along its axis has no extreme point in that direction.
            if length > _EDGE_ON:
                yield centre + end * box.size[2] * axis + radius / length * across
                yield centre + end * box.size[2] * axis - radius / length * across
