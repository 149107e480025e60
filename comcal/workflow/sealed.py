# SPDX-License-Identifier: Apache-2.0
"""What a simulated session hides: kept beside its folder, and only a seal of it inside.

``DIR.truth.yaml`` holds the seed and the effects. ``session.yaml`` holds ``sealed``, the SHA-256 of
both and of a random salt that is in the truth alone, so nothing can be guessed from it, and yet it
can be proven later which truth belonged to which session. Diagnosing never reads the truth;
recording does, to go on with a session that it began.
"""

from __future__ import annotations

import hashlib
import json
import secrets
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from comcal.errors import ConfigError, UsageError
from comcal.measure.session_yaml import read_metadata, write_metadata
from comcal.robot.changes import Change
from comcal.robot.changes_text import change_text
from comcal.robot.changes_yaml import KnownChange, changes_in, effects_data
from comcal.robot.locate import read_yaml

FORMAT = "comcal-truth/1"
SEAL = "sealed"
"""Key of the seal in ``session.yaml``."""


@dataclass(frozen=True)
class Truth:
    """What was hidden.

    Parameters
    ----------
    seed : int
        Master seed of the recording.
    changes : tuple of Change
    salt : str
        Random, so that the seal gives nothing away.
    argv : tuple of str
        The command that was typed; not sealed.
    """

    seed: int
    changes: tuple[Change, ...]
    salt: str = field(default_factory=lambda: secrets.token_hex(16))
    argv: tuple[str, ...] = ()

    def seal(self) -> str:
        """Return the SHA-256 that goes into the session."""
        content = [self.salt, self.seed, [change_text(change) for change in self.changes]]
        return hashlib.sha256(json.dumps(content).encode()).hexdigest()


def truth_path(directory: Path) -> Path:
    """Return where the truth of a session lies: ``DIR.truth.yaml``, beside its folder."""
    directory = Path(directory).resolve()
    return directory.with_name(f"{directory.name}.truth.yaml")


def refuse_old_truth(directory: Path) -> None:
    """Make sure that a new session will not meet the truth of another one.

    Raises
    ------
    UsageError
        If there is one beside its folder.
    """
    if truth_path(directory).exists():
        raise UsageError(
            "there is a truth already, of a session that is gone",
            where=str(truth_path(directory)),
            next_step="move it away, or give another folder with -s",
        )


def write_truth(directory: Path, truth: Truth) -> Path:
    """Write the truth beside the folder of a session that begins, and return its path."""
    path = truth_path(directory)
    write_metadata(
        path,
        {
            "format": FORMAT,
            "seed": truth.seed,
            "salt": truth.salt,
            "argv": list(truth.argv),
            "effects": effects_data([KnownChange(change) for change in truth.changes]),
        },
    )
    return path


def read_truth(directory: Path) -> Truth:
    """Return what the session in *directory* hides; for tests, studies and the demo's last line.

    Raises
    ------
    ConfigError
        If there is no truth beside it, or it is damaged.
    """
    path = truth_path(directory)
    found = read_metadata(path, FORMAT)
    changes = tuple(known.change for known in changes_in(read_yaml(path)))
    seed, salt, argv = found.get("seed"), found.get("salt"), found.get("argv")
    if not isinstance(seed, int) or not isinstance(salt, str):
        raise ConfigError(
            "lacks its seed or salt", where=str(path), next_step="restore it from a copy"
        )
    words = [str(word) for word in argv] if isinstance(argv, list) else []
    return Truth(seed, changes, salt, tuple(words))


def reopened_truth(
    directory: Path, metadata: Mapping[str, object], changes: Sequence[Change], seed: int | None
) -> Truth | None:
    """Return the truth with which a session goes on; None when it hides nothing.

    Parameters
    ----------
    directory : Path
    metadata : mapping
        Of its ``session.yaml``.
    changes : sequence of Change
        What is asked for now.
    seed : int or None
        The same; None: whatever it was.

    Raises
    ------
    UsageError
        If other effects or another seed are asked for than when it was begun.
    ConfigError
        If the truth is lost, or not that of this session.
    """
    seal = metadata.get(SEAL)
    if seal is None:
        if changes:
            raise _other(directory, "without hidden effects", "leave out --effect and --model")
        return None
    truth = read_truth(directory)
    if truth.seal() != seal:
        raise ConfigError(
            "is not the truth of this session: their seals differ",
            where=str(truth_path(directory)),
            next_step="restore it from a copy, or give a new folder with -s",
        )
    if tuple(changes) != truth.changes or seed not in (None, truth.seed):
        raise _other(directory, "with other effects or another seed", "type the same command again")
    return truth


def _other(directory: Path, begun: str, next_step: str) -> UsageError:
    return UsageError(
        f"this session was begun {begun}",
        where=str(directory),
        next_step=f"{next_step}, or give a new folder with -s",
    )
