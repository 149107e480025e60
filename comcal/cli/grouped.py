# SPDX-License-Identifier: Apache-2.0
"""What a source tells about its devices, in few words: a robot may have thirty drives."""

from __future__ import annotations

from collections.abc import Mapping

from comcal.measure.source import SourceStatus

NAMED = 3
"""Of so many that have the same number, all are named; of more, the first."""


def rates_text(status: SourceStatus) -> str:
    """Return the rates of all devices and buses, those that are the same to a few per cent as one.

    Parameters
    ----------
    status : SourceStatus

    Returns
    -------
    str
        Empty where none are known.
    """
    groups: list[tuple[float, list[str]]] = []
    for name, rate in status.rates.items():
        same = (g for g in groups if abs(g[0] - rate) <= 0.02 * max(g[0], rate))
        found = next(same, None)
        if found is None:
            groups.append((rate, [name]))
        else:
            found[1].append(name)
    return ", ".join(f"{_names(names)} {rate:.0f}/s" for rate, names in groups)


def losses_text(status: SourceStatus) -> str:
    """Return what was lost, by kind; devices that lost equally many as one.

    Parameters
    ----------
    status : SourceStatus
        A key of ``lost`` is a device, or a device and a kind of loss.

    Returns
    -------
    str
        Empty if nothing was lost.
    """
    return ", ".join(grouped_losses(status.lost))


def grouped_losses(lost: Mapping[str, int]) -> list[str]:
    """Return one phrase for each kind and number of what was lost."""
    groups: dict[tuple[str, int], list[str]] = {}
    for key, count in lost.items():
        name, _, kind = key.rpartition(" ")
        if count:
            groups.setdefault((kind if name else "", count), []).append(name or kind)
    return [
        " ".join(filter(None, (_names(names), kind, str(count))))
        for (kind, count), names in groups.items()
    ]


def _names(names: list[str]) -> str:
    if len(names) <= NAMED:
        return ", ".join(names)
    return f"{names[0]} and {len(names) - 1} more"
