# SPDX-License-Identifier: Apache-2.0
"""A simulated recording, and bags of every kind with its samples."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from comcal.measure.plan import PlannedPose
from comcal.measure.plan_csv import read_plan
from comcal.measure.recorder import record
from comcal.measure.session import create_session
from comcal.measure.source import Block, SourceRequest
from comcal.robot.description import load_robot
from comcal.robot.model import Robot
from comcal_drivers.bags.source import open_bag
from comcal_sims.robots.biped14 import generate
from comcal_sims.sources import open_builtin

KINDS = ("ros1", "sqlite3", "mcap")
SECOND = 1_000_000_000


@dataclass(frozen=True)
class Recording:
    """What the simulated robot measured, and the session that was made of it directly."""

    robot: Robot
    plan: tuple[PlannedPose, ...]
    session: Path
    blocks: tuple[Block, ...]


@pytest.fixture(scope="session")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    """Three poses of the biped with 14 joints in the built-in world."""
    folder = tmp_path_factory.mktemp("bags")
    robot = load_robot(generate(folder / "robot"))
    plan = read_plan(folder / "robot" / "plan.csv", robot.tree.joint_names)[:3]
    session = create_session(folder / "direct", robot, source="builtin", seed=3, details={})
    blocks: list[Block] = []
    with open_builtin(SourceRequest(robot, 3, plan=plan)) as source:
        measured = source.read

        def read(duration: float) -> Block:
            blocks.append(measured(duration))
            return blocks[-1]

        source.read = read  # type: ignore[method-assign]
        record(robot, source, source, plan, session)
    return Recording(robot, plan, session.directory, tuple(blocks))


class BagWriter:
    """Writes messages of the four types into a bag of one kind.

    Parameters
    ----------
    path : Path
        Without suffix; ``file`` is what is to be read.
    kind : str
        ``ros1``, ``sqlite3`` or ``mcap``.
    """

    def __init__(self, path: Path, kind: str) -> None:
        self.is_ros1 = kind == "ros1"
        self.store = get_typestore(Stores.ROS1_NOETIC if self.is_ros1 else Stores.ROS2_HUMBLE)
        self.file = path.with_suffix(".bag") if self.is_ros1 else path
        if self.is_ros1:
            self._writer: Any = Writer1(self.file)
        else:
            plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
            self._writer = Writer2(self.file, version=9, storage_plugin=plugin)
        self._connections: dict[str, Any] = {}
        self.frame = "nowhere"

    def __enter__(self) -> BagWriter:
        self._writer.open()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._writer.close()

    def wrench(self, topic: str, stamp: int, values: Sequence[float], **when: int) -> None:
        Wrench, Stamped = self._types("geometry_msgs/msg/Wrench", "geometry_msgs/msg/WrenchStamped")
        content = Wrench(self._vector(values[:3]), self._vector(values[3:]))
        self._write(topic, Stamped(self._header(stamp, self.frame), content), stamp, **when)

    def joints(
        self,
        topic: str,
        stamp: int,
        names: Sequence[str],
        position: Sequence[float] = (),
        effort: Sequence[float] = (),
        **when: int,
    ) -> None:
        (JointState,) = self._types("sensor_msgs/msg/JointState")
        numbers = (np.array(x, dtype=np.float64) for x in (position, (), effort))
        self._write(topic, JointState(self._header(stamp), list(names), *numbers), stamp, **when)

    def imu(self, topic: str, stamp: int, values: Sequence[float], **when: int) -> None:
        Imu, Quaternion = self._types("sensor_msgs/msg/Imu", "geometry_msgs/msg/Quaternion")
        turn, zero = self._vector((0.0, 0.0, 0.0)), np.zeros(9)
        content = (Quaternion(0.0, 0.0, 0.0, 1.0), zero, turn, zero, self._vector(values), zero)
        self._write(topic, Imu(self._header(stamp, "torso"), *content), stamp, **when)

    def temperature(self, topic: str, stamp: int, degrees: float, **when: int) -> None:
        (Temperature,) = self._types("sensor_msgs/msg/Temperature")
        self._write(topic, Temperature(self._header(stamp), degrees, 0.0), stamp, **when)

    def text(self, topic: str, stamp: int, words: str) -> None:
        (String,) = self._types("std_msgs/msg/String")
        self._write(topic, String(words), stamp)

    def _types(self, *names: str) -> list[Any]:
        return [self.store.types[name] for name in names]

    def _vector(self, values: Sequence[float]) -> Any:
        return self.store.types["geometry_msgs/msg/Vector3"](*map(float, values))

    def _header(self, stamp: int, frame: str = "") -> Any:
        Header, Time = self._types("std_msgs/msg/Header", "builtin_interfaces/msg/Time")
        time = Time(*divmod(stamp, SECOND))
        return Header(0, time, frame) if self.is_ros1 else Header(time, frame)

    def _write(self, topic: str, content: Any, stamp: int, logged: int | None = None) -> None:
        kind = content.__msgtype__
        if topic not in self._connections:
            add = self._writer.add_connection
            self._connections[topic] = add(topic, kind, typestore=self.store)
        serialize = self.store.serialize_ros1 if self.is_ros1 else self.store.serialize_cdr
        when = stamp if logged is None else logged
        self._writer.write(self._connections[topic], when, serialize(content, kind))


@pytest.fixture
def new_bag(tmp_path: Path) -> Callable[..., BagWriter]:
    """Begin a bag of some kind in a folder of its own."""
    return lambda kind="mcap", name="walk": BagWriter(tmp_path / name, kind)


@pytest.fixture
def write_recording(recording: Recording, new_bag: Callable[..., BagWriter]) -> Callable[..., Path]:
    """Write the samples of the recording into a bag of some kind."""

    def write(kind: str, epoch: int = 0, delay: int = 0) -> Path:
        names = recording.robot.tree.joint_names
        with new_bag(kind) as bag:
            for block in recording.blocks:
                for k, t in enumerate(block.t.tolist()):
                    stamp = epoch + round(t * SECOND)
                    when = {"logged": stamp + delay}
                    for sensor, w in block.wrenches.items():
                        bag.wrench(f"/robot/{sensor}/ft", stamp, w[k], **when)
                    torques = () if block.torques is None else block.torques[k]
                    bag.joints("/joint_states", stamp, names, block.q[k], torques, **when)
                    if block.currents is not None:
                        bag.joints("/amperes", stamp, names, effort=block.currents[k], **when)
                    if block.imu is not None:
                        bag.imu("/torso/imu/data", stamp, block.imu[k], **when)
                    for sensor, degrees in (block.temperatures or {}).items():
                        bag.temperature(f"/{sensor}/temperature", stamp, degrees[k], **when)
        return bag.file

    return write


@pytest.fixture(params=KINDS)
def kind(request: pytest.FixtureRequest) -> str:
    """ROS 1, and ROS 2 with both storages."""
    return request.param


@pytest.fixture
def replayed(recording: Recording, tmp_path: Path) -> Callable[..., Path]:
    """Record a bag into a session; return its folder."""

    def run(path: Path, plan: Sequence[PlannedPose] = (), **options: object) -> Path:
        plan = tuple(plan) or recording.plan
        session = create_session(
            tmp_path / "replayed", recording.robot, source="bag", seed=None, details={}
        )
        request = SourceRequest(
            recording.robot, 0, argument=str(path), options=options, plan=tuple(plan)
        )
        with closing(open_bag(request)) as source:
            record(recording.robot, source, source, plan, session)
        return session.directory

    return run
