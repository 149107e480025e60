# SPDX-License-Identifier: Apache-2.0
"""What named causes do to a model: one small module for each of them."""
