# SPDX-License-Identifier: Apache-2.0
"""A session folder, new or begun before, together with the source that measures into it."""

from __future__ import annotations

import secrets
from collections.abc import Generator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path

from comcal.errors import UsageError
from comcal.measure.plan import PlannedPose
from comcal.measure.session import (
    Session,
    check_same_experiment,
    create_session,
    is_session,
    open_session,
)
from comcal.measure.source import CountingSource, Source, SourceRequest
from comcal.robot.changes import Change
from comcal.robot.changes_text import change_text
from comcal.robot.model import Robot
from comcal.workflow.sealed import SEAL, Truth, refuse_old_truth, reopened_truth, write_truth
from comcal.workflow.sources import moves_itself, open_measuring

SEED_BITS = 32


@dataclass(frozen=True)
class SourceOrder:
    """What to measure with, and where to.

    Parameters
    ----------
    directory : Path
        The session folder, new or begun before.
    source : str
        ``NAME`` or ``NAME:ARGUMENT``.
    seed : int or None
        None: that of the session, else a fresh one.
    noise : bool
        False asks a simulated source for the engine's own values.
    changes : tuple of Change
        Effects to hide in a simulated source; what they are stays out of the session folder.
    argv : tuple of str
        The command typed, for the truth beside the folder.
    """

    directory: Path
    source: str
    seed: int | None = None
    noise: bool = True
    changes: tuple[Change, ...] = ()
    argv: tuple[str, ...] = ()


@dataclass(frozen=True)
class OpenSession:
    """A session and its open source.

    Parameters
    ----------
    session : Session
    source : Source
    is_resumed : bool
        Whether the session existed before.
    seed : int or None
        With it the same measurement can be made again; None where nothing is simulated.
    """

    session: Session
    source: Source
    is_resumed: bool
    seed: int | None

    @property
    def moves_itself(self) -> bool:
        """Whether the source is its own commander."""
        return moves_itself(self.source)


@contextmanager
def opened_session(
    order: SourceOrder, robot: Robot, plan: tuple[PlannedPose, ...]
) -> Generator[OpenSession, None, None]:
    """Open the source, then the session; the source is closed at the end.

    Parameters
    ----------
    order : SourceOrder
    robot : Robot
    plan : tuple of PlannedPose
        All poses of the session, for sources to which they matter.

    Raises
    ------
    UsageError
        If robot.yaml, source and folder are not usable together.
    MissingExtraError
        If the source's engine is not installed.
    """
    # Everything that can be refused is refused before the source, perhaps a robot, is touched.
    is_resumed = is_session(order.directory)
    truth: Truth | None = None
    known: int | None = None
    if is_resumed:
        known, truth = _resumed(order, robot)
    else:
        refuse_old_truth(order.directory)
    wanted = order.seed if known is None else known
    seed = secrets.randbits(SEED_BITS) if wanted is None else wanted
    begins = bool(order.changes) and truth is None
    if begins:
        truth = Truth(seed, order.changes, argv=order.argv)
    with closing(_opened(order, robot, seed, plan)) as source:
        details: dict[str, object] = {"engine": source.name, "noise": order.noise}
        if truth is not None:
            details[SEAL] = truth.seal()
        # Nothing is lost in a simulation: what counts losses reads a log.
        is_simulated = moves_itself(source) and not isinstance(source, CountingSource)
        session = create_session(
            order.directory,
            robot,
            source=order.source,
            seed=seed if truth is None and is_simulated else None,
            details=details,
        )
        if begins and truth is not None:
            write_truth(order.directory, truth)
        yield OpenSession(session, source, is_resumed, seed if is_simulated else None)


def _resumed(order: SourceOrder, robot: Robot) -> tuple[int | None, Truth | None]:
    """Return the seed of the session, and what it hides, if it is the same work."""
    session = open_session(order.directory)
    truth = reopened_truth(order.directory, session.metadata, order.changes, order.seed)
    check_same_experiment(session, robot, order.source, order.seed if truth is None else None)
    noise = session.metadata.get("noise")
    if noise != order.noise:
        raise UsageError(
            f"this session was begun {'with' if noise else 'without'} noise",
            where=str(order.directory),
            next_step=f"{'leave out' if noise else 'add'} --no-noise, or give a new folder with -s",
        )
    return session.seed if truth is None else truth.seed, truth


def _opened(order: SourceOrder, robot: Robot, seed: int, plan: tuple[PlannedPose, ...]) -> Source:
    name, _, argument = order.source.partition(":")
    return open_measuring(
        name,
        SourceRequest(
            robot=robot,
            seed=seed,
            argument=argument,
            effects=tuple(change_text(change) for change in order.changes),
            noise=order.noise,
            options=robot.sources.get(name),
            directory=order.directory,
            plan=plan,
        ),
    )
