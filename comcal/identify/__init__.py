# SPDX-License-Identifier: Apache-2.0
"""Least squares, rank, null space in words, covariance."""
