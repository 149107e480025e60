# SPDX-License-Identifier: Apache-2.0
"""Sensors and drives as files, and which of them hang on which bus of a robot."""
