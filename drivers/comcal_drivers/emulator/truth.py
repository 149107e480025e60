# SPDX-License-Identifier: Apache-2.0
"""The account of every fault that was done, for whoever judges how it was dealt with."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TextIO


class TruthLog:
    """One JSON object a line, on the disk before the faulty frame is on the bus.

    Parameters
    ----------
    path : Path or None
        None: nobody wants to know.
    """

    def __init__(self, path: Path | None = None) -> None:
        self._file: TextIO | None = None if path is None else path.open("w", encoding="utf-8")

    def note(self, fault: str, **details: object) -> None:
        """Write down one fault.

        Parameters
        ----------
        fault : str
            Its kind.
        **details
            Where it struck and what it did.
        """
        if self._file is not None:
            self._file.write(json.dumps({"fault": fault, **details}) + "\n")
            self._file.flush()

    def close(self) -> None:
        """Finish the file."""
        if self._file is not None:
            self._file.close()
            self._file = None
