# SPDX-License-Identifier: Apache-2.0
"""In the guest, python-can does without asammdf, which it would import for logs that nobody reads
here: with what that brings along, half a minute on one emulated core."""

from __future__ import annotations

import os
import sys

if "COMCAL_GUEST" in os.environ:
    sys.modules["asammdf"] = None
