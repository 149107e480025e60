# SPDX-License-Identifier: Apache-2.0
"""Live buses: opening them, reading them without loss, and saying so when something was lost."""
