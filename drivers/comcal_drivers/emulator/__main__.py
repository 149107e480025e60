# SPDX-License-Identifier: Apache-2.0
"""Entry point of the emulator process."""

from __future__ import annotations

import sys

from comcal_drivers.emulator.parent import Leash


def main() -> int:
    """Run the emulator; the leash is made before the slow imports."""
    leash = Leash()
    # No MF4 is written here; with this package, python-can would import pandas and sympy as well,
    # and the robot would speak four seconds later.
    sys.modules["asammdf"] = None  # pyright: ignore[reportArgumentType]
    from comcal_drivers.emulator.command import serve

    return serve(sys.argv[1:], leash)


if __name__ == "__main__":
    sys.exit(main())
