# SPDX-License-Identifier: Apache-2.0
"""What moves a real robot: opt-in, slow, and stoppable."""
