# SPDX-License-Identifier: Apache-2.0
"""Drives whose frames an EDS or DCF lays out."""

from __future__ import annotations

import tempfile
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from comcal_drivers.canopen_setup.fit import fit_joint
from comcal_drivers.devices.configuration import CanConfig


@contextmanager
def fitted(config: CanConfig) -> Generator[CanConfig, None, None]:
    """Yield the configuration with the layout of every drive that names an EDS or a DCF.

    Raises
    ------
    ConfigError
        If such a file cannot be used.
    """
    with tempfile.TemporaryDirectory(prefix="comcal-layouts-") as folder:
        joints = {name: fit_joint(joint, Path(folder)) for name, joint in config.joints.items()}
        yield replace(config, joints=joints)
