# SPDX-License-Identifier: Apache-2.0
"""CANopen drives: frame layouts from EDS and DCF files, set-up over the bus."""
