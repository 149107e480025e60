# SPDX-License-Identifier: Apache-2.0
"""What happens during a recording, as data for whoever shows it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from comcal.measure.observe import Observation
from comcal.measure.source import SourceStatus


@dataclass(frozen=True)
class SourceOpened:
    """The source answers.

    Parameters
    ----------
    source : str
        As in ``--source``.
    engine : str
        What it says of itself, such as ``pybullet 3.2.7``.
    seed : int or None
    is_resumed : bool
        Whether the session existed before.
    """

    source: str
    engine: str
    seed: int | None
    is_resumed: bool


@dataclass(frozen=True)
class RecordingStarted:
    """The work is known: ``total`` poses in all, ``finished`` of them recorded before."""

    total: int
    finished: int


@dataclass(frozen=True)
class PoseStarted:
    """The robot is sent to a pose."""

    pose: int


@dataclass(frozen=True)
class PoseFinished:
    """The row of a pose is on the disk.

    Parameters
    ----------
    pose : int
    waited : float
        From the motion to the end of the still window [s], in the source's clock.
    samples : int
        In the window.
    """

    pose: int
    waited: float
    samples: int


@dataclass(frozen=True)
class PoseRetried:
    """The robot did not become still; it is sent once more."""

    pose: int
    reason: str


@dataclass(frozen=True)
class PoseSkipped:
    """The robot did not become still the second time either; the pose has no row.

    Parameters
    ----------
    pose : int
    reason : str
    by_operator : bool
        Somebody chose to leave it out.
    """

    pose: int
    reason: str
    by_operator: bool = False


@dataclass(frozen=True)
class PoseObserved:
    """A look at a real robot while a pose is waited for; comes several times per second."""

    observation: Observation


@dataclass(frozen=True)
class PoseRepeated:
    """Somebody wants the last finished pose measured again; its new row will be ``as_pose``."""

    pose: int
    as_pose: int


@dataclass(frozen=True)
class PlanChanged:
    """The session was begun with a plan of other content; its finished poses were checked."""

    plan: str


@dataclass(frozen=True)
class SidesMissing:
    """Joints by pose id that cannot be approached from the side demanded: there is no room."""

    joints: Mapping[int, tuple[str, ...]]


Event = (
    SourceOpened
    | RecordingStarted
    | PoseStarted
    | PoseFinished
    | PoseRetried
    | PoseSkipped
    | PlanChanged
    | PoseObserved
    | PoseRepeated
    | SidesMissing
)
OnEvent = Callable[[Event], None]


def ignore(event: Event) -> None:
    """Show nothing."""


@dataclass(frozen=True)
class RecordingSummary:
    """What a recording did.

    Parameters
    ----------
    recorded : tuple of int
        Poses finished now.
    before : tuple of int
        Poses that were finished when it started.
    skipped : tuple of PoseSkipped
        Poses that never became still, with what was wrong.
    status : SourceStatus or None
        Of a source that counts, at the end.
    """

    recorded: tuple[int, ...]
    before: tuple[int, ...]
    skipped: tuple[PoseSkipped, ...]
    status: SourceStatus | None = None
