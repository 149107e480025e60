# SPDX-License-Identifier: Apache-2.0
"""``python -m comcal`` is ``comcal``."""

import sys

from comcal.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
