# SPDX-License-Identifier: Apache-2.0
"""What a table of joint angles may mean when its source does not say it.

A :class:`Convention` says which column is which joint of the chain, which way each joint turns, and
whether the CoM is counted from the chain's root. :class:`Conventions` is the set of all that are
possible, as ``conventions.yaml`` lists them. The zero of an angle is never among them: with two
columns (cosine and sine) per body a shifted zero only turns the vectors of R and predicts the same.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from itertools import product

import numpy as np
import numpy.typing as npt

from comcal.identify.known_com import KnownCom
from comcal.robot.tree import Array, JointType, Tree
from comcal.statics.sesc import SescChain, sesc_matrix


class Offset(Enum):
    """Where the origin of the given CoM lies."""

    ZERO = "zero"
    """On the first joints of the chain: the root body has no columns (Cotton 2009, d_1 = 0)."""
    UNKNOWN = "unknown"
    """Somewhere fixed to the root body: a constant is fitted too."""


@dataclass(frozen=True)
class Convention:
    """One way to read the table.

    Parameters
    ----------
    order : str
        Name of the assignment of columns to joints.
    columns : tuple of int
        Column of the table that is read as each joint, in the order of ``tree.joint_names``.
    signs : tuple of int
        +1 or -1 for each joint.
    offset : Offset
    """

    order: str
    columns: tuple[int, ...]
    signs: tuple[int, ...]
    offset: Offset

    def joint_positions(self, q: Array) -> Array:
        """Return positions of the chain's joints from columns of the table, shape (..., n)."""
        return np.asarray(self.signs, dtype=np.float64) * q[..., list(self.columns)]


@dataclass(frozen=True)
class Closure:
    """A link that is parallel to the root link in poses that stand on both feet.

    Parameters
    ----------
    link : str
        The other foot.
    two_feet_below : float
        A pose counts as standing on both feet if no joint between root and *link* is bent more
        than this [rad].
    scatter : float
        Standard error of one joint angle, rounding aside [rad].
    """

    link: str
    two_feet_below: float
    scatter: float


@dataclass(frozen=True)
class Rounding:
    """Half of the last digit printed: the true value lies anywhere within, with equal chance.

    ``angle`` [rad] and ``length`` [m]; zero where nothing was rounded.
    """

    angle: float = 0.0
    length: float = 0.0

    def of_joints(self, tree: Tree) -> Array:
        """Return the half width for every column of q, shape (n_joints,)."""
        kinds = [tree.joints[tree.joint_index[name]].kind for name in tree.joint_names]
        return np.array([self.length if k is JointType.PRISMATIC else self.angle for k in kinds])


@dataclass(frozen=True)
class Conventions:
    """All ways to read a table that its source leaves open.

    Parameters
    ----------
    orders : mapping from name to tuple of int
        Column read as each joint of the chain.
    free_signs : tuple of int
        Joints whose sense of rotation is unknown; the others turn as the chain says.
    offsets : tuple of Offset
    closure : Closure or None
    rounding : Rounding
    words : tuple of str
        What each joint of the chain is, for the report.
    """

    orders: Mapping[str, tuple[int, ...]]
    free_signs: tuple[int, ...]
    offsets: tuple[Offset, ...]
    closure: Closure | None
    rounding: Rounding
    words: tuple[str, ...]

    def candidates(self) -> tuple[Convention, ...]:
        """Return every combination of order, signs and offset."""
        n = len(self.words)
        choices = [(1, -1) if i in self.free_signs else (1,) for i in range(n)]
        return tuple(
            Convention(name, columns, signs, offset)
            for (name, columns), signs, offset in product(
                self.orders.items(), product(*choices), self.offsets
            )
        )


def stated_conventions(tree: Tree) -> Conventions:
    """Return the set of one for a chain whose columns mean what ``robot.yaml`` says."""
    names = tree.joint_names
    return Conventions(
        orders={"as stated": tuple(range(len(names)))},
        free_signs=(),
        offsets=(Offset.UNKNOWN,),
        closure=None,
        rounding=Rounding(),
        words=names,
    )


def convention_matrix(chain: SescChain, convention: Convention, q: npt.ArrayLike) -> Array:
    """Return ``B(q)`` when the table is read by *convention*.

    Parameters
    ----------
    q : array, shape (..., n_joints)
        Columns of the table [rad] or [m].

    Returns
    -------
    B : array, shape (..., 3, chain.size)
        The root's columns are zero where the offset is zero.
    """
    positions = convention.joint_positions(np.asarray(q, dtype=np.float64))
    B = sesc_matrix(chain, positions.reshape(-1, positions.shape[-1]))
    if convention.offset is Offset.ZERO:
        B[..., chain.root_columns] = 0.0
    return B.reshape(*positions.shape[:-1], 3, chain.size)


def same_models(
    chain: SescChain, candidates: tuple[Convention, ...], known: KnownCom
) -> tuple[tuple[Convention, ...], ...]:
    """Group the conventions that are one and the same model under different names.

    Turning every sense of rotation round, or exchanging two equal limbs, changes the vectors of R
    and no prediction: the rows span the same space whatever the angles are.

    Parameters
    ----------
    known : KnownCom
        Only says which components are measured.

    Returns
    -------
    tuple of tuple of Convention
        Groups in the order of their first members.
    """
    components = np.unique(known.component)
    q = _probe_angles(2 * chain.size + 4, len(chain.tree.joint_names))
    groups: dict[tuple[float, ...], list[Convention]] = {}
    for convention in candidates:
        rows = convention_matrix(chain, convention, q)[:, components]
        U, s, _ = np.linalg.svd(rows.reshape(-1, chain.size), full_matrices=False)
        U = U[:, s > _SAME * s[0]]
        # A space is known by the shadow that one fixed, patternless vector casts on it.
        shadow = U @ (U.T @ _probe_angles(len(U), 1)[:, 0])
        key = tuple(np.round(shadow[:: max(1, len(U) // 12)], 6) + 0.0)
        groups.setdefault(key, []).append(convention)
    return tuple(tuple(group) for group in groups.values())


_SAME = 1e-9
_IRRATIONAL = np.sqrt(np.array([2.0, 3.0, 5.0, 7.0, 11.0, 13.0, 17.0, 19.0]))


def _probe_angles(n: int, n_joints: int) -> Array:
    """Return n patternless joint vectors without a random generator, shape (n, n_joints) [rad]."""
    phase = np.outer(np.arange(1, n + 1), _IRRATIONAL[np.arange(n_joints) % len(_IRRATIONAL)])
    return 1.3 * np.sin(phase * (1.0 + 0.37 * (np.arange(n_joints) // len(_IRRATIONAL))))
