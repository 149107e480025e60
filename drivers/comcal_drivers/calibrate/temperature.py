# SPDX-License-Identifier: Apache-2.0
"""Temperatures, which devices send in messages of their own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from comcal_drivers.decode.table import Decoded, DecodeTable
from comcal_drivers.devices.description import Device


@dataclass(frozen=True)
class Temperatures:
    """Readings of one thermometer.

    ``t``: stamps [s]; ``row``: running index of each frame; ``value``: [deg C]; each shape (n,).
    """

    t: npt.NDArray[np.float64]
    row: npt.NDArray[np.int64]
    value: npt.NDArray[np.float64]


def temperatures(
    device: Device,
    table: DecodeTable,
    decoded: Mapping[int, Decoded],
    t: npt.NDArray[np.float64],
    first_row: int,
) -> Temperatures:
    """Return what a device's thermometer says in a decoded batch; nothing where it has none.

    Parameters
    ----------
    device : Device
    table : DecodeTable
        Its messages.
    decoded : mapping from identifier to Decoded
        The batch.
    t : array, shape (n_frames,)
        Stamps of the batch [s].
    first_row : int
        Running index of its first frame.
    """
    rule = device.description.temperature
    part = None if rule is None else decoded.get(table.id_of(rule.message))
    if rule is None or part is None:
        return Temperatures(np.empty(0), np.empty(0, np.int64), np.empty(0))
    good = ~part.bad
    rows = part.rows[good]
    value = part.values[rule.signal][good] * rule.scale
    return Temperatures(t[rows], rows.astype(np.int64) + first_row, value)
