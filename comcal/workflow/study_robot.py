# SPDX-License-Identifier: Apache-2.0
"""The robots of a study: found or generated, and what is judged of them, before any noise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib.metadata import entry_points
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import cast

import numpy as np

from comcal.errors import ConfigError
from comcal.identify.adjust import adjust
from comcal.identify.groups import groups_of
from comcal.identify.quantities import Quantities, identifiable_components
from comcal.identify.unknowns import unknowns_of
from comcal.measure.plan import NONE, PlannedPose
from comcal.measure.plan_csv import read_plan
from comcal.measure.pose_row import cut, join
from comcal.measure.source import Block, SimulatedSource, SourceRequest
from comcal.measure.tabulate import tabulate
from comcal.robot.description import load_robot
from comcal.robot.locate import LocatedYaml
from comcal.robot.model import Robot
from comcal.robot.validate import did_you_mean
from comcal.workflow.sources import open_source
from comcal.workflow.study_file import NoiseSection, RobotSection

GROUP = "comcal.robots"
WORLD = "builtin"
"""The simulated source of every study."""
READ = 0.25
"""Seconds that are read at a time."""


@dataclass(frozen=True)
class StudyRobot:
    """A robot as designed, its standing poses, and what is judged.

    Parameters
    ----------
    name, origin : str
        What the study calls it, and where it comes from.
    robot : Robot
    poses : tuple of PlannedPose
    quantities : Quantities
    """

    name: str
    origin: str
    robot: Robot
    poses: tuple[PlannedPose, ...]
    quantities: Quantities


def prepare_robot(
    section: RobotSection, folder: Path, located: LocatedYaml, index: int
) -> StudyRobot:
    """Load or generate a robot and fix its quantities by a session without noise.

    Parameters
    ----------
    section : RobotSection
    folder : Path
        Where generated robots go; one that was generated there before is taken as it is.
    located : LocatedYaml
        The study file, for messages; paths are relative to its folder.
    index : int
        Position of *section* in the file.

    Raises
    ------
    ConfigError
        If there is no such robot, plan or pose.
    """
    where = located.where("robots", index, "robot" if section.robot else "name")
    path = _description(section, folder / section.name, located, where)
    robot = load_robot(path)
    plan = read_plan(path.parent / "plan.csv", robot.tree.joint_names)
    poses = tuple(pose for pose in plan if pose.support != NONE)
    if not poses:
        raise ConfigError("the plan has no pose in which the robot stands", where=where)
    by_id = {pose.pose: pose for pose in poses}
    for name, pose in section.quantities.total_com.items():
        if pose not in by_id:
            raise ConfigError(
                f"{section.name} has no standing pose {pose}",
                where=located.where("robots", index, "quantities", "total_com", name),
                next_step=f"standing poses: {min(by_id)} to {max(by_id)}",
            )
    parameters = ", ".join(f"{k}={v}" for k, v in sorted(section.parameters.items()))
    return StudyRobot(
        section.name,
        f"{section.robot or section.name}({parameters})",
        robot,
        poses,
        Quantities(
            mass=section.quantities.mass,
            components=_components(robot, poses) if section.quantities.links == "auto" else (),
            total_coms=tuple(
                (name, by_id[pose]) for name, pose in section.quantities.total_com.items()
            ),
        ),
    )


def told_noise(robot: Robot, noise: NoiseSection) -> Robot:
    """Return *robot* with the noise of the study in its description, as robot.yaml would state it.

    Parameters
    ----------
    robot : Robot
    noise : NoiseSection
    """
    root = np.sqrt(noise.samples)
    stated = replace(
        robot.noise,
        ft_force=float(noise.ft_force / root),
        ft_moment=float(noise.ft_moment / root),
        encoder=0.0,
        revisit={**robot.noise.revisit, "encoder": noise.encoder},
    )
    return replace(robot, noise=stated)


def still_window(source: SimulatedSource, samples: int) -> Block:
    """Read exactly *samples* samples of a robot at rest."""
    block = source.read(READ)
    while block.t.size < samples:
        rate = block.t.size / READ
        block = join([block, source.read((samples - block.t.size) / rate)])
    return cut(block, slice(0, samples))


def _description(section: RobotSection, folder: Path, located: LocatedYaml, where: str) -> Path:
    """Return the path of robot.yaml, generating it where it is asked for by name."""
    wanted = section.robot or section.name
    if wanted.endswith((".yaml", ".yml")):
        if section.parameters:
            raise ConfigError("only generated robots have parameters", where=where)
        return located.path.parent / wanted
    entry = next(iter(entry_points(group=GROUP, name=wanted)), None)
    if entry is None:
        known = sorted({entry.name for entry in entry_points(group=GROUP)})
        raise ConfigError(
            f"there is no generated robot {wanted!r}",
            where=where,
            next_step=did_you_mean(wanted, known) + "; or give the path of a robot.yaml",
        )
    if (folder / "robot.yaml").is_file():
        return folder / "robot.yaml"
    generate = cast("Callable[..., Path]", entry.load())
    folder.parent.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(dir=folder.parent) as scratch:  # it is there whole or not at all
        made = generate(Path(scratch) / section.name, **section.parameters)
        made.parent.rename(folder)
    return folder / made.name


def _components(robot: Robot, poses: tuple[PlannedPose, ...]) -> tuple[tuple[str, int], ...]:
    """Return the CoM components that exact data from these poses determine."""
    told = told_noise(robot, NoiseSection(name="exact"))
    with open_source(WORLD, SourceRequest(robot=told, seed=0, noise=False)) as source:
        windows: list[Block] = []
        for pose in poses:
            source.move_to(pose)
            windows.append(still_window(source, 2))
    table = tabulate(told, poses, windows, WORLD)
    return identifiable_components(adjust(told, unknowns_of(told), groups_of(told, table)))
