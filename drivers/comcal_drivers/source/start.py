# SPDX-License-Identifier: Apache-2.0
"""Starting devices, and asking them what is needed to understand them."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

import can

from comcal.errors import HardwareError
from comcal_drivers.devices.commands import CommandFrame, DeviceValues, Listener, command_frames
from comcal_drivers.devices.configuration import DeviceConfig
from comcal_drivers.frames.batch import EXTENDED, FrameBatch

POLL = 0.02
"""How long one look for an answer takes [s]."""
TRIES = 3
"""A question without an answer is asked so often: a busy bus may lose a frame."""

Send = Callable[[can.Message], None]
Take = Callable[[float], FrameBatch]


def command_device(
    send: Send, take: Take, config: DeviceConfig, commands: tuple[str, ...]
) -> DeviceValues:
    """Send commands to a device and return what it tells.

    Parameters
    ----------
    send, take : callable
        To and from its bus; what was sent is among what is taken.
    config : DeviceConfig
    commands : tuple of str
        Of its description, in order.

    Raises
    ------
    ConfigError
        If there is no such command, or a value does not fit.
    HardwareError
        If the device does not answer.
    """
    device, listener = config.device, Listener(config.device)
    for name in commands:
        pieces: list[CommandFrame] = []
        for frame in command_frames(device, name, config.settings):
            pieces.append(frame)
            if frame.is_last:
                _ask(
                    send, take, listener, pieces, f"{config.name}: {device.description.title}", name
                )
                pieces = []
        _let_pass(take, listener, device.description.commands[name].wait)
    return listener.values


def _ask(
    send: Send,
    take: Take,
    listener: Listener,
    frames: list[CommandFrame],
    who: str,
    command: str,
) -> None:
    """Send one question until it is answered; what needs no answer is sent once."""
    for tried in range(TRIES):
        listener.see(take(0.0))
        seen = listener.questions
        for frame in frames:
            send(_message(frame))
        if not any(listener.is_question(frame) for frame in frames):
            listener.see(take(POLL))
            return
        ends = time.monotonic() + frames[-1].timeout
        # The question itself comes back among the frames, after those that were on their way: only
        # what comes later can be its answer.
        while listener.questions == seen or listener.is_waiting:
            if time.monotonic() > ends:
                break
            listener.see(take(POLL))
        else:
            if tried:
                # The answers to earlier tries may come yet, and are none to the next question.
                _let_pass(take, listener, frames[-1].timeout)
            return
    raise HardwareError(
        f"it does not answer the command {command!r}",
        where=who,
        measured=f"asked {TRIES} times",
        limit=f"{frames[-1].timeout:g} s each",
        next_step="see that it is powered, on this bus, at this bit rate, and that its `ids` in "
        "robot.yaml are those that are set on it",
    )


def _let_pass(take: Take, listener: Listener, seconds: float) -> None:
    ends = time.monotonic() + seconds
    while time.monotonic() < ends:
        listener.see(take(POLL))


def _message(frame: CommandFrame) -> can.Message:
    return can.Message(
        arbitration_id=frame.id & ~int(EXTENDED),
        is_extended_id=bool(frame.id & int(EXTENDED)),
        data=frame.data,
    )


def merged(*told: Mapping[str, DeviceValues]) -> dict[str, DeviceValues]:
    """Return what devices told, the later one winning."""
    found: dict[str, DeviceValues] = {}
    for each in told:
        for name, values in each.items():
            found[name] = {**found.get(name, {}), **values}
    return found
