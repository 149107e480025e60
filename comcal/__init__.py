# SPDX-License-Identifier: Apache-2.0
"""Force/torque calibration of the centre of mass of every link of a biped.

The names below are the public interface. Each is imported when it is first used, so that
``import comcal`` costs nothing; numpy arrays go in and out, in SI units and radians::

    session, robot, table = comcal.load_session(Path("monday"))
    coefficients = comcal.balance_coefficients(robot, table)   # alpha .. delta, pose by pose
    links = comcal.link_coms(robot, table)                     # the paper's route: twins, Cramer
    solution = comcal.identify_links(robot, table)             # all data at once
    program = comcal.derive(comcal.DeriveOrder(comcal.DeriveWhat.LINK_COM, dof=3))   # formulas
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from comcal.errors import ComcalError
    from comcal.identify.calibration import Calibration, calibrate
    from comcal.identify.paper_route import PaperRoute
    from comcal.identify.paper_route import paper_route as link_coms
    from comcal.identify.scope import Scope
    from comcal.identify.solution import Solution
    from comcal.identify.solution import solve_all as identify_links
    from comcal.measure.poses_csv import read_poses
    from comcal.measure.table import PoseTable
    from comcal.robot.description import load_robot
    from comcal.robot.model import Robot
    from comcal.robot.urdf import read_urdf
    from comcal.statics.coefficients import BalanceCoefficients, balance_coefficients
    from comcal.statics.com import com_jacobian as tree_com_jacobian
    from comcal.statics.com import total_com as tree_com
    from comcal.statics.regressor import static_regressor
    from comcal.statics.two_pose import total_com
    from comcal.symbolic.check_claim import FormulaReport
    from comcal.symbolic.program import Program
    from comcal.symbolic.to_c import to_c
    from comcal.symbolic.to_latex import to_latex
    from comcal.symbolic.to_python import python_function, to_python
    from comcal.symbolic.to_text import to_text
    from comcal.workflow.calibrate import load_session
    from comcal.workflow.check import check_robot
    from comcal.workflow.check_formula import check_formula
    from comcal.workflow.derive import DeriveOrder, derive
    from comcal.workflow.derive import What as DeriveWhat

__all__ = [
    "BalanceCoefficients",
    "Calibration",
    "ComcalError",
    "DeriveOrder",
    "DeriveWhat",
    "FormulaReport",
    "PaperRoute",
    "PoseTable",
    "Program",
    "Robot",
    "Scope",
    "Solution",
    "balance_coefficients",
    "calibrate",
    "check_formula",
    "check_robot",
    "derive",
    "identify_links",
    "link_coms",
    "load_robot",
    "load_session",
    "python_function",
    "read_poses",
    "read_urdf",
    "static_regressor",
    "to_c",
    "to_latex",
    "to_python",
    "to_text",
    "total_com",
    "tree_com",
    "tree_com_jacobian",
]

_WHERE = {
    "BalanceCoefficients": "comcal.statics.coefficients:BalanceCoefficients",
    "Calibration": "comcal.identify.calibration:Calibration",
    "ComcalError": "comcal.errors:ComcalError",
    "DeriveOrder": "comcal.workflow.derive:DeriveOrder",
    "DeriveWhat": "comcal.workflow.derive:What",
    "FormulaReport": "comcal.symbolic.check_claim:FormulaReport",
    "PaperRoute": "comcal.identify.paper_route:PaperRoute",
    "PoseTable": "comcal.measure.table:PoseTable",
    "Program": "comcal.symbolic.program:Program",
    "Robot": "comcal.robot.model:Robot",
    "Scope": "comcal.identify.scope:Scope",
    "Solution": "comcal.identify.solution:Solution",
    "balance_coefficients": "comcal.statics.coefficients:balance_coefficients",
    "calibrate": "comcal.identify.calibration:calibrate",
    "check_formula": "comcal.workflow.check_formula:check_formula",
    "check_robot": "comcal.workflow.check:check_robot",
    "derive": "comcal.workflow.derive:derive",
    "identify_links": "comcal.identify.solution:solve_all",
    "link_coms": "comcal.identify.paper_route:paper_route",
    "load_robot": "comcal.robot.description:load_robot",
    "load_session": "comcal.workflow.calibrate:load_session",
    "python_function": "comcal.symbolic.to_python:python_function",
    "read_poses": "comcal.measure.poses_csv:read_poses",
    "read_urdf": "comcal.robot.urdf:read_urdf",
    "static_regressor": "comcal.statics.regressor:static_regressor",
    "to_c": "comcal.symbolic.to_c:to_c",
    "to_latex": "comcal.symbolic.to_latex:to_latex",
    "to_python": "comcal.symbolic.to_python:to_python",
    "to_text": "comcal.symbolic.to_text:to_text",
    "total_com": "comcal.statics.two_pose:total_com",
    "tree_com": "comcal.statics.com:total_com",
    "tree_com_jacobian": "comcal.statics.com:com_jacobian",
}
"""Public name to ``module:attribute``."""


def __getattr__(name: str) -> object:
    if name == "__version__":
        return _version()
    if name not in _WHERE:
        raise AttributeError(f"module 'comcal' has no attribute {name!r}")
    module, attribute = _WHERE[name].split(":")
    value: object = getattr(importlib.import_module(module), attribute)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__, "__version__"})


def _version() -> str:
    from importlib import metadata

    try:
        return metadata.version("comcal")
    except metadata.PackageNotFoundError:
        return "0+not-installed"
