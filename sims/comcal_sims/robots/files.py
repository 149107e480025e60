# SPDX-License-Identifier: Apache-2.0
"""Writing a generated robot as a folder: ``robot.yaml``, ``NAME.urdf`` and ``plan.csv``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from difflib import get_close_matches
from pathlib import Path
from typing import Any, TypeVar

from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq

from comcal.errors import ConfigError, UsageError
from comcal.measure.plan import PlannedPose
from comcal.measure.plan_csv import write_plan
from comcal_sims.robots.feet import SolePlate
from comcal_sims.robots.model import RobotSpec
from comcal_sims.robots.urdf import urdf_text

P = TypeVar("P")

FEET = {"left": "l", "right": "r"}
ENCODER_SD = 3.4907e-4
"""0.02 degrees [rad]: constant while the robot stands still, new at the next visit."""


@dataclass(frozen=True)
class MotorSpec:
    """Torque at the joint = torque_constant [N m/A] * gear * sign * current."""

    torque_constant: float
    gear: float
    sign: int


@dataclass(frozen=True)
class Instruments:
    """What robot.yaml says beyond the URDF.

    Parameters
    ----------
    sole : SolePlate
        Of both feet.
    motors : mapping from joint name to MotorSpec
    imu_link : str or None
    noise : mapping from family to float
        Standard errors of a pose mean, beside force and moment.
    """

    sole: SolePlate
    motors: Mapping[str, MotorSpec]
    imu_link: str | None
    noise: Mapping[str, float]


def parameters_from(kind: type[P], robot: str, given: Mapping[str, Any]) -> P:
    """Build the parameter object of a generated robot from keywords.

    Raises
    ------
    UsageError
        If a keyword is not one of its parameters.
    """
    known = [field.name for field in fields(kind)]  # pyright: ignore[reportArgumentType]
    for name in given:
        if name not in known:
            near = get_close_matches(name, known, n=1)
            raise UsageError(
                f"{name} is not a parameter of the robot",
                where=robot,
                next_step=f"did you mean {near[0]}?" if near else f"known: {', '.join(known)}",
            )
    return kind(**given)


def write_robot(
    directory: Path, spec: RobotSpec, instruments: Instruments, plan: Sequence[PlannedPose]
) -> Path:
    """Write the three files of a generated robot and return the path of robot.yaml.

    Parameters
    ----------
    directory : Path
        Made if absent.
    spec : RobotSpec
    instruments : Instruments
    plan : sequence of PlannedPose
        With ``q`` in the order of ``spec.joint_names``.

    Raises
    ------
    ConfigError
        If one of the files exists: nothing is overwritten.
    """
    directory.mkdir(parents=True, exist_ok=True)
    yaml_path, urdf_path = directory / "robot.yaml", directory / f"{spec.name}.urdf"
    plan_path = directory / "plan.csv"
    for path in (yaml_path, urdf_path, plan_path):
        if path.exists():
            raise ConfigError(
                "the file exists and is not overwritten",
                where=str(path),
                next_step="name another folder",
            )
    urdf_path.write_text(urdf_text(spec), encoding="utf-8")
    write_plan(plan_path, plan, spec.joint_names)
    with yaml_path.open("w", encoding="utf-8") as stream:
        _yaml().dump(_description(spec, instruments), stream)
    return yaml_path


def _yaml() -> YAML:
    yaml = YAML()
    yaml.width = 110
    return yaml


def _description(spec: RobotSpec, instruments: Instruments) -> CommentedMap:
    sole = instruments.sole
    description = CommentedMap(
        format="comcal-robot/1",
        name=spec.name,
        urdf=f"{spec.name}.urdf",
        gravity=9.81,
        base="floating",
        sensors=CommentedMap(
            {f"{s}_foot": _flow(joint=f"{s}_foot_ft", sense="on_robot") for s in FEET.values()}
        ),
        feet=CommentedMap({name: _foot(sole, side) for name, side in FEET.items()}),
        motors=CommentedMap(
            {
                joint: _flow(torque_constant=m.torque_constant, gear=m.gear, sign=m.sign)
                for joint, m in instruments.motors.items()
            }
        ),
    )
    if instruments.imu_link is not None:
        description["imu"] = _flow(link=instruments.imu_link)
    description["noise"] = _flow(
        ft_force=0.1,
        ft_moment=0.01,
        encoder=0.0,
        **instruments.noise,
        revisit=_flow(encoder=ENCODER_SD),
    )
    description["limits"] = _flow(com_error="5 mm", mass_error="0.5 kg")
    return description


def _foot(sole: SolePlate, side: str) -> CommentedMap:
    return CommentedMap(
        link=f"{side}_sole",
        sensor=f"{side}_foot",
        ankle=f"{side}_ankle_pitch",
        sole=_row(_row(corner) for corner in sole.corners),
        sole_frame=_flow(xyz=_row((0.0, 0.0, -sole.cut_height)), rpy=_row((0.0, 0.0, 0.0))),
    )


def _flow(**entries: object) -> CommentedMap:
    mapping = CommentedMap(entries)
    mapping.fa.set_flow_style()
    return mapping


def _row(values: object) -> CommentedSeq:
    row = CommentedSeq(values)
    row.fa.set_flow_style()
    return row
