# SPDX-License-Identifier: Apache-2.0
"""MCAP files that break off: a recorder that was killed, or a robot whose battery was empty.

Such a file has no index; what is before the break is read chunk by chunk.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

from mcap.exceptions import McapError
from mcap.records import Channel, Chunk, Message, Schema
from mcap.stream_reader import StreamReader, breakup_chunk

MAGIC = b"\x89MCAP0\r\n"


@dataclass(frozen=True)
class TornConnection:
    """A topic of a torn file, with the fields that ``rosbags`` gives it too.

    Parameters
    ----------
    id : int
    topic, msgtype : str
    msgcount : int
    """

    id: int
    topic: str
    msgtype: str
    msgcount: int


def is_torn(path: Path) -> bool:
    """Whether a file begins as MCAP and does not end as such."""
    with path.open("rb") as file:
        if file.read(len(MAGIC)) != MAGIC:
            return False
        file.seek(-len(MAGIC), 2)
        return file.read() != MAGIC


class TornMcap:
    """A torn file; of the methods of the readers of ``rosbags`` it has those that are needed here.

    Parameters
    ----------
    path : Path
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self.connections: list[TornConnection] = []
        self.start_time = 0
        self.end_time = 0

    @property
    def message_count(self) -> int:
        """Number of messages before the break."""
        return sum(connection.msgcount for connection in self.connections)

    def __enter__(self) -> TornMcap:
        schemas: dict[int, str] = {}
        channels: dict[int, tuple[str, str]] = {}
        counts: dict[int, int] = {}
        times: list[int] = []
        for records in self._pieces():
            for record in records:
                if isinstance(record, Schema):
                    schemas[record.id] = record.name
                elif isinstance(record, Channel):
                    channels[record.id] = record.topic, schemas.get(record.schema_id, "")
                elif isinstance(record, Message):
                    counts[record.channel_id] = counts.get(record.channel_id, 0) + 1
                    times = [min([*times, record.log_time]), max([*times, record.log_time])]
        self.start_time, self.end_time = (times[0], times[1] + 1) if times else (0, 0)
        self.connections = [
            TornConnection(key, topic, kind, counts.get(key, 0))
            for key, (topic, kind) in channels.items()
        ]
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        pass

    def messages(
        self, connections: Sequence[TornConnection], start: int | None = None
    ) -> Iterator[tuple[TornConnection, int, bytes]]:
        """Return connection, time of writing [ns] and bytes of the messages before the break.

        Parameters
        ----------
        connections : sequence of TornConnection
        start : int or None
            First time of writing [ns].
        """
        wanted = {connection.id: connection for connection in connections}
        for records in self._pieces():
            chosen = [r for r in records if isinstance(r, Message) and r.channel_id in wanted]
            for message in sorted(chosen, key=lambda m: m.log_time):
                if start is None or message.log_time >= start:
                    yield wanted[message.channel_id], message.log_time, message.data

    def _pieces(self) -> Iterator[Sequence[object]]:
        """Return the records of one chunk after the other, as far as they are whole."""
        with self._path.open("rb") as file:
            try:
                for record in StreamReader(file, emit_chunks=True).records:
                    if isinstance(record, Chunk):
                        yield breakup_chunk(record, validate_crc=True)
                    else:
                        yield (record,)
            except (McapError, ValueError, struct.error):
                return  # the break
