# SPDX-License-Identifier: Apache-2.0
"""Bags as streams of messages, whatever version and storage: ``rosbags`` reads them.

One message after the other; of the files only indices and the chunk being read are in memory.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import version
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from typing import Any, Protocol

from mcap.reader import make_reader

from comcal.errors import DataError, MissingExtraError, UsageError
from comcal_drivers.bags.messages import Decoder, Message
from comcal_drivers.bags.torn import TornMcap, is_torn

ROS1 = ".bag"
SUFFIXES = (ROS1, ".mcap", ".db3")
_MENDED_BY = {
    ".bag": "rosbag reindex FILE",
    ".mcap": "mcap recover FILE -o MENDED.mcap",
    ".db3": "ros2 bag reindex FOLDER",
}


@dataclass(frozen=True)
class Topic:
    """A topic of a bag.

    Parameters
    ----------
    kind : str
        Message type, such as ``sensor_msgs/msg/Imu``; ROS 1 types are written like this too.
    count : int
        Number of messages.
    """

    kind: str
    count: int


class _Reader(Protocol):
    """What the readers of all kinds of files have in common."""

    @property
    def connections(self) -> Sequence[Any]: ...
    @property
    def start_time(self) -> int: ...
    @property
    def end_time(self) -> int: ...
    @property
    def message_count(self) -> int: ...
    def messages(
        self, connections: Sequence[Any], start: int | None = None
    ) -> Iterator[tuple[Any, int, bytes]]: ...


class Bag:
    """One or more files that follow one another in time.

    Parameters
    ----------
    path : Path
        A ROS 1 ``.bag``, a ROS 2 folder, a lone ``.mcap`` or ``.db3``, or a folder of such files.

    Raises
    ------
    MissingExtraError
        If ``rosbags`` is not installed.
    UsageError
        If there is no such file, or none that is a bag.
    DataError
        If a file cannot be read, or files of a folder overlap in time.
    """

    def __init__(self, path: Path) -> None:
        if find_spec("rosbags") is None:
            raise MissingExtraError(
                "reading bags needs the package rosbags, which is not installed",
                where="--source bag",
                next_step="type: pip install 'comcal[ros]'",
            )
        self.path = path
        self._files: list[Path] = []
        self.topics: Mapping[str, Topic] = {}
        self._survey()
        self._decoders = _decoders()

    @property
    def name(self) -> str:
        """The file, for messages."""
        return self.path.name

    @property
    def library(self) -> str:
        """Name and version of what reads it."""
        return f"rosbags {version('rosbags')}"

    @property
    def is_own(self) -> bool:
        """Whether comcal wrote the files: MCAP files say who did."""
        return all(path.suffix == ".mcap" and _writer(path) == "comcal" for path in self._files)

    @property
    def torn(self) -> tuple[str, ...]:
        """Files that break off; what is before the break is read."""
        return tuple(path.name for path in self._files if _is_torn(path))

    def messages(self, topics: Sequence[str], start_ns: int | None = None) -> Iterator[Message]:
        """Return the messages of some topics in the order in which they were logged.

        Parameters
        ----------
        topics : sequence of str
        start_ns : int or None
            Log time of the first message [ns]; None: from the beginning.

        Raises
        ------
        DataError
            If a file is damaged.
        """
        for path in self._files:
            decode = self._decoders[path.suffix == ROS1].decode
            with _opened(path) as reader:
                chosen = [c for c in reader.connections if c.topic in topics]
                if not chosen or (start_ns is not None and reader.end_time <= start_ns):
                    continue
                for connection, log_ns, raw in reader.messages(chosen, start=start_ns):
                    yield decode(connection.topic, connection.msgtype, log_ns, raw)

    def _survey(self) -> None:
        """Find the files, their order and their topics."""
        spans: list[tuple[int, int, Path]] = []
        topics: dict[str, Topic] = {}
        for path in _files(self.path):
            with _opened(path) as reader:
                if reader.message_count == 0:
                    continue
                spans.append((reader.start_time, reader.end_time, path))
                for c in reader.connections:
                    count = topics[c.topic].count if c.topic in topics else 0
                    topics[c.topic] = Topic(c.msgtype, count + c.msgcount)
        if not spans:
            raise DataError(
                "the bag has no messages", where=str(self.path), next_step="give another one"
            )
        spans.sort()
        for (_, end, before), (start, _, after) in pairwise(spans):
            if start < end:
                raise DataError(
                    f"{before.name} and {after.name} overlap in time",
                    where=str(self.path),
                    measured=f"by {(end - start) / 1e9:.3f} s",
                    next_step="give one of the files, or a folder of files that follow one another",
                )
        self._files = [path for _, _, path in spans]
        self.topics = dict(sorted(topics.items()))


def _files(path: Path) -> list[Path]:
    """Return what rosbags is to open: a file, a ROS 2 folder, or all files of a plain folder."""
    if not path.exists():
        raise UsageError(
            "there is no such file or folder",
            where=f"--source bag:{path}",
            next_step="check the path; it is relative to the current folder",
        )
    if path.is_file() and path.suffix not in SUFFIXES:
        raise UsageError(
            "this is not a bag",
            where=f"--source bag:{path}",
            measured=f"its name ends in {path.suffix!r}",
            limit=", ".join(SUFFIXES),
            next_step="give a .bag, a .mcap or the folder of a ROS 2 bag",
        )
    if path.is_file() or (path / "metadata.yaml").exists():
        return [path]
    for suffix in SUFFIXES:
        found = sorted(path.glob(f"*{suffix}"))
        if found:
            return found
    raise UsageError(
        "no bag is in this folder",
        where=f"--source bag:{path}",
        next_step=f"give a file that ends in {' or '.join(SUFFIXES)}, or the folder that has them",
    )


@contextmanager
def _opened(path: Path) -> Generator[_Reader, None, None]:
    """Open one file; whatever is wrong with it becomes an error with a next step."""
    from rosbags.rosbag1 import Reader as Reader1
    from rosbags.rosbag2 import Reader as Reader2

    try:
        if path.suffix == ROS1:
            opening: Any = Reader1(path)
        else:
            opening = TornMcap(path) if _is_torn(path) else Reader2(path)
        with opening as reader:
            yield reader
    except Exception as error:
        mend = _MENDED_BY.get(path.suffix, _MENDED_BY[".db3"])
        raise DataError(
            f"the bag cannot be read: {error or type(error).__name__}",
            where=str(path),
            next_step=f"if its recording was interrupted, mend it: {mend}",
        ) from error


def _decoders() -> dict[bool, Decoder]:
    """Return what decodes the messages of ROS 2 and of ROS 1 files.

    With the definitions of ROS, not with those in the file: the types read here never changed, and
    a definition of some other type that nobody understands does no harm.
    """
    from rosbags.typesys import Stores, get_typestore

    ros1, ros2 = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_HUMBLE)
    return {
        False: Decoder(ros2.deserialize_cdr, is_ros1=False),
        True: Decoder(ros1.deserialize_ros1, is_ros1=True),
    }


def _is_torn(path: Path) -> bool:
    return path.suffix == ".mcap" and path.is_file() and is_torn(path)


def _writer(path: Path) -> str:
    """Return the library that wrote an MCAP file."""
    with path.open("rb") as file:
        return make_reader(file).get_header().library
