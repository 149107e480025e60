# SPDX-License-Identifier: Apache-2.0
"""From the frames of all buses to blocks of samples: live, and from logs."""
