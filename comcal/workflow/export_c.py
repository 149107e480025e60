# SPDX-License-Identifier: Apache-2.0
"""``comcal export --c``: the CoM of a robot and its Jacobian as C99, with a test."""

from __future__ import annotations

import comcal
from comcal.report.com_c import com_header, com_source
from comcal.report.com_c_harness import com_harness
from comcal.report.com_c_names import identifier
from comcal.robot.tree import Tree


def export_c(tree: Tree, name: str, origin: str = "") -> dict[str, str]:
    """Return the files of a C library for the CoM of *tree*, file name to text.

    Parameters
    ----------
    tree : Tree
        With the masses and CoMs to write; the same tree always gives the same text.
    name : str
        What files and functions begin with, for example the robot's name; made a C identifier.
    origin : str
        Where the numbers come from, in words, for the comment on top of each file: the URDF and
        its sha256, the session.

    Returns
    -------
    dict of str to str
        ``NAME_com.h``, ``NAME_com.c`` and the test program ``NAME_com_test.c``.

    Raises
    ------
    UrdfError
        If *tree* has no joint that moves, no geometry, or no masses.
    """
    prefix = identifier(name)
    provenance = [
        f"Written by comcal {comcal.__version__}" + (f" from {origin}." if origin else "."),
        f"Frame: the root link {tree.links[0].name!r}. SI and radians, C99, libm only. To test:",
        f"  cc -std=c99 -O2 {prefix}_com.c {prefix}_com_test.c -lm -o {prefix}_com_test"
        f" && ./{prefix}_com_test",
    ]
    return {
        f"{prefix}_com.h": com_header(tree, name, provenance),
        f"{prefix}_com.c": com_source(tree, name, provenance),
        f"{prefix}_com_test.c": com_harness(tree, name, provenance),
    }
