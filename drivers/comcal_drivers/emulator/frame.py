# SPDX-License-Identifier: Apache-2.0
"""One frame on an emulated bus, and where it comes from."""

from __future__ import annotations

from typing import NamedTuple

EXTENDED = 1 << 31
"""Set in ``id`` for identifiers of 29 bits."""

REMOTE, ERROR = 1, 2
"""Values of ``kind`` beside 0, a data frame."""


class Frame(NamedTuple):
    """A frame, and which part of which sample it is.

    Parameters
    ----------
    id : int
        Identifier; :data:`EXTENDED` is set for those of 29 bits.
    data : bytes
        Payload; of a remote request as many zeros as are asked for.
    t : float
        Time stamp that an interface with an own clock gives it [s].
    kind : int
        0, :data:`REMOTE` or :data:`ERROR`.
    device : str
        Name in robot.yaml; empty for what belongs to no device.
    part : int
        Which message of a sample; -1 for what is not one (replies, requests).
    sample : int
        Running number of the sample, without wrap; -1 for what is not part of one.
    """

    id: int
    data: bytes = b""
    t: float = 0.0
    kind: int = 0
    device: str = ""
    part: int = -1
    sample: int = -1

    @property
    def bare_id(self) -> int:
        """The identifier without its flag."""
        return self.id & ~EXTENDED
