# SPDX-License-Identifier: Apache-2.0
"""Force/torque calibration of the centre of mass of every link of a biped.

The names below are the public interface. Each is imported when it is first used, so that
``import comcal`` costs nothing; numpy arrays go in and out, in SI units and radians::

    session, robot, table = comcal.load_session(Path("monday"))
    coefficients = comcal.balance_coefficients(robot, table)   # alpha .. delta, pose by pose
    links = comcal.link_coms(robot, table)                     # the paper's route: twins, Cramer
    solution = comcal.identify_links(robot, table)             # all data at once
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from comcal.errors import ComcalError
    from comcal.identify.calibration import Calibration, calibrate
    from comcal.identify.paper_route import PaperRoute
    from comcal.identify.paper_route import paper_route as link_coms
    from comcal.identify.solution import Solution
    from comcal.identify.solution import solve_all as identify_links
    from comcal.measure.poses_csv import read_poses
    from comcal.measure.table import PoseTable
    from comcal.robot.description import load_robot
    from comcal.robot.model import Robot
    from comcal.statics.coefficients import BalanceCoefficients, balance_coefficients
    from comcal.statics.two_pose import total_com
    from comcal.workflow.calibrate import load_session
    from comcal.workflow.check import check_robot

__all__ = [
    "BalanceCoefficients",
    "Calibration",
    "ComcalError",
    "PaperRoute",
    "PoseTable",
    "Robot",
    "Solution",
    "balance_coefficients",
    "calibrate",
    "check_robot",
    "identify_links",
    "link_coms",
    "load_robot",
    "load_session",
    "read_poses",
    "total_com",
]

_WHERE = {
    "BalanceCoefficients": "comcal.statics.coefficients:BalanceCoefficients",
    "Calibration": "comcal.identify.calibration:Calibration",
    "ComcalError": "comcal.errors:ComcalError",
    "PaperRoute": "comcal.identify.paper_route:PaperRoute",
    "PoseTable": "comcal.measure.table:PoseTable",
    "Robot": "comcal.robot.model:Robot",
    "Solution": "comcal.identify.solution:Solution",
    "balance_coefficients": "comcal.statics.coefficients:balance_coefficients",
    "calibrate": "comcal.identify.calibration:calibrate",
    "check_robot": "comcal.workflow.check:check_robot",
    "identify_links": "comcal.identify.solution:solve_all",
    "link_coms": "comcal.identify.paper_route:paper_route",
    "load_robot": "comcal.robot.description:load_robot",
    "load_session": "comcal.workflow.calibrate:load_session",
    "read_poses": "comcal.measure.poses_csv:read_poses",
    "total_com": "comcal.statics.two_pose:total_com",
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
