# SPDX-License-Identifier: Apache-2.0
"""The frames that start and question a device, and what its answers say.

Nothing is sent here. :func:`command_frames` makes the frames; a :class:`Listener` watches frames go
by, its own and others', live or out of a log, and keeps what the device told.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from comcal.errors import ConfigError
from comcal.robot.validate import did_you_mean
from comcal_drivers.decode.dbc import read_dbc
from comcal_drivers.devices.description import Command, DataField, DataSum, Device, Gives, Step
from comcal_drivers.frames.batch import ERROR, EXTENDED, REMOTE, FrameBatch

if TYPE_CHECKING:
    from cantools.database.can import Database

DeviceValues = Mapping[str, "float | tuple[float, ...] | str"]
"""What a device told about itself, by the names under ``gives``: ``matrix`` (row by row),
``full_scale``, ``counts_per_force``, ``serial`` ..."""

FRAME_BYTES = 8
_FORMATS = {
    "u8": "<B", "i8": "<b", "u16le": "<H", "u16be": ">H", "u32le": "<I", "u32be": ">I",
    "f32le": "<f", "f32be": ">f",
}  # fmt: skip


@dataclass(frozen=True)
class CommandFrame:
    """One frame to send.

    Parameters
    ----------
    id : int
        As in :class:`~comcal_drivers.frames.batch.FrameBatch`.
    data : bytes
    is_last : bool
        Whether the answers come after this one: of several frames for one step, the last.
    timeout : float
        How long to wait for the answers [s].
    """

    id: int
    data: bytes
    is_last: bool
    timeout: float


def command_frames(
    device: Device, name: str, settings: Mapping[str, float] | None = None
) -> tuple[CommandFrame, ...]:
    """Return the frames of a command, in order.

    Parameters
    ----------
    device : Device
    name : str
        One of ``commands`` of the description.
    settings : mapping from str to float, optional
        Replace the description's.

    Raises
    ------
    ConfigError
        If there is no such command or setting, or a value does not fit into its bytes.
    """
    commands = device.description.commands
    if name not in commands:
        raise ConfigError(
            f"device {device.description.name} has no command {name!r}",
            next_step=did_you_mean(name, list(commands)),
        )
    known = {**device.description.settings, **device.ids, **(settings or {})}
    frames = list[CommandFrame]()
    for step in commands[name].steps:
        for variables in _rounds(step):
            data = _payload(step, {**known, **variables})
            pieces = [data[i : i + FRAME_BYTES] for i in range(0, len(data), FRAME_BYTES)] or [b""]
            frames += [
                CommandFrame(device.step_id(step), piece, piece is pieces[-1], step.timeout)
                for piece in pieces
            ]
    return tuple(frames)


def _rounds(step: Step) -> Iterator[dict[str, int]]:
    """Yield the loop variables of every repetition of a step."""
    if not step.repeat:
        yield {}
    for name, values in step.repeat.items():
        for value in values:
            yield {name: value}


def _payload(step: Step, known: Mapping[str, float]) -> bytes:
    """Return the bytes of a step."""
    data = b""
    for item in step.data:
        if isinstance(item, DataField):
            data += _bytes_of(item, known)
        elif isinstance(item, DataSum):
            size = struct.calcsize(_FORMATS[item.sum])
            data += struct.pack(_FORMATS[item.sum], sum(data) % (1 << 8 * size))
        else:
            data += bytes([item])
    return data.ljust(step.pad, b"\0")


def _bytes_of(item: DataField, known: Mapping[str, float]) -> bytes:
    """Return the bytes of a value."""
    if item.value not in known:
        raise ConfigError(
            f"nobody says what {item.value!r} is", next_step=did_you_mean(item.value, list(known))
        )
    value = known[item.value] * item.scale
    try:
        return struct.pack(
            _FORMATS[item.type], value if item.type.startswith("f") else round(value)
        )
    except struct.error as error:
        raise ConfigError(
            f"{item.value} does not fit into the device's {item.type}",
            measured=f"{value:g}",
            next_step=f"give another value under `settings: {{{item.value}: ...}}`",
        ) from error


@dataclass(frozen=True)
class _Question:
    """One repetition of one step, as it is recognised on the bus."""

    command: str
    place: int
    id: int
    pattern: tuple[int | None, ...]
    """Bytes that must be; None where a setting stands, that may have been another."""
    answers: tuple[tuple[int, str, Mapping[str, int]], ...]
    """Identifier, message and signals that must have given values."""

    def is_asked(self, number: int, data: bytes) -> bool:
        """Tell whether a frame asks this question."""
        return (
            number == self.id
            and len(data) == len(self.pattern)
            and all(p is None or p == b for p, b in zip(self.pattern, data, strict=True))
        )


@dataclass
class _Open:
    """A question whose answers are not all there."""

    question: _Question
    missing: list[int]
    got: dict[str, float] = field(default_factory=dict[str, float])


class Listener:
    """Keeps what a device tells when it is asked, whoever asks.

    Parameters
    ----------
    device : Device

    Notes
    -----
    An answer is taken for the last question that was seen; the answers to a question whose frame
    was not seen are not understood, because most devices do not say what they answer.
    """

    def __init__(self, device: Device) -> None:
        self._database = read_dbc(device.dbc)
        self._commands = device.description.commands
        self._questions = [
            question
            for name, command in self._commands.items()
            for question in _questions(device, self._database, name, command)
        ]
        self._asked = {q.id for q in self._questions}
        self._told: dict[str, dict[int, dict[str, float]]] = {}
        self._open: _Open | None = None
        self.questions = 0
        """How many questions were seen so far."""

    @property
    def is_waiting(self) -> bool:
        """Whether a question is open."""
        return self._open is not None

    def is_question(self, frame: CommandFrame) -> bool:
        """Tell whether a frame is one that the device answers."""
        return any(question.is_asked(frame.id, frame.data) for question in self._questions)

    @property
    def values(self) -> DeviceValues:
        """What was told completely, the newest of each."""
        values = dict[str, float | tuple[float, ...] | str]()
        for name, told in self._told.items():
            command = self._commands[name]
            asked = [q.place for q in self._questions if q.command == name]
            if all(place in told for place in asked):
                for value, gives in command.gives.items():
                    values[value] = _value(gives, [told[place] for place in asked])
        return values

    def see(self, batch: FrameBatch) -> None:
        """Watch frames go by, sent and received ones, in order."""
        plain = batch.kinds & (ERROR | REMOTE) == 0
        wanted = {*self._asked, *(a[0] for q in self._questions for a in q.answers)}
        for row in np.flatnonzero(plain & np.isin(batch.ids, list(wanted))).tolist():
            payload = batch.data[row, : batch.lengths[row]].tobytes()
            self._see_one(int(batch.ids[row]), payload)

    def _see_one(self, number: int, data: bytes) -> None:
        if self._open is not None and self._takes(self._open, number, data):
            if not self._open.missing:
                question = self._open.question
                self._told.setdefault(question.command, {})[question.place] = self._open.got
                self._open = None
            return
        for question in self._questions:
            if question.is_asked(number, data):
                self.questions += 1
                self._open = _Open(question, list(range(len(question.answers))))
                return

    def _takes(self, waiting: _Open, number: int, data: bytes) -> bool:
        """Tell whether a frame is one of the answers waited for, and keep it."""
        for place in waiting.missing:
            identifier, name, match = waiting.question.answers[place]
            message = self._database.get_message_by_name(name)
            if number != identifier or not data:
                continue
            decoded = message.decode(data, decode_choices=False, allow_truncated=True)
            if not isinstance(decoded, dict):
                continue
            signals = {k: float(v) for k, v in decoded.items() if isinstance(v, int | float)}
            if all(signals.get(signal) == value for signal, value in match.items()):
                waiting.got.update(signals)
                waiting.missing.remove(place)
                return True
        return False


def _questions(
    device: Device, database: Database, name: str, command: Command
) -> Iterator[_Question]:
    """Yield the questions of a command that are answered."""
    place = 0
    for step in command.steps:
        for variables in _rounds(step):
            if not step.replies:
                continue
            answers = tuple(
                (
                    _identifier(device, database, reply.message),
                    reply.message,
                    {s: variables[v] if isinstance(v, str) else v for s, v in reply.match.items()},
                )
                for reply in step.replies
            )
            pattern = tuple(_pattern(step.data, {**device.ids, **variables}))
            yield _Question(name, place, device.step_id(step), pattern, answers)
            place += 1


def _pattern(
    data: Sequence[int | DataField | DataSum], fixed: Mapping[str, float]
) -> Iterator[int | None]:
    """Yield the bytes of a question that are known beforehand."""
    for item in data:
        if isinstance(item, DataField):
            if item.value in fixed:
                yield from _bytes_of(item, fixed)
            else:
                yield from [None] * struct.calcsize(_FORMATS[item.type])
        elif isinstance(item, DataSum):
            yield from [None] * struct.calcsize(_FORMATS[item.sum])
        else:
            yield item


def _identifier(device: Device, database: Database, message: str) -> int:
    """Return the identifier of a message on the bus."""
    found = database.get_message_by_name(message)
    return device.relocate(found.frame_id) | (int(EXTENDED) if found.is_extended_frame else 0)


def _value(gives: Gives, told: Sequence[Mapping[str, float]]) -> tuple[float, ...] | str:
    """Return one device value from the answers of a command."""
    raw = [answer[name] for answer in told for name in gives.signals if name in answer]
    if gives.text:
        return bytes(int(byte) for byte in raw).split(b"\0")[0].decode("ascii", "replace").strip()
    if gives.table is not None:
        return tuple(gives.table.get(int(code), float("nan")) for code in raw)
    return tuple(value * gives.scale for value in raw)
