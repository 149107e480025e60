# SPDX-License-Identifier: Apache-2.0
"""What ``sources.can`` of robot.yaml was understood to say, for ``comcal check``."""

from __future__ import annotations

from comcal.measure.source import SourceRequest
from comcal_drivers.devices.configuration import BusConfig, read_configuration


def describe_can(request: SourceRequest) -> tuple[str, ...]:
    """Return a line for every bus: how it is reached and what hangs on it. Opens nothing.

    Parameters
    ----------
    request : SourceRequest

    Raises
    ------
    ConfigError
        As :func:`read_configuration`.
    """
    config = read_configuration(request.options or {}, request.robot)
    lines = [
        f"{name} ({_way(bus)}): "
        + (
            ", ".join(f"{d.name} {d.device.description.name}" for d in config.devices(name))
            or "nothing"
        )
        for name, bus in config.buses.items()
    ]
    return (*lines, f"rows are the samples of {config.clock}")


def _way(bus: BusConfig) -> str:
    rate = "" if bus.bitrate is None else f", {bus.bitrate / 1000:g} kbit/s"
    return f"{bus.interface} {bus.channel}{rate}".replace(" ,", ",")
