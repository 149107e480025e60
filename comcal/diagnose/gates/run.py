# SPDX-License-Identifier: Apache-2.0
"""All gates, one after the other."""

from __future__ import annotations

from comcal.diagnose.gates.frozen import frozen_channels, frozen_instruments
from comcal.diagnose.gates.gated import Gated
from comcal.diagnose.gates.quantised import quantised
from comcal.diagnose.gates.saturated import saturated
from comcal.diagnose.gates.settled import settled
from comcal.measure.table import PoseTable
from comcal.predict.assumed import Assumed

GATES = (quantised, frozen_instruments, saturated, frozen_channels, settled)
"""In an order in which none mistakes the business of another: coarse readings repeat themselves by
chance, and what ends at a level repeats itself there."""


def gates(assumed: Assumed, table: PoseTable) -> Gated:
    """Refuse readings that speak against themselves, before anything is fitted.

    Parameters
    ----------
    assumed : Assumed
        Asked only whether a reading that repeats itself should have changed.
    table : PoseTable

    Returns
    -------
    Gated
        The table without the readings refused (NaN), less certain where they are coarse; and what
        was found. Poses stay, so rows keep their numbers.
    """
    so_far = Gated(table)
    for gate in GATES:
        so_far = gate(assumed, so_far)
    return so_far
