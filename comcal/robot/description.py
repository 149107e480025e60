# SPDX-License-Identifier: Apache-2.0
"""From ``robot.yaml`` to a :class:`~comcal.robot.model.Robot`: names checked against the tree."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from pydantic import BaseModel

from comcal.errors import ConfigError
from comcal.robot.below import replace_below_cuts
from comcal.robot.chain import tree_from_chain
from comcal.robot.frames import rotation_from_rpy, transform_from
from comcal.robot.locate import Key, LocatedYaml, read_yaml
from comcal.robot.model import (
    Base,
    BelowCut,
    Foot,
    Limits,
    Motor,
    Noise,
    Plate,
    Robot,
    Sense,
    Sensor,
    Tolerances,
)
from comcal.robot.schema import FootSection, RobotFile, SensorSection
from comcal.robot.soles import default_ankle, default_sole_frame, sole_rectangle
from comcal.robot.tree import Array, JointType, Tree
from comcal.robot.urdf import read_urdf
from comcal.robot.validate import did_you_mean, validate_file

BELOW_CUT_TOLERANCE = 0.01
"""Relative difference that ``below.mass`` may have from the URDF without ``override``."""
_SMALLEST_SOLE = 1e-6


def load_robot(
    path: str | os.PathLike[str], *, urdf: str | os.PathLike[str] | None = None
) -> Robot:
    """Read ``robot.yaml`` and the URDF that it names.

    Parameters
    ----------
    path : path-like
        The YAML file; ``urdf:`` is taken relative to its folder.
    urdf : path-like, optional
        Another URDF to take instead of the one that the file names.

    Returns
    -------
    Robot
        What ``sensors.*.below`` states stands in the tree instead of the URDF's values.

    Raises
    ------
    ConfigError
        If the file is missing or wrong: unknown keys, names that the tree does not have, units.
        The message names file, line and the word that was probably meant.
    UrdfError
        If the URDF is missing or wrong.
    """
    located = read_yaml(Path(path))
    file = validate_file(located, RobotFile)
    urdf_path: Path | None = None
    if urdf is not None and file.urdf is not None:
        urdf_path = Path(urdf)
        tree = read_urdf(urdf_path)
    elif file.urdf is not None:
        urdf_path = located.path.parent / file.urdf
        if not urdf_path.is_file():
            raise ConfigError(
                f"there is no URDF {file.urdf!r}",
                where=located.where("urdf"),
                next_step="a relative path starts at the folder of this file",
            )
        tree = read_urdf(urdf_path)
    else:
        tree = tree_from_chain(file.name, file.chain or [], located)
    checks = _Checks(located, tree)
    robot = Robot(
        name=file.name,
        tree=tree,
        gravity=file.gravity,
        base=Base(file.base),
        sensors={name: checks.sensor(name, section) for name, section in file.sensors.items()},
        feet={name: checks.foot(name, section, file) for name, section in file.feet.items()},
        plates=checks.plates(file),
        motors=checks.motors(file),
        imu_link=checks.link(file.imu.link, "imu", "link") if file.imu else None,
        noise=Noise(
            **_given(file.noise, without="revisit"),
            revisit=_given(file.noise.revisit),
        ),
        tolerances=_tolerances(file),
        limits=Limits(**_given(file.limits)),
        sources=file.sources,
        commanders=file.commanders,
        yaml_path=located.path,
        urdf_path=urdf_path,
    )
    checks.no_double_use(file)
    checks.cuts_are_apart(robot)
    checks.masses_below_cuts(robot)
    return replace_below_cuts(robot)


class _Checks:
    """The cross checks of one file against its tree; each refusal names the line."""

    def __init__(self, located: LocatedYaml, tree: Tree) -> None:
        self.located = located
        self.tree = tree

    def link(self, name: str, *path: Key) -> str:
        """Return *name* if the tree has that link."""
        return self._known("link", name, self.tree.link_index, path)

    def joint(self, name: str, *path: Key) -> str:
        """Return *name* if the tree has that joint."""
        return self._known("joint", name, self.tree.joint_index, path)

    def sensor(self, name: str, section: SensorSection) -> Sensor:
        """Return one sensor."""
        below = section.below
        return Sensor(
            name,
            self.joint(section.joint, "sensors", name, "joint"),
            Sense(section.sense),
            BelowCut(below.mass, np.array(below.com), below.override) if below else None,
        )

    def foot(self, name: str, section: FootSection, file: RobotFile) -> Foot:
        """Return one foot, with what the file leaves out taken from the tree."""
        here = ("feet", name)
        link = self.link(section.link, *here, "link")
        if section.sensor is not None:
            self._known("sensor", section.sensor, file.sensors, (*here, "sensor"))
        if section.sole_frame is None:
            T_link_sole = default_sole_frame(self.tree, link)
        else:
            R = rotation_from_rpy(section.sole_frame.rpy)
            T_link_sole = transform_from(R, section.sole_frame.xyz)
        if section.sole is None:
            sole = sole_rectangle(self.tree, link, T_link_sole)
        else:
            sole = self._outline(np.array(section.sole), *here, "sole")
        ankle = section.ankle
        if ankle is None:
            ankle = default_ankle(self.tree, link)
        else:
            self._turning(ankle, *here, "ankle")
        return Foot(name, link, section.sensor, sole, T_link_sole, ankle)

    def plates(self, file: RobotFile) -> dict[str, Plate]:
        """Return the force plates."""
        plates: dict[str, Plate] = {}
        for name, section in file.plates.items():
            here = ("plates", name)
            if section.frame != "world":
                self._known(
                    "frame", section.frame, ["world", *self.tree.link_index], (*here, "frame")
                )
            for i, foot in enumerate(section.feet):
                self._known("foot", foot, file.feet, (*here, "feet", i))
            plates[name] = Plate(name, section.frame, tuple(section.feet))
        return plates

    def motors(self, file: RobotFile) -> dict[str, Motor]:
        """Return the motors by joint."""
        motors: dict[str, Motor] = {}
        for name, section in file.motors.items():
            self.joint(name, "motors", name)
            if name not in self.tree.joint_names:
                joint = self.tree.joints[self.tree.joint_index[name]]
                why = "fixed" if joint.mimic is None else f"driven by {joint.mimic.joint!r}"
                raise ConfigError(
                    f"joint {name!r} is {why} and cannot have a motor of its own",
                    where=self.located.where("motors", name),
                    next_step=did_you_mean(name, self.tree.joint_names),
                )
            motors[name] = Motor(name, section.torque_constant, section.gear, section.sign)
        return motors

    def no_double_use(self, file: RobotFile) -> None:
        """Refuse one thing with two meanings."""
        feet, sensors = file.feet, file.sensors
        self._distinct("joint", [(s.joint, ("sensors", n, "joint")) for n, s in sensors.items()])
        self._distinct("link", [(f.link, ("feet", n, "link")) for n, f in feet.items()])
        self._distinct(
            "sensor", [(f.sensor, ("feet", n, "sensor")) for n, f in feet.items() if f.sensor]
        )
        self._distinct(
            "foot",
            [
                (foot, ("plates", n, "feet", i))
                for n, plate in file.plates.items()
                for i, foot in enumerate(plate.feet)
            ],
        )
        # Both become columns ft.<name>.fx of one table.
        self._distinct(
            "name",
            [(n, ("sensors", n)) for n in sensors] + [(n, ("plates", n)) for n in file.plates],
        )

    def cuts_are_apart(self, robot: Robot) -> None:
        """Refuse feet whose sensors are exchanged: then one cut has the other foot above it."""
        feet = [(foot, foot.sensor) for foot in robot.feet.values() if foot.sensor is not None]
        for i, (foot, sensor) in enumerate(feet):
            for other, other_sensor in feet[:i]:
                if (robot.below_cut[sensor] & robot.below_cut[other_sensor]).any():
                    raise ConfigError(
                        f"feet {other.name!r} and {foot.name!r} are not each below a cut of their"
                        f" own: {other_sensor!r} and {sensor!r} look exchanged",
                        where=self.located.where("feet", foot.name, "sensor"),
                        next_step="give each foot the sensor of its own leg",
                    )

    def masses_below_cuts(self, robot: Robot) -> None:
        """Compare ``below.mass`` with the URDF, whose mass it replaces."""
        for name, sensor in robot.sensors.items():
            if sensor.below is None or sensor.below.override or not self.tree.geometry_known:
                continue
            in_urdf = float(self.tree.masses[robot.below_cut[name]].sum())
            if not abs(sensor.below.mass - in_urdf) <= BELOW_CUT_TOLERANCE * abs(in_urdf):
                raise ConfigError(
                    f"sensors.{name}.below: {sensor.below.mass:g} kg is not what the URDF has below"
                    f" this cut, {in_urdf:g} kg",
                    where=self.located.where("sensors", name, "below", "mass"),
                    measured=f"differs by {abs(sensor.below.mass - in_urdf):.4g} kg",
                    limit=f"{BELOW_CUT_TOLERANCE:.0%}",
                    next_step="correct one of them, or write `override: true` to use this one",
                )

    def _known(self, what: str, name: str, known: Iterable[str], path: tuple[Key, ...]) -> str:
        names = list(known)
        if name not in names:
            raise ConfigError(
                f"there is no {what} {name!r}",
                where=self.located.where(*path),
                next_step=did_you_mean(name, names),
            )
        return name

    def _turning(self, name: str, *path: Key) -> None:
        """Refuse a joint that cannot tilt the robot."""
        kind = self.tree.joints[self.tree.joint_index[self.joint(name, *path)]].kind
        if kind not in (JointType.REVOLUTE, JointType.CONTINUOUS):
            raise ConfigError(
                f"joint {name!r} is {kind.value}; an ankle must turn",
                where=self.located.where(*path),
            )

    def _distinct(self, what: str, uses: Sequence[tuple[str, tuple[Key, ...]]]) -> None:
        lines: dict[str, int] = {}
        for name, path in uses:
            if name in lines:
                raise ConfigError(
                    f"{what} {name!r} is used twice, first in line {lines[name]}",
                    where=self.located.where(*path),
                )
            lines[name] = self.located.line(path)

    def _outline(self, sole: Array, *path: Key) -> Array:
        """Return the corners counter-clockwise."""
        x, y = sole.T
        area = 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))
        if abs(area) < _SMALLEST_SOLE:
            raise ConfigError(
                "the corners of the sole enclose no area",
                where=self.located.where(*path),
                measured=f"{area:.3g} m^2",
                next_step="list them in order, around the sole",
            )
        return sole if area > 0.0 else sole[::-1].copy()


def _tolerances(file: RobotFile) -> Tolerances:
    """Split the tolerances into the three that identification uses and the rest."""
    given = _given(file.tolerances)
    used = {k: given.pop(k) for k in ("link_mass", "link_com", "link_length") if k in given}
    return Tolerances(**used, other=given)


def _given(section: BaseModel, without: str = "") -> dict[str, float]:
    """Return the numbers of a section that the file gives."""
    values: dict[str, float | None] = section.model_dump(exclude={without})
    return {key: value for key, value in values.items() if value is not None}
