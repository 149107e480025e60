# SPDX-License-Identifier: Apache-2.0
"""Force/torque calibration of the centre of mass of every link of a biped.

The names below are the public interface. Each is imported when it is first used, so that
``import comcal`` costs nothing; numpy arrays go in and out, in SI units and radians.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from comcal.errors import ComcalError
    from comcal.measure.poses_csv import read_poses
    from comcal.measure.session import open_session as load_session
    from comcal.measure.table import PoseTable
    from comcal.robot.description import load_robot
    from comcal.robot.model import Robot
    from comcal.statics.coefficients import BalanceCoefficients, balance_coefficients
    from comcal.statics.two_pose import total_com
    from comcal.workflow.check import check_robot

__all__ = [
    "BalanceCoefficients",
    "ComcalError",
    "PoseTable",
    "Robot",
    "balance_coefficients",
    "check_robot",
    "load_robot",
    "load_session",
    "read_poses",
    "total_com",
]

_WHERE = {
    "BalanceCoefficients": "comcal.statics.coefficients:BalanceCoefficients",
    "ComcalError": "comcal.errors:ComcalError",
    "PoseTable": "comcal.measure.table:PoseTable",
    "Robot": "comcal.robot.model:Robot",
    "balance_coefficients": "comcal.statics.coefficients:balance_coefficients",
    "check_robot": "comcal.workflow.check:check_robot",
    "load_robot": "comcal.robot.description:load_robot",
    "load_session": "comcal.measure.session:open_session",
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
