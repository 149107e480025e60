# SPDX-License-Identifier: Apache-2.0
"""What the model gets wrong: residuals against noise and healthy spread, and causes by name."""
