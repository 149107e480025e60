# SPDX-License-Identifier: Apache-2.0
"""The study file: which robots, which noise, how many calibrations, what is judged."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, StringConstraints

from comcal.errors import ConfigError
from comcal.robot.locate import LocatedYaml, read_yaml
from comcal.robot.validate import validate_file

Name = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]*$")]
Size = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
Seed = Annotated[int, Field(ge=0, lt=2**63)]


class Section(BaseModel):
    """A part of the file in which every key is known."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class NoiseSection(Section):
    """Errors of the simulated sensors, of one sample; SI.

    Of the encoders: what stays while the robot stands in a pose.
    """

    name: Name
    ft_force: Size = 0.5
    ft_moment: Size = 0.05
    samples: Annotated[int, Field(ge=2, le=10_000)] = 25
    encoder: Size = 3.4907e-4


class QuantitiesSection(Section):
    """What is judged of a robot; ``links: auto`` is every component that exact data determine."""

    mass: bool = True
    links: Literal["auto", "none"] = "auto"
    total_com: dict[Name, int] = Field(default_factory=dict)


class RobotSection(Section):
    """A robot: the name of a generated one, or the path of a robot.yaml with its plan.csv."""

    name: Name
    robot: Annotated[str, StringConstraints(min_length=1)] | None = None
    parameters: dict[Name, float | bool] = Field(default_factory=dict)
    quantities: QuantitiesSection = QuantitiesSection()


def _distinct(masters: list[int]) -> list[int]:
    if len(set(masters)) < len(masters):
        raise ConfigError("a master seed occurs twice")
    return masters


class SeedsSection(Section):
    """Master seeds, and calibrations of each."""

    master: Annotated[list[Seed], Field(min_length=1), AfterValidator(_distinct)]
    count: Annotated[int, Field(ge=1, le=1_000_000)]


class LimitsSection(Section):
    """What the verdict asks for."""

    coverage: Annotated[list[Size], Field(min_length=2, max_length=2)] = [0.94, 0.96]
    family_wise: Annotated[float, Field(gt=0.0, lt=1.0)] = 0.99
    rms_over_crb: Annotated[float, Field(gt=0.0)] = 1.03


class StudyFile(Section):
    """The whole of a study file."""

    format: Literal["comcal-study/1"]
    name: Name
    robots: Annotated[list[RobotSection], Field(min_length=1)]
    noise: Annotated[list[NoiseSection], Field(min_length=1)]
    seeds: SeedsSection
    limits: LimitsSection = LimitsSection()
    crb: str | None = None
    workers: Annotated[int, Field(ge=1, le=1024)] | None = None
    output: str | None = None


def read_study(path: Path) -> tuple[StudyFile, LocatedYaml]:
    """Read and check a study file.

    Parameters
    ----------
    path : Path

    Returns
    -------
    study : StudyFile
    located : LocatedYaml
        Says on which line each key stands.

    Raises
    ------
    ConfigError
        If it is missing or wrong; the message names file, line and the key probably meant.
    """
    located = read_yaml(path)
    study = validate_file(located, StudyFile)
    for section in ("robots", "noise"):
        names = [entry["name"] for entry in located.data[section]]
        for i, name in enumerate(names):
            if name in names[:i]:
                raise ConfigError(
                    f"two entries of {section} are called {name!r}",
                    where=located.where(section, i, "name"),
                    next_step="give each its own name",
                )
    return study, located
