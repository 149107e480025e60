# SPDX-License-Identifier: Apache-2.0
r"""Bodies: links joined by fixed joints, and how each one moves against the body before it.

Statics sees a body as four numbers, its mass and its first moments :math:`(m, h_x, h_y, h_z)`, and
a body's frame as the four columns that turn them into a first moment about the root origin:

.. math:: m\,c = [\,p\;\; x\;\; y\;\; z\,]\,(m, h_x, h_y, h_z)^T

Written with homogeneous rows (1, 0, 0, 0) above, the columns of a child follow from those of its
parent by a matrix that is linear in two numbers of the joint's position q,

.. math:: E(q) = E_1 + E_s s + E_v v,\qquad (s, v) = (\sin q, 1 - \cos q)\ \text{or}\ (q, 0)

for turning and for sliding joints, so one matrix product moves a body for all poses at once.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from comcal.robot.frames import skew
from comcal.robot.limbs import Limb, cut_limbs
from comcal.robot.tree import Array, JointType, Tree


@dataclass(frozen=True)
class Bodies:
    """The rigid bodies of a tree, parents before children.

    Body ``b >= 1`` hangs on the joint of its leading link; properties of shape (n_bodies - 1, ...)
    speak of these joints, mimics included. Use ``tree.bodies``, which is made once per tree.

    Parameters
    ----------
    tree : Tree
    leaders : tuple of int
        Link that leads each body, in whose frame its first moments are: the root, then the child
        link of every movable joint.
    of_link : array of int, shape (n_links,)
        Body that each link belongs to.
    T_leader_link : array, shape (n_links, 4, 4)
        Constant pose of each link in its leader's frame [m].
    """

    tree: Tree
    leaders: tuple[int, ...]
    of_link: npt.NDArray[np.intp]
    T_leader_link: Array

    def __len__(self) -> int:
        return len(self.leaders)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Name of every body: that of its leading link."""
        return tuple(self.tree.links[k].name for k in self.leaders)

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """Names of the unknowns, four per body: ``link.m`` [kg], ``link.hx .hy .hz`` [kg m]."""
        return tuple(f"{name}.{u}" for name in self.names for u in ("m", "hx", "hy", "hz"))

    def members(self, body: int) -> tuple[int, ...]:
        """Return the links of *body*, its leader first."""
        return tuple(int(k) for k in np.flatnonzero(self.of_link == body))

    @cached_property
    def parents(self) -> tuple[int, ...]:
        """Body that each body hangs on; -1 for the root."""
        parents = self.tree.parents
        return (-1, *(int(self.of_link[parents[k]]) for k in self.leaders[1:]))

    @cached_property
    def descendants(self) -> npt.NDArray[np.bool_]:
        """``descendants[i, b]``: body b is body i or hangs below it, (n_bodies, n_bodies)."""
        leaders = list(self.leaders)
        return self.tree.descendants[np.ix_(leaders, leaders)]

    @cached_property
    def limbs(self) -> tuple[Limb, ...]:
        """Joints in a row with what hangs on them; those that follow others last."""
        return cut_limbs(self.parents, self.columns, self.follows, self.descendants)

    @cached_property
    def columns(self) -> npt.NDArray[np.intp]:
        """Column of q that moves each body but the root, shape (n_bodies - 1,)."""
        column = {name: i for i, name in enumerate(self.tree.joint_names)}
        joints = [self.tree.joints[k - 1] for k in self.leaders[1:]]
        return np.array(
            [column[j.name if j.mimic is None else j.mimic.joint] for j in joints], dtype=np.intp
        )

    @cached_property
    def follows(self) -> npt.NDArray[np.bool_]:
        """Whether each body's joint mimics another one, shape (n_bodies - 1,)."""
        joints = [self.tree.joints[k - 1] for k in self.leaders[1:]]
        return np.array([j.mimic is not None for j in joints], dtype=np.bool_)

    @cached_property
    def multipliers(self) -> Array:
        """Position of each body's joint per unit of its column of q, shape (n_bodies - 1,)."""
        mimics = [self.tree.joints[k - 1].mimic for k in self.leaders[1:]]
        return np.array([1.0 if m is None else m.multiplier for m in mimics])

    @cached_property
    def offsets(self) -> Array:
        """Position of each body's joint at q = 0 [rad] or [m], shape (n_bodies - 1,)."""
        mimics = [self.tree.joints[k - 1].mimic for k in self.leaders[1:]]
        return np.array([0.0 if m is None else m.offset for m in mimics])

    @cached_property
    def slides(self) -> npt.NDArray[np.bool_]:
        """Whether each body but the root slides instead of turning, shape (n_bodies - 1,)."""
        joints = [self.tree.joints[k - 1] for k in self.leaders[1:]]
        return np.array([j.kind is JointType.PRISMATIC for j in joints], dtype=np.bool_)

    @cached_property
    def axes(self) -> Array:
        """Axis of each body's joint in the body's own frame, shape (n_bodies - 1, 3)."""
        return np.array([self.tree.joints[k - 1].axis for k in self.leaders[1:]]).reshape(-1, 3)

    @cached_property
    def motions(self) -> Array:
        """``E_1, E_s, E_v`` of each body but the root, shape (n_bodies - 1, 3, 4, 4).

        Row and column 0 belong to mass and origin, 1 to 3 to first moments and axes.
        """
        motions = np.zeros((len(self) - 1, 3, 4, 4))
        for i, k in enumerate(self.leaders[1:]):
            joint = self.tree.joints[k - 1]
            T = self.T_leader_link[self.tree.parents[k]] @ joint.T_parent_joint
            R, K = T[:3, :3], skew(joint.axis)
            motions[i, 0, 0, 0] = 1.0
            motions[i, 0, 1:, 0] = T[:3, 3]
            motions[i, 0, 1:, 1:] = R
            if self.slides[i]:
                motions[i, 1, 1:, 0] = R @ joint.axis
            else:  # Rodrigues: 1 + K sin q + K^2 (1 - cos q)
                motions[i, 1, 1:, 1:] = R @ K
                motions[i, 2, 1:, 1:] = R @ K @ K
        return motions

    @cached_property
    def steps(self) -> Array:
        """``E`` transposed and side by side without the rows that vanish, (n_bodies - 1, 4, 10)."""
        one, s, v = np.moveaxis(self.motions, 1, 0)
        return np.swapaxes(np.concatenate([one, s[:, 1:], v[:, 1:]], axis=1), 1, 2).copy()

    @cached_property
    def fixed_steps(self) -> Array:
        """The same from a leader to each link of its body, shape (n_links, 4, 4)."""
        T = self.T_leader_link
        steps = np.zeros_like(T)
        steps[:, 0, 0] = 1.0
        steps[:, 0, 1:] = T[:, :3, 3]
        steps[:, 1:, 1:] = np.swapaxes(T[:, :3, :3], 1, 2)
        return steps

    @cached_property
    def moments(self) -> Array:
        """Mass [kg] and first moments [kg m] of each body in its leader's frame, (n_bodies, 4)."""
        tree, T = self.tree, self.T_leader_link
        own = np.empty((len(tree.links), 4))
        own[:, 0] = tree.masses
        centred = np.einsum("kij,kj->ki", T[:, :3, :3], tree.coms) + T[:, :3, 3]
        own[:, 1:] = tree.masses[:, None] * centred
        moments = np.zeros((len(self), 4))
        np.add.at(moments, self.of_link, own)
        return moments

    @cached_property
    def masses_beyond(self) -> Array:
        """Mass of each body and of all that hangs below it, shape (n_bodies,) [kg]."""
        return self.descendants @ self.moments[:, 0]

    @cached_property
    def carried_constants(self) -> Array:
        """Own first moments, and those of children's masses at their origins, (n_bodies, 3)."""
        constants = self.moments[:, 1:].copy()
        for b, parent in enumerate(self.parents[1:], start=1):
            constants[parent] += self.masses_beyond[b] * self.motions[b - 1, 0, 1:, 0]
        return constants

    @cached_property
    def carrying(self) -> Array:
        """What a body's parent gets of (1, s, v) times (1, x, y, z), (n_bodies - 1, 3, 12).

        x, y, z being the first moment that the body carries; constants are left to
        ``carried_constants``.
        """
        carrying = self.motions[:, :, 1:].copy()
        carrying[:, 0, :, 0] = 0.0
        carrying[:, 1:, :, 0] *= self.masses_beyond[1:, None, None]
        return carrying.transpose(0, 2, 1, 3).reshape(-1, 3, 12)

    @cached_property
    def axis_products(self) -> Array:
        """Matrix of ``axis x`` of each body's joint, shape (n_bodies - 1, 3, 3)."""
        return skew(self.axes)

    def positions(self, q: Array) -> Array:
        """Return sine and versine (turning) or position and zero (sliding) of every joint.

        Parameters
        ----------
        q : array, shape (N, n_joints)

        Returns
        -------
        sv : array, shape (n_bodies - 1, 2, N)
        """
        sv = np.empty((len(self) - 1, 2, len(q)))
        s, v = sv[:, 0], sv[:, 1]
        position = q.T[self.columns]
        position *= self.multipliers[:, None]
        position += self.offsets[:, None]
        # One transcendental gives both: with t = tan(q / 2), sin = 2 t / (1 + t^2) and
        # 1 - cos = t sin; exact at q = 0, where 1 - cos computed from cos is not.
        np.multiply(position, 0.5, out=v)
        np.tan(v, out=v)
        np.multiply(v, v, out=s)
        s += 1.0
        np.divide(2.0, s, out=s)
        s *= v
        v *= s
        if self.slides.any():
            s[self.slides], v[self.slides] = position[self.slides], 0.0
        return sv


def bodies_of(tree: Tree) -> Bodies:
    """Find the bodies of *tree*; ``tree.bodies`` keeps them.

    Examples
    --------
    >>> from comcal.robot.tree import Joint, JointType, Link, Tree
    >>> links = tuple(Link(n, 1.0, np.zeros(3), np.eye(3)) for n in ("shank", "foot", "sole"))
    >>> ankle = Joint("ankle", JointType.REVOLUTE, "shank", "foot", np.eye(4), np.eye(3)[1])
    >>> glue = Joint("glue", JointType.FIXED, "foot", "sole", np.eye(4), np.zeros(3))
    >>> bodies_of(Tree("leg", links, (ankle, glue))).names
    ('shank', 'foot')
    """
    leaders = (0, *(k for k, joint in enumerate(tree.joints, start=1) if joint.is_movable))
    of_link = np.zeros(len(tree.links), dtype=np.intp)
    T = np.tile(np.eye(4), (len(tree.links), 1, 1))
    of_link[list(leaders)] = np.arange(len(leaders))
    for k, joint in enumerate(tree.joints, start=1):
        if not joint.is_movable:
            parent = tree.parents[k]
            of_link[k] = of_link[parent]
            T[k] = T[parent] @ joint.T_parent_joint
    return Bodies(tree, leaders, of_link, T)


def place_bodies(bodies: Bodies, q: Array) -> Array:
    """Place every body in the frame of the root link, poses last in memory.

    Parameters
    ----------
    bodies : Bodies
    q : array, shape (N, n_joints)
        Joint positions [rad] or [m], in the order of ``tree.joint_names``.

    Returns
    -------
    columns : array, shape (n_bodies, 4, 3, N)
        Of each body's leading link: origin [m], then the axes x, y, z.
    """
    n = len(q)
    placed = np.empty((len(bodies), 4, 3, n))
    sv = bodies.positions(q)
    placed[0, 0] = 0.0
    placed[0, 1:] = np.eye(3)[:, :, None]
    # Rows: the parent's four columns, its axes times s, its axes times v.
    work = np.empty((10, 3, n))
    flat, axes, products = work.reshape(10, -1), work[1:4], work[4:].reshape(2, 3, 3, n)
    for b, parent in enumerate(bodies.parents[1:], start=1):
        work[:4] = placed[parent]
        np.multiply(sv[b - 1, :, None, None], axes, out=products)
        np.matmul(bodies.steps[b - 1], flat, out=placed[b].reshape(4, -1))
    return placed
