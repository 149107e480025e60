# SPDX-License-Identifier: Apache-2.0
"""``--model extended.yaml``: read once, stored with what was made of it, found again there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from comcal.effects.extend import Extended, extend
from comcal.measure.files import sha256_of
from comcal.measure.table import PoseTable
from comcal.robot.changes import check_changes, spec_of
from comcal.robot.changes_yaml import (
    FORMAT,
    KnownChange,
    changes_in,
    effects_data,
    read_extension,
)
from comcal.robot.locate import LocatedYaml
from comcal.robot.model import Robot

SHOWN = 6
"""Parameters that are named before the rest is counted."""


@dataclass(frozen=True)
class KnownModel:
    """Known changes of a nominal robot, and the file that they are from.

    Parameters
    ----------
    file, sha256 : str
        Its name as given, and its SHA-256; it need not be there any more.
    known : tuple of KnownChange
    """

    file: str
    sha256: str
    known: tuple[KnownChange, ...]

    def of(self, robot: Robot, table: PoseTable) -> Extended:
        """Return a robot and all readings of its session as this model understands them.

        Raises
        ------
        UsageError
            If a change is not valid for this robot.
        ConfigError
            If an effect has no correction.
        """
        check_changes([entry.change for entry in self.known], robot, self.file)
        return extend(robot, table, self.known)

    def is_same(self, other: KnownModel | None) -> bool:
        """Return whether another model says the same, whatever its file is called."""
        return other is not None and effects_data(self.known) == effects_data(other.known)


def read_model(path: Path) -> KnownModel:
    """Read ``extended.yaml``.

    Raises
    ------
    ConfigError
        As :func:`~comcal.robot.changes_yaml.read_extension`.
    """
    known = read_extension(path)
    return KnownModel(str(path), sha256_of(path), known)


def model_of_result(content: Mapping[str, Any], path: Path) -> KnownModel | None:
    """Return the model that a ``result.json`` was made with; None: the nominal one.

    Parameters
    ----------
    content : mapping
        Of ``result.json``.
    path : Path
        Of the same, for messages.

    Raises
    ------
    ConfigError
        If what it holds is no extension.
    """
    stored = content.get("model")
    if not isinstance(stored, Mapping):
        return None
    model = cast("Mapping[str, Any]", stored)
    located = LocatedYaml(path, {"format": FORMAT, "effects": model.get("effects")}, {})
    known = changes_in(located)
    return KnownModel(str(model.get("file", "")), str(model.get("sha256", "")), known)


def model_json(model: KnownModel, extended: Extended) -> dict[str, Any]:
    """Return what ``result.json`` says of the model that it was made with.

    Parameters
    ----------
    model : KnownModel
    extended : Extended
        What it made of the session.
    """
    return {
        "file": model.file,
        "sha256": model.sha256,
        "effects": effects_data(model.known),
        "shared_errors": list(extended.shared),
        "exact": list(extended.exact),
        "idle": list(extended.idle),
    }


def model_notes(model: KnownModel, extended: Extended) -> tuple[str, ...]:
    """Return what a reader of a result should know of its model, one sentence each.

    Parameters
    ----------
    model : KnownModel
    extended : Extended
    """
    if not model.known:
        return (f"model {model.file} holds no change: robot and readings are taken as they are",)
    notes = [
        f"model {model.file}: {'; '.join(map(words_of, model.known))}. Robot and readings are "
        "corrected by it first, and what is said to be of the URDF is of the URDF with it"
    ]
    if extended.shared:
        notes.append(f"every sigma contains how well the model knows {_joined(extended.shared)}")
    if extended.exact:
        notes.append(f"taken as exact, as bodies of the URDF are: {_joined(extended.exact)}")
    notes += [f"{name} changes nothing here: {_why_idle(name)}" for name in extended.idle]
    return tuple(notes)


def words_of(entry: KnownChange) -> str:
    """Return a change with its numbers, as in ``payload@torso (mass 5 +/- 0.1 kg)``."""
    change, units = entry.change, spec_of(entry.change.effect).keys
    parts: list[str] = []
    for key, value in change.parameters.items():
        if isinstance(value, tuple):
            parts.append(f"{key} {'+'.join(map(str, value))}")
            continue
        unit = units[key].unit if key in units else ""
        sigma = f" +/- {entry.sigma[key]:.2g}" if entry.sigma.get(key, 0.0) > 0.0 else ""
        parts.append(f"{key} {value:.4g}{sigma}{f' {unit}' if unit not in ('', '1') else ''}")
    return f"{change.name} ({', '.join(parts)})"


def _joined(names: Sequence[str]) -> str:
    more = f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
    return ", ".join(names[:SHOWN]) + more


def _why_idle(name: str) -> str:
    reasons = {
        "internal_torque_term": "internal torques cancel in the balance of the whole robot, "
        "whatever a model says",
        "ground_tilt": "the forces say where up is, pose by pose",
        "sole_compliance": "the forces say where up is, and P is attached to the soles",
    }
    return reasons.get(name.partition("@")[0], "no reading of this session has to do with it")
