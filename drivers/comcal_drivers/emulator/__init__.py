# SPDX-License-Identifier: Apache-2.0
"""A robot to talk to: emulated devices behind an emulated adapter, in a process of their own."""
