# SPDX-License-Identifier: Apache-2.0
"""What a world says of springs that has none of its own."""

from __future__ import annotations

from collections.abc import Mapping

from comcal.errors import UsageError
from comcal_sims.world import Spring


class Springless:
    """A world whose joints have no springs: soft ones follow the torques from outside."""

    @property
    def stiffest_spring(self) -> float:
        """Zero: there are no springs here."""
        return 0.0

    def soften(self, springs: Mapping[str, Spring]) -> None:
        """Refuse springs.

        Raises
        ------
        UsageError
            If there are any.
        """
        if springs:
            raise UsageError(
                "this world has no springs",
                where=f"springs at {', '.join(springs)}",
                next_step="let the joints follow the torques instead",
            )
