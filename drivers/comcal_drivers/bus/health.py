# SPDX-License-Identifier: Apache-2.0
"""How a bus is doing, as a value."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class BusHealth:
    """What a reader has seen of its bus since it was opened.

    Parameters
    ----------
    name : str
        Of the bus in robot.yaml.
    frames : int
        Received, error frames not counted.
    sent : int
        Sent through this reader.
    error_frames : int
        Received error frames.
    bus_off : bool
        The controller has left the bus: nothing comes or goes until it is restarted.
    bus_offs : int
        How often it has.
    lost_by_kernel : int
        Frames that SocketCAN's receive buffer had no room for.
    lost_before_log : int
        Frames that came faster than they could be logged: they are in no file.
    dropped_by_queue : int
        Frames that are in the log, but that nobody took in time.
    garbage : int
        Lines of the adapter that were no frames: bytes were lost on their way.
    silences : int
        How often nothing came for longer than allowed.
    is_silent : bool
        Nothing is coming now.
    is_connected : bool
        The device is there.
    reconnects : int
        How often it went and came back.
    last_seen : float
        When the last frame came [s since 1970]; NaN before the first.
    receive_buffer : int
        Granted by the kernel [bytes]; 0 where there is none.
    exception : str
        The last thing that went wrong; empty if nothing did.
    """

    name: str
    frames: int
    sent: int
    error_frames: int
    bus_off: bool
    bus_offs: int
    lost_by_kernel: int
    lost_before_log: int
    dropped_by_queue: int
    garbage: int
    silences: int
    is_silent: bool
    is_connected: bool
    reconnects: int
    last_seen: float
    receive_buffer: int
    exception: str

    @property
    def lost(self) -> int:
        """Frames that are known to be missing from what was taken."""
        return self.lost_by_kernel + self.lost_before_log + self.dropped_by_queue
