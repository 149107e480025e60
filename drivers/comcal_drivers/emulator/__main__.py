# SPDX-License-Identifier: Apache-2.0
"""Entry point of the emulator process."""

from __future__ import annotations

import sys

from comcal_drivers.emulator.parent import Leash


def main() -> int:
    """Run the emulator; the leash is made before the slow imports."""
    leash = Leash()
    from comcal_drivers.emulator.command import serve

    return serve(sys.argv[1:], leash)


if __name__ == "__main__":
    sys.exit(main())
