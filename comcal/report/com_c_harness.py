# SPDX-License-Identifier: Apache-2.0
"""The test that goes with exported C: poses, and what the robot's own kinematics says of them."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

import numpy as np

from comcal.report.com_c_names import comment_block, identifier
from comcal.report.com_c_terms import number
from comcal.robot.tree import Array, JointType, Tree
from comcal.statics.com import com_jacobian, total_com

POSES = 5
TOLERANCE = 1e-12
"""Largest difference [m, m/rad], relative where the robot is longer than a metre."""

_SPREAD = (5**0.5 - 1) / 2
_ANGLE, _SLIDE = 3.0, 0.5

MAIN = """\
#include "{prefix}_com.h"

#include <math.h>
#include <stdio.h>

enum {{ POSES = {poses} }};

static const double POSITIONS[POSES][{big}_NQ] = {{
{positions}
}};

static const double COM[POSES][3] = {{
{coms}
}};

static const double JACOBIAN[POSES][3 * {big}_NQ] = {{
{jacobians}
}};

/* Returns how far a number is off, relative where it is above one; a NaN is far off. */
static double error(double found, double expected)
{{
    const double off = fabs(found - expected) / fmax(1.0, fabs(expected));
    return off <= HUGE_VAL ? off : HUGE_VAL;
}}

int main(void)
{{
    double worst = 0.0;
    for (int pose = 0; pose < POSES; pose++) {{
        double com[3], again[3], J[3 * {big}_NQ];
        {prefix}_com(POSITIONS[pose], com);
        {prefix}_com_jacobian(POSITIONS[pose], again, J);
        for (int i = 0; i < 3; i++) {{
            worst = fmax(worst, error(com[i], COM[pose][i]));
            worst = fmax(worst, error(again[i], COM[pose][i]));
        }}
        for (int k = 0; k < 3 * {big}_NQ; k++) {{
            const double off = error(J[k], JACOBIAN[pose][k]);
            worst = fmax(worst, off);
            if (off > {tolerance})
                printf("pose %d: component %d of the CoM with joint %s is %.17g, not %.17g\\n",
                       pose, k / {big}_NQ, {prefix}_joint_names[k % {big}_NQ], J[k],
                       JACOBIAN[pose][k]);
        }}
    }}
    printf("{prefix}_com: %s, %d poses, largest difference %.1e (limit {tolerance})\\n",
           worst <= {tolerance} ? "ok" : "FAILED", (int)POSES, worst);
    return worst <= {tolerance} ? 0 : 1;
}}
"""


def golden_poses(tree: Tree, n: int = POSES) -> Array:
    """Return *n* joint vectors, shape (n, n_joints): zero, then spread without regard to limits."""
    joints = [tree.joints[tree.joint_index[name]] for name in tree.joint_names]
    reach = np.array([_SLIDE if j.kind is JointType.PRISMATIC else _ANGLE for j in joints])
    order = np.arange(n * len(joints)).reshape(n, -1)
    q = (2.0 * np.mod(order * _SPREAD, 1.0) - 1.0) * reach
    q[0] = 0.0
    return q.round(6)


def com_harness(tree: Tree, name: str, provenance: Sequence[str]) -> str:
    """Return a C program that exits with 0 when the exported functions agree, else with 1.

    Parameters
    ----------
    tree : Tree
    name : str
        As given to :func:`comcal.report.com_c.com_source`.
    provenance : sequence of str
        What the numbers were made from, in words, for the comment on top.
    """
    prefix = identifier(name)
    q = golden_poses(tree)
    com, J = total_com(tree, q), com_jacobian(tree, q)
    about = f"Test of the centre of mass of {tree.name}: numbers made from the links one by one."
    main = MAIN.format(
        prefix=prefix,
        big=prefix.upper(),
        poses=len(q),
        tolerance=TOLERANCE,
        positions=_rows(q),
        coms=_rows(com),
        jacobians=_rows(J.reshape(len(q), -1)),
    )
    return f"{comment_block([about, '', *provenance])}\n{main}"


def _rows(values: Array) -> str:
    return ",\n".join(
        textwrap.fill(
            f"{{{', '.join(map(number, row))}}}",
            100,
            initial_indent="    ",
            subsequent_indent="     ",
            break_on_hyphens=False,
        )
        for row in values.tolist()
    )
