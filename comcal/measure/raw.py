# SPDX-License-Identifier: Apache-2.0
"""Raw samples of one pose as an MCAP file that ROS 2 tools open.

Topics: ``/ft/<sensor>`` (WrenchStamped, in the sense and frame in which the sensor reports it),
``/joint_states`` (JointState; effort holds joint torques where there are any), ``/motor_currents``
(JointState whose effort holds amperes), ``/imu`` (Imu), ``/temperature/<sensor>``. Time is that of
the session, in nanoseconds.

Every block is a chunk of its own, written and synced at once: what was read survives ``kill -9``
and power loss; such a file merely lacks its index, and ``mcap recover`` gives it one.
"""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType

import numpy as np
from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import Writer

from comcal.measure import cdr
from comcal.measure.files import move_aside, sync_folder
from comcal.measure.source import Block
from comcal.robot.model import Robot
from comcal.robot.tree import Array

NANOSECONDS = 1_000_000_000
QOS = {"offered_qos_profiles": ""}
"""Demanded of every channel by the profile ``ros2`` of MCAP; empty: nobody published this, offer
what is usual."""


def raw_path(directory: Path, pose: int) -> Path:
    """Return where the raw samples of *pose* stand in a session folder."""
    return directory / "raw" / f"pose_{pose:03d}.mcap"


class RawWriter:
    """Writes the raw samples of one pose; a context manager.

    Parameters
    ----------
    path : Path
        Must not hold the samples of a finished pose: a file left by an interrupted attempt is
        moved aside to ``<name>.partial-N``.
    robot : Robot
    """

    def __init__(self, path: Path, robot: Robot) -> None:
        self._robot = robot
        path.parent.mkdir(exist_ok=True)
        move_aside(path)
        self._file = path.open("xb")
        self._writer = Writer(self._file, chunk_size=1 << 40)  # a chunk ends where a block ends
        self._writer.start(profile="ros2", library="comcal")
        self._schemas: dict[str, int] = {}
        self._topics: dict[str, tuple[int, cdr.Layout]] = {}
        self._words = topic_words([*robot.sensors, *robot.plates])
        sync_folder(path.parent)

    def write(self, block: Block) -> None:
        """Append a block and sync it to the disk."""
        stamps = [round(t * NANOSECONDS) for t in block.t.tolist()]
        for topic, kind, layout, numbers in self._streams(block):
            if topic not in self._topics:
                self._topics[topic] = self._register(topic, kind), layout
            channel, known = self._topics[topic]
            for stamp, data in zip(stamps, known.encode(stamps, numbers), strict=True):
                self._writer.add_message(channel, stamp, data, stamp)
        self._writer.flush()
        os.fsync(self._file.fileno())

    def close(self) -> None:
        """Write the index and close the file."""
        if not self._file.closed:
            self._writer.finish()
            self._file.flush()
            os.fsync(self._file.fileno())
            self._file.close()

    def __enter__(self) -> RawWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is None:
            self.close()
        else:
            # Interrupted anywhere, the writer may be in any state; what is in the file is sound.
            self._file.close()

    def _register(self, topic: str, kind: str) -> int:
        if kind not in self._schemas:
            definition = cdr.DEFINITIONS[kind].encode()
            self._schemas[kind] = self._writer.register_schema(
                kind, SchemaEncoding.ROS2, definition
            )
        return self._writer.register_channel(topic, MessageEncoding.CDR, self._schemas[kind], QOS)

    def _streams(self, block: Block) -> list[tuple[str, str, cdr.Layout, Array]]:
        """Return topic, type, layout and numbers (n, k) of everything in *block*."""
        names = self._robot.tree.joint_names
        has_torques = block.torques is not None
        state = block.q if block.torques is None else np.hstack([block.q, block.torques])
        joints = cdr.joint_layout(names, position=True, effort=has_torques)
        streams = [("/joint_states", cdr.JOINTS, joints, state)]
        if block.currents is not None:
            layout = cdr.joint_layout(names, position=False, effort=True)
            streams.append(("/motor_currents", cdr.JOINTS, layout, block.currents))
        for name, wrench in block.wrenches.items():
            layout = cdr.wrench_layout(self._frame(name))
            streams.append((f"/ft/{self._words.get(name, name)}", cdr.WRENCH, layout, wrench))
        if block.imu is not None:
            layout = cdr.imu_layout(self._robot.imu_link or "")
            streams.append(("/imu", cdr.IMU, layout, block.imu))
        for name, degrees in (block.temperatures or {}).items():
            layout = cdr.temperature_layout(self._frame(name))
            topic = f"/temperature/{self._words.get(name, name)}"
            streams.append((topic, cdr.TEMPERATURE, layout, degrees[:, None]))
        return streams

    def _frame(self, name: str) -> str:
        """Return the link whose frame the wrench is in: ROS names frames after links."""
        if name in self._robot.sensors:
            tree = self._robot.tree
            return tree.joints[tree.joint_index[self._robot.sensors[name].joint]].child
        return self._robot.plates[name].frame if name in self._robot.plates else ""


def topic_words(names: Sequence[str]) -> dict[str, str]:
    """Make parts of ROS topics of names.

    Parameters
    ----------
    names : sequence of str
        Of sensors and plates, each once.

    Returns
    -------
    dict from name to str
        Letters, digits and single underscores, no leading digit. No two are equal: a name that
        ROS does not allow gives way to one that it does.
    """
    words = {name: _topic_word(name) for name in names}
    found = {name: name for name, word in words.items() if word == name}
    for name, word in words.items():
        unique, number = word, 2
        while name not in found and unique in found.values():
            unique, number = f"{word}_{number}", number + 1
        found.setdefault(name, unique)
    return found


def _topic_word(name: str) -> str:
    word = re.sub(r"[\W_]+", "_", name, flags=re.ASCII)
    return f"_{word}" if word[:1].isdigit() else word
