# SPDX-License-Identifier: Apache-2.0
"""The CoM of a robot and its Jacobian as C99: one source and its header, nothing to link but libm.

What is computed is in :mod:`comcal.report.com_c_body`; here is what stands around it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from comcal.errors import UrdfError
from comcal.report.com_c_body import com_body, jacobian_body
from comcal.report.com_c_chain import moved_chain
from comcal.report.com_c_names import (
    comment_block,
    enumerators,
    identifier,
    in_comment,
    string_literal,
)
from comcal.report.com_c_terms import number
from comcal.robot.tree import Joint, JointType, Tree


def com_header(tree: Tree, name: str, provenance: Sequence[str]) -> str:
    """Return the header: sizes, the order of the joints, the mass, the two functions.

    Parameters
    ----------
    tree : Tree
    name : str
        What every identifier begins with.
    provenance : sequence of str
        What the numbers were made from, in words, for the comment on top.

    Raises
    ------
    UrdfError
        If *tree* has no joint that moves, no geometry, or no masses.
    """
    _check(tree)
    prefix = identifier(name)
    big = prefix.upper()
    names = enumerators(f"{big}_Q_", tree.joint_names)
    units = ["m" if joint.kind is JointType.PRISMATIC else "rad" for joint in _moving(tree)]
    width = max(map(len, names)) + len(" = 0,")
    order = [
        f"    {f'{enumerator} = 0,' if i == 0 else f'{enumerator},':{width}}"
        f" /* {in_comment(joint)} [{unit}] */"
        for i, (enumerator, joint, unit) in enumerate(
            zip(names, tree.joint_names, units, strict=True)
        )
    ]
    followers = [joint.name for joint in tree.joints if joint.is_movable and joint.mimic]
    order_text = ["Joint positions, in the order of q and of the columns of J."]
    if followers:
        order_text.append(f"Mimics follow them and have no place in q: {', '.join(followers)}.")
    root = in_comment(tree.links[0].name)
    return f"""\
{comment_block([f"Centre of mass of {tree.name} and its Jacobian.", "", *provenance])}
#ifndef {big}_COM_H
#define {big}_COM_H

#ifdef __cplusplus
extern "C" {{
#endif

/* Mass of the whole robot [kg]. */
#define {big}_MASS {number(tree.total_mass)}

{comment_block(order_text)}
enum {{
{chr(10).join(order)}
    {big}_NQ
}};

/* Names of the joints, in the same order, in UTF-8. */
extern const char *const {prefix}_joint_names[{big}_NQ];

/* CoM of the whole robot [m] in the frame of the root link "{root}". */
void {prefix}_com(const double q[{big}_NQ], double com[3]);

/*
 * The same, and J = d com / d q, row by row: J[i * {big}_NQ + j] is how component i of
 * the CoM moves with joint j [m/rad, m/m] while the root link stays where it is.
 */
void {prefix}_com_jacobian(const double q[{big}_NQ], double com[3], double J[3 * {big}_NQ]);

#ifdef __cplusplus
}}
#endif

#endif
"""


def com_source(tree: Tree, name: str, provenance: Sequence[str]) -> str:
    """Return the source of both functions.

    Parameters
    ----------
    tree : Tree
    name : str
        What every identifier begins with.
    provenance : sequence of str
        What the numbers were made from, in words, for the comment on top.

    Raises
    ------
    UrdfError
        If *tree* has no joint that moves, no geometry, or no masses.
    """
    _check(tree)
    prefix = identifier(name)
    big = prefix.upper()
    chain = moved_chain(tree)
    names = ",\n".join(f"    {string_literal(joint)}" for joint in tree.joint_names)
    notation = [
        *(f"Centre of mass of {tree.name} and its Jacobian.", "", *provenance, ""),
        "Notation, for joint number n, whose own z axis is the axis of the joint:",
        "  cn, sn         cosine and sine of its position",
        "  hnx, hny, hnz  first moment of all that lies beyond it, about it, over the mass of the",
        "                 robot [m], in axes that turn with the joint",
        "  gnx, gny, gnz  the same in axes that do not turn with it",
        "  unx .. anz     its x, y and z axes (u, v, a) before it turns, in the root link frame",
        "  rnx, tnx ..    its x and y axes (r, t) after it has turned, in the root link frame",
    ]
    return f"""\
{comment_block(notation)}
#include "{prefix}_com.h"

#include <math.h>

const char *const {prefix}_joint_names[{big}_NQ] = {{
{names}
}};

void {prefix}_com(const double q[{big}_NQ], double com[3])
{{
{com_body(tree, chain)}
}}

void {prefix}_com_jacobian(const double q[{big}_NQ], double com[3], double J[3 * {big}_NQ])
{{
{jacobian_body(tree, chain, f"{big}_NQ")}
}}
"""


def _moving(tree: Tree) -> list[Joint]:
    """Return the independent joints in the order of q."""
    return [tree.joints[tree.joint_index[name]] for name in tree.joint_names]


def _check(tree: Tree) -> None:
    """Refuse what has no CoM that moves."""
    if not tree.geometry_known:
        raise UrdfError(
            "the robot has no lengths, so its CoM is not determined",
            where=tree.name,
            next_step="give a URDF",
        )
    massless = [link.name for link in tree.links if not np.isfinite(link.mass)]
    if massless or tree.total_mass <= 0.0:
        raise UrdfError(
            "the robot has no mass" if not massless else f"link {massless[0]!r} has no mass",
            where=tree.name,
            measured="" if massless else f"{tree.total_mass:g} kg in all",
            next_step="give every <inertial> of the URDF its mass",
        )
    if not tree.joint_names:
        raise UrdfError(
            "no joint of the robot moves, so its CoM is a constant",
            where=tree.name,
            next_step="check that the URDF is that of the whole robot",
        )
