# SPDX-License-Identifier: Apache-2.0
"""Devices that obey commands, one family a module, each written from its manual."""
