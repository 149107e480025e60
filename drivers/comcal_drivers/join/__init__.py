# SPDX-License-Identifier: Apache-2.0
"""The parts of one sample brought together: by counter, first in first out, or byte by byte."""
