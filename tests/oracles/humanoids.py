# SPDX-License-Identifier: Apache-2.0
"""Published humanoids as comcal wants them: a robot.yaml beside nothing but their own URDF.

Every foot is the last link of its leg, its sensor the joint above that link, its sole flat and
stated here: meshes say nothing about soles.
"""

from __future__ import annotations

from importlib import metadata
from pathlib import Path

HUMANOIDS = {
    "talos": (
        "talos_data/robots/talos_reduced.urdf",
        {"left": "leg_left_6", "right": "leg_right_6"},
        -0.107,
        "[[0.10, 0.06], [-0.10, 0.06], [-0.10, -0.06], [0.10, -0.06]]",
    ),
    "g1": (
        "g1_description/urdf/g1_29dof_rev_1_0.urdf",
        {"left": "left_ankle_roll", "right": "right_ankle_roll"},
        -0.035,
        "[[0.12, 0.03], [-0.05, 0.025], [-0.05, -0.025], [0.12, -0.03]]",
    ),
}
"""URDF in the package example-robot-data; links of the feet; height of the sole below the last
ankle axis [m]; corners of the sole [m]."""


def urdf_of(name: str) -> Path:
    """Return the URDF of a published humanoid.

    Raises
    ------
    LookupError
        If the package is not installed, or does not hold it.
    """
    try:
        package = metadata.distribution("example-robot-data")
    except metadata.PackageNotFoundError as absent:
        raise LookupError("example-robot-data is not installed") from absent
    wanted = HUMANOIDS[name][0]
    found = next((f for f in package.files or () if str(f).endswith(wanted)), None)
    if found is None:
        raise LookupError(f"example-robot-data has no {wanted}")
    return Path(str(package.locate_file(found)))


def write_humanoid(name: str, directory: Path) -> Path:
    """Write the robot.yaml of a published humanoid into *directory* and return its path."""
    _, feet, height, sole = HUMANOIDS[name]
    lines = [
        "format: comcal-robot/1",
        f"name: {name}",
        f"urdf: {urdf_of(name)}",
        "sensors:",
        *(f"  {side}_foot: {{joint: {link}_joint}}" for side, link in feet.items()),
        "feet:",
    ]
    for side, link in feet.items():
        lines += [
            f"  {side}:",
            f"    link: {link}_link",
            f"    sensor: {side}_foot",
            f"    sole_frame: {{xyz: [0, 0, {height}], rpy: [0, 0, 0]}}",
            f"    sole: {sole}",
        ]
    lines.append("noise: {ft_force: 0.1, ft_moment: 0.01, encoder: 0.0003}")
    directory.mkdir(parents=True, exist_ok=True)
    path = directory / "robot.yaml"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path
