# SPDX-License-Identifier: Apache-2.0
"""What other packages bring under an entry-point group, one thing or a sequence of them each."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from importlib import metadata
from typing import Protocol, TypeVar

from comcal.errors import ConfigError


class Named(Protocol):
    """Something with a name of its own."""

    @property
    def name(self) -> str:
        """What it is called."""
        ...


Kind = TypeVar("Kind", bound=Named)


def brought(group: str, kind: type[Kind], known: Iterable[str]) -> Iterator[tuple[Kind, str]]:
    """Yield everything of *kind*, and who brings it.

    Parameters
    ----------
    group : str
        Of entry points.
    kind : type
    known : iterable of str
        Names that are taken.

    Raises
    ------
    ConfigError
        If an entry point names something else, or there are two of one name.
    """
    taken = set(known)
    for entry in metadata.entry_points(group=group):
        things: object = entry.load()
        for thing in things if isinstance(things, Iterable) else (things,):
            if not isinstance(thing, kind):
                raise ConfigError(
                    f"entry point {entry.name!r} brings something that is no {kind.__name__}",
                    where=entry.value,
                    next_step=f"let it name an {kind.__name__} or a sequence of them",
                )
            if thing.name in taken:
                raise ConfigError(
                    f"there are two effects called {thing.name!r}",
                    where=entry.value,
                    next_step="remove one of the packages",
                )
            taken.add(thing.name)
            yield thing, entry.value
