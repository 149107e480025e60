# SPDX-License-Identifier: Apache-2.0
"""The moment balance on symbols: derivations, Cramer's rule as formulas, and code made of them."""
