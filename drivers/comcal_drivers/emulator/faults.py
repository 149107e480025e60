# SPDX-License-Identifier: Apache-2.0
"""What can be made to go wrong between the encoder and the adapter, as words on a command line."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches

from comcal.errors import ConfigError

EXAMPLE = "drop:device=l_foot,probability=0.01,seed=7"

_COMMON: Mapping[str, type] = {
    "device": str,
    "probability": float,
    "at": int,
    "pose": int,
    "times": int,
    "seed": int,
}

KINDS: Mapping[str, Mapping[str, type]] = {
    "drop": {"part": int},
    "duplicate": {"part": int},
    "reorder": {"part": int, "by": int},
    "swap_halves": {},
    "dlc": {"part": int, "length": int},
    "saturate": {"channel": int, "low": int},
    "status": {"bit": int},
    "counter_jump": {"by": int},
    "counter_wrap": {"before": int},
    "clock_step": {"by": float},
    "silence": {"duration": float},
    "disconnect": {"duration": float},
    "bus_off": {"duration": float},
}
"""Every kind of fault with the keys that it has beside the common ones."""

OF_THE_BUS = frozenset({"clock_step", "disconnect", "bus_off"})
"""Kinds that befall all devices of a bus together; ``silence`` does unless a device is named."""


@dataclass(frozen=True)
class Fault:
    """One fault, and when it strikes.

    Parameters
    ----------
    kind : str
        A key of :data:`KINDS`.
    device : str
        Name in robot.yaml; empty: every device that can have it.
    probability : float
        With which each sample is struck; not used together with ``at``.
    at : int or None
        Strikes this sample of a pose, counted from zero.
    pose : int or None
        Only in this pose; None: in every one.
    times : int or None
        At most so often; None: as often as it comes.
    seed : int
        Of the random numbers of this fault.
    part : int or None
        Which message of a sample; None: any, drawn anew each time.
    by : float
        Frames by which a frame comes late (at most: those of one identifier keep their order unless
        they are counted), steps of a counter, seconds of a clock.
    length : int or None
        Payload bytes of a frame whose length is wrong; None: one less than it has.
    channel : int or None
        Which raw value saturates; None: drawn.
    low : int
        1: at its lower limit, 0: at its upper one.
    bit : int
        Of the status word.
    before : int
        Samples that still come before the counter starts again from zero.
    duration : float
        [s] of wall-clock time.
    """

    kind: str
    device: str = ""
    probability: float = 0.01
    at: int | None = None
    pose: int | None = None
    times: int | None = None
    seed: int = 0
    part: int | None = None
    by: float | None = None
    length: int | None = None
    channel: int | None = None
    low: int = 0
    bit: int | None = None
    before: int = 3
    duration: float = 1.0

    @property
    def is_of_the_bus(self) -> bool:
        """Whether it befalls all devices together."""
        return self.kind in OF_THE_BUS or (self.kind == "silence" and not self.device)


def fault_from(text: str) -> Fault:
    """Return the fault that *text* describes, such as ``dlc:device=l_foot,at=20,length=5``.

    Raises
    ------
    ConfigError
        If the kind or a key is unknown, or a value is not a number of its kind.
    """
    kind, _, rest = text.partition(":")
    if kind not in KINDS:
        raise _refused(f"there is no fault {kind!r}", text, kind, list(KINDS))
    keys = {**_COMMON, **KINDS[kind]}
    given = dict[str, object]()
    for item in filter(None, rest.split(",")):
        key, equals, value = item.partition("=")
        if key not in keys or not equals:
            raise _refused(f"{key!r} is not a key of the fault {kind}", text, key, list(keys))
        try:
            given[key] = keys[key](value)
        except ValueError:
            raise ConfigError(
                f"{key}={value} is not a number of the kind that is wanted",
                where=f"--fault {text}",
                limit="a whole number" if keys[key] is int else "a number",
                next_step=f"write it like {EXAMPLE}",
            ) from None
    fault = Fault(kind, **given)  # pyright: ignore[reportArgumentType]
    if not 0.0 <= fault.probability <= 1.0 or fault.duration < 0.0:
        raise ConfigError(
            "a probability lies between 0 and 1, and no duration is negative",
            where=f"--fault {text}",
            next_step=f"write it like {EXAMPLE}",
        )
    return fault


def _refused(what: str, text: str, word: str, known: list[str]) -> ConfigError:
    near = get_close_matches(word, known, n=1)
    return ConfigError(
        what,
        where=f"--fault {text}",
        next_step=(f"did you mean {near[0]}? " if near else "") + f"known: {', '.join(known)}",
    )
