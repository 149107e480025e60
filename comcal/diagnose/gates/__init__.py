# SPDX-License-Identifier: Apache-2.0
"""What readings say about themselves, before anything is fitted to them."""
