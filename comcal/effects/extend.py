# SPDX-License-Identifier: Apache-2.0
"""A nominal robot and its readings, extended by changes that are known: ready to be solved with.

Known changes correct the robot and the readings first; what the readings then mean goes into the
same solver. Of how well a change is known, what concerns readings becomes an error that all poses
share (:mod:`comcal.identify.shared_errors`). Masses, CoMs and lengths of bodies are taken as exact,
as those of the URDF are. Parameters err independently of one another: no file says otherwise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from comcal.effects.registry import corrected
from comcal.measure.shift import Shift
from comcal.measure.table import PoseTable, shift_between
from comcal.predict.assumed import Assumed
from comcal.predict.plain import plain_readings
from comcal.robot.changes import Change
from comcal.robot.changes_yaml import KnownChange
from comcal.robot.model import Robot


@dataclass(frozen=True)
class Extended:
    """A robot with its readings, as an extension understands them.

    Parameters
    ----------
    robot : Robot
        With the bodies and lengths of the extension.
    table : PoseTable
        What the readings mean; ``shared`` holds how well that is known.
    shared : tuple of str
        Parameters (``effect@target key``) whose sigma is part of every sigma found with it.
    exact : tuple of str
        Parameters with a sigma that is not: those of bodies.
    idle : tuple of str
        Changes (``effect@target``) that a solver does not need.
    """

    robot: Robot
    table: PoseTable
    shared: tuple[str, ...] = ()
    exact: tuple[str, ...] = ()
    idle: tuple[str, ...] = ()


def extend(robot: Robot, table: PoseTable, known: Sequence[KnownChange]) -> Extended:
    """Correct a robot and all its readings by known changes.

    Parameters
    ----------
    robot : Robot
    table : PoseTable
        All poses of the session: what drifts, or is anchored, counts from the first of them.
    known : sequence of KnownChange
        Valid for this robot.

    Raises
    ------
    ConfigError
        If an effect has no correction.
    """
    changes = [entry.change for entry in known]
    assumed, understood = corrected(Assumed(robot), table, changes)
    plain = plain_readings(assumed, understood)
    shifts = dict[str, Shift]()
    exact: list[str] = []
    for i, entry in enumerate(known):
        for key, sigma in entry.sigma.items():
            if not sigma > 0.0:
                continue
            name = f"{entry.change.name} {key}"
            more = {**entry.change.parameters, key: entry.change.number(key) + sigma}
            other = [*changes[:i], replace(entry.change, parameters=more), *changes[i + 1 :]]
            there, read = corrected(Assumed(robot), table, other)
            if not _same_bodies(assumed.robot, there.robot):
                exact.append(name)
                continue
            shift = shift_between(plain, plain_readings(there, read))
            if not shift.is_none:
                shifts[name] = shift
    return Extended(
        robot=assumed.robot,
        table=_known(replace(plain, shared={**table.shared, **shifts}), table),
        shared=tuple(shifts),
        exact=tuple(exact),
        idle=_idle(robot, table, changes),
    )


def _known(plain: PoseTable, raw: PoseTable) -> PoseTable:
    """Leave out poses whose angles nobody knows any more: lag or play, and on no known side."""
    lost = np.isnan(plain.q).any(axis=1) & ~np.isnan(raw.q).any(axis=1)
    if not lost.any():
        return plain
    poses = ", ".join(str(raw.pose[i]) for i in np.flatnonzero(lost))
    note = f"left out pose {poses}: the model has lag or play, and on which side is not known"
    return replace(plain.select(~lost), notes=(*plain.notes, note))


def _same_bodies(one: Robot, other: Robot) -> bool:
    """Return whether masses, CoMs, joint origins and soles of one design are the same."""
    joints = zip(one.tree.joints, other.tree.joints, strict=True)
    feet = zip(one.feet.values(), other.feet.values(), strict=True)
    return (
        np.array_equal(one.tree.masses, other.tree.masses)
        and np.array_equal(one.tree.coms, other.tree.coms)
        and all(np.array_equal(a.T_parent_joint, b.T_parent_joint) for a, b in joints)
        and all(np.array_equal(a.T_link_sole, b.T_link_sole) for a, b in feet)
    )


def _idle(robot: Robot, table: PoseTable, changes: Sequence[Change]) -> tuple[str, ...]:
    """Return the changes that by themselves move neither the robot nor what its readings mean."""
    found: list[str] = []
    for change in changes:
        assumed, understood = corrected(Assumed(robot), table, [change])
        shift = shift_between(table, plain_readings(assumed, understood))
        if shift.is_none and _same_bodies(robot, assumed.robot):
            found.append(change.name)
    return tuple(found)
