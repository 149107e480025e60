# SPDX-License-Identifier: Apache-2.0
"""The same frames give the same samples, in whatever pieces they come."""

from __future__ import annotations

import itertools
from dataclasses import fields

import numpy as np
import pytest

from comcal.measure.pose_row import join
from comcal.measure.source import Block
from comcal.robot.description import load_robot
from comcal_drivers.devices.configuration import read_configuration
from comcal_drivers.frames.batches import concatenate, take
from comcal_drivers.frames.logs import read_log
from comcal_drivers.source.logs import devices_told
from comcal_drivers.source.stream import SampleStream

pytestmark = pytest.mark.slow


def columns(block: Block) -> list[np.ndarray]:
    found: list[np.ndarray] = []
    for field in fields(block):
        value = getattr(block, field.name)
        found += list(value.values()) if isinstance(value, dict) else [value]
    return [value for value in found if value is not None]


def test_blocks_do_not_depend_on_how_the_stream_is_cut(robot, recorded_over) -> None:
    folder = recorded_over("virtual") / "can"
    described = load_robot(robot.yaml)
    config = read_configuration(described.sources["can"], described)
    frames = concatenate(list(read_log(folder / "pose_003.log")))
    rng = np.random.default_rng(8)

    def blocks(pieces: int) -> Block:
        stream = SampleStream(config, described, devices_told(folder))
        edges = [0, *sorted(rng.integers(0, len(frames), pieces)), len(frames)]
        found = [
            stream.feed({"can0": take(frames, np.arange(a, b))})
            for a, b in itertools.pairwise(edges)
        ]
        return join([*found, stream.finish()])

    whole = blocks(0)
    assert whole.t.size > 100
    for pieces in (1, 7, 400):
        for a, b in zip(columns(blocks(pieces)), columns(whole), strict=True):
            np.testing.assert_array_equal(a, b)
