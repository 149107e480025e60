# SPDX-License-Identifier: Apache-2.0
"""Raw samples as MCAP, read back by two libraries that share no code with the encoder."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.records import Message
from mcap.stream_reader import StreamReader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from comcal.measure import cdr
from comcal.measure.raw import RawWriter, raw_path, topic_words
from comcal.measure.source import Block
from comcal.robot.model import Robot


def block_of(robot: Robot, n: int = 30, start: float = 0.0) -> Block:
    rng = np.random.default_rng(5)
    joints = len(robot.tree.joint_names)
    torques = rng.standard_normal((n, joints))
    torques[:, 0] = np.nan
    return Block(
        t=start + np.arange(1, n + 1) / 125.0,
        q=rng.standard_normal((n, joints)),
        wrenches={name: 100 * rng.standard_normal((n, 6)) for name in robot.sensors},
        torques=torques,
        currents=rng.standard_normal((n, joints)),
        imu=rng.standard_normal((n, 3)),
        temperatures={"l_foot": rng.standard_normal(n)},
    )


def write(path: Path, robot: Robot, *blocks: Block) -> Path:
    with RawWriter(path, robot) as raw:
        for block in blocks:
            raw.write(block)
    return path


def write_and_interrupt(path: Path, robot: Robot) -> None:
    with RawWriter(path, robot) as raw:
        raw.write(block_of(robot))
        raise KeyboardInterrupt


def count_messages(path: Path) -> int:
    """Return how many messages a file holds before it breaks off."""
    count = 0
    with path.open("rb") as file, suppress(Exception):
        for record in StreamReader(file).records:
            count += isinstance(record, Message)
    return count


def decoded(path: Path) -> dict[str, list[tuple[int, Any]]]:
    found: dict[str, list[tuple[int, Any]]] = {}
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, channel, message, ros in reader.iter_decoded_messages():
            found.setdefault(channel.topic, []).append((message.log_time, ros))
    return found


def test_every_sample_comes_back_bit_by_bit(robot: Robot, tmp_path: Path) -> None:
    first, second = block_of(robot), block_of(robot, start=1.0)
    topics = decoded(write(tmp_path / "raw" / "pose_001.mcap", robot, first, second))
    n = first.t.size
    for name in robot.sensors:
        messages = topics[f"/ft/{name}"]
        assert len(messages) == 2 * n
        for k, (_, ros) in enumerate(messages[:n]):
            w = ros.wrench
            vector = [w.force.x, w.force.y, w.force.z, w.torque.x, w.torque.y, w.torque.z]
            assert vector == first.wrenches[name][k].tolist()
        joint = robot.tree.joints[robot.tree.joint_index[robot.sensors[name].joint]]
        assert messages[0][1].header.frame_id == joint.child
    stamp, joints = topics["/joint_states"][n + 2]
    assert joints.name == list(robot.tree.joint_names)
    assert list(joints.position) == second.q[2].tolist()
    assert list(joints.velocity) == []
    np.testing.assert_array_equal(joints.effort, second.torques[2])
    assert stamp == round(second.t[2] * 1e9)
    assert joints.header.stamp.sec * 10**9 + joints.header.stamp.nanosec == stamp
    _, amperes = topics["/motor_currents"][0]
    assert list(amperes.position) == []
    assert list(amperes.effort) == first.currents[0].tolist()
    _, imu = topics["/imu"][0]
    a = imu.linear_acceleration
    assert [a.x, a.y, a.z] == first.imu[0].tolist()
    assert imu.orientation_covariance[0] == imu.angular_velocity_covariance[0] == -1.0
    assert topics["/temperature/l_foot"][4][1].temperature == first.temperatures["l_foot"][4]


def test_a_second_library_reads_the_same_and_knows_the_types(robot: Robot, tmp_path: Path) -> None:
    block = block_of(robot)
    path = write(tmp_path / "raw" / "pose_001.mcap", robot, block)
    store = get_typestore(Stores.ROS2_HUMBLE)
    wrenches = []
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            assert schema is not None
            assert channel.message_encoding == "cdr"
            ros = store.deserialize_cdr(message.data, schema.name)
            assert store.serialize_cdr(ros, schema.name) == message.data
            if channel.topic == "/ft/l_foot":
                f = ros.wrench.force
                wrenches.append([f.x, f.y, f.z])
    assert wrenches == block.wrenches["l_foot"][:, :3].tolist()


@pytest.mark.parametrize("kind", cdr.DEFINITIONS)
def test_message_definitions_are_those_of_ros(kind: str) -> None:
    """Same definitions, same hash: rosbag2 refuses to mix types of one name."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    types = get_types_from_msg(cdr.DEFINITIONS[kind], kind)
    for name, (_, fields) in types.items():
        official = store.fielddefs[name][1]
        assert [(field, kind) for field, kind in fields] == list(official)


def test_what_was_read_before_a_kill_can_be_read_after_it(robot: Robot, tmp_path: Path) -> None:
    path = tmp_path / "raw" / "pose_001.mcap"
    with RawWriter(path, robot) as raw:
        raw.write(block_of(robot))
        after_one = path.stat().st_size
        raw.write(block_of(robot, start=1.0))
        killed = path.read_bytes()  # all that a kill at this moment leaves
    for size, blocks in ((len(killed), 2), (after_one + 100, 1), (after_one, 1)):
        path.write_bytes(killed[:size])
        assert count_messages(path) == blocks * 30 * (len(robot.sensors) + 4)


def test_samples_of_an_interrupted_attempt_are_moved_aside(robot: Robot, tmp_path: Path) -> None:
    path = raw_path(tmp_path, 3)
    with pytest.raises(KeyboardInterrupt):
        write_and_interrupt(path, robot)
    left = path.read_bytes()
    write(path, robot, block_of(robot))
    assert path.with_name("pose_003.mcap.partial-1").read_bytes() == left
    assert len(decoded(path)["/imu"]) == 30


def test_the_file_is_what_the_ros2_profile_of_mcap_demands(robot: Robot, tmp_path: Path) -> None:
    path = write(tmp_path / "raw" / "pose_001.mcap", robot, block_of(robot), block_of(robot, 9, 1))
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
        count = sum(1 for _ in reader.iter_messages())
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == count == 39 * (len(robot.sensors) + 4)
    assert len(summary.chunk_indexes) == 2
    for chunk in summary.chunk_indexes:
        assert set(chunk.message_index_offsets) == set(summary.channels)
    for channel in summary.channels.values():
        assert channel.message_encoding == "cdr"
        assert channel.metadata["offered_qos_profiles"] == ""  # required; what it holds is not
        schema = summary.schemas[channel.schema_id]
        assert schema.encoding == "ros2msg"
        assert schema.name.split("/")[1] == "msg"


def test_every_type_is_defined_down_to_numbers() -> None:
    """A viewer without ROS knows nothing but what is in the file."""
    numbers = {"float64", "int32", "uint32", "string"}
    for name, definition in cdr.DEFINITIONS.items():
        parts = definition.split("=" * 80 + "\n")
        known = {name} | {part.split("\n")[0].removeprefix("MSG: ") for part in parts[1:]}
        used = {
            line.split(" ")[0].partition("[")[0]
            for part in parts
            for line in part.splitlines()
            if line and not line.startswith("MSG: ")
        }
        assert used <= known | numbers
        assert len(known) == len(parts)


def test_rosbags_opens_the_lone_file_as_a_recording(robot: Robot, tmp_path: Path) -> None:
    path = write(tmp_path / "raw" / "pose_001.mcap", robot, block_of(robot))
    with AnyReader([path]) as reader:
        for connection, _, raw in reader.messages():
            reader.deserialize(raw, connection.msgtype)
        assert {topic.msgcount for topic in reader.topics.values()} == {30}
        assert reader.duration == round(29 / 125 * 1e9) + 1


def test_sensors_whose_names_ros_does_not_allow_keep_topics_of_their_own(
    robot: Robot, tmp_path: Path
) -> None:
    names = ["l-foot", "l_foot", "l--foot", "7", "räder"]
    assert topic_words(names) == {
        "l-foot": "l_foot_2",
        "l_foot": "l_foot",
        "l--foot": "l_foot_3",
        "7": "_7",
        "räder": "r_der",
    }
    odd = replace(robot, sensors={name: robot.sensors["l_foot"] for name in names[:2]})
    wrenches = {name: np.full((5, 6), float(k)) for k, name in enumerate(names[:2])}
    block = Block(np.arange(1.0, 6.0), np.zeros((5, len(robot.tree.joint_names))), wrenches)
    topics = decoded(write(tmp_path / "raw" / "pose_001.mcap", odd, block))
    for name, value in (("l_foot_2", 0.0), ("l_foot", 1.0)):
        assert {ros.wrench.force.x for _, ros in topics[f"/ft/{name}"]} == {value}
