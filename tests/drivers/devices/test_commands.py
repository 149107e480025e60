# SPDX-License-Identifier: Apache-2.0
"""Frames that start and question devices, and what their answers say."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from comcal.errors import ConfigError
from comcal_drivers.devices.commands import CommandFrame, Listener, command_frames
from comcal_drivers.devices.description import load_device
from comcal_drivers.frames.batch import FrameBatch


def batch_of(*frames: tuple[int, bytes]) -> FrameBatch:
    data = np.zeros((len(frames), 8), np.uint8)
    for row, (_, payload) in enumerate(frames):
        data[row, : len(payload)] = list(payload)
    return FrameBatch(
        np.full(len(frames), np.nan),
        np.array([number for number, _ in frames], np.uint32),
        np.array([len(payload) for _, payload in frames], np.uint8),
        data,
        np.zeros(len(frames), np.uint8),
    )


def sent(frames: tuple[CommandFrame, ...]) -> list[tuple[int, str]]:
    return [(frame.id, frame.data.hex()) for frame in frames]


def test_jr3_start_is_that_of_its_readme() -> None:
    """``cansend can0 201#C80010270000``: 2 Hz, 10 ms, board 1."""
    frames = command_frames(load_device("jr3_uc3m"), "start", {"cutoff_hz": 2.0, "period_s": 0.01})
    assert sent(frames) == [(0x201, "c80010270000")]


def test_netcanoem_matrix_is_asked_row_by_row() -> None:
    frames = command_frames(load_device("ati_netcanoem", {"base": 0x7F}), "matrix")
    assert sent(frames) == [(0x7F2, f"{row:02x}") for row in range(6)]


def test_strain_is_commanded_at_another_place_than_it_answers() -> None:
    device = load_device("iit_strain", {"board": 13})
    assert sent(command_frames(device, "full_scale")) == [
        (0x20D, f"18{channel:02x}") for channel in range(6)
    ]
    assert sent(command_frames(device, "stop")) == [(0x20D, "0701")]


def test_optoforce_configuration_fills_two_frames_and_has_a_sum() -> None:
    """As the public driver sends it: header, speed, filter, zero, sum of the seven bytes before."""
    settings = {"speed": 10, "filter": 4, "zero": 0}
    frames = command_frames(load_device("optoforce"), "configure", settings)
    total = 170 + 50 + 3 + 10 + 4
    assert sent(frames) == [
        (0x101, f"aa0032030a0400{total >> 8:02x}"),
        (0x101, f"{total & 255:02x}" + "00" * 7),
    ]
    assert [frame.is_last for frame in frames] == [False, True]


def test_a_value_that_does_not_fit_is_refused_by_its_name() -> None:
    with pytest.raises(ConfigError, match=r"cutoff_hz does not fit .* \(100000\)") as caught:
        command_frames(load_device("jr3_uc3m"), "start", {"cutoff_hz": 1000.0})
    assert "settings: {cutoff_hz" in caught.value.next_step
    with pytest.raises(ConfigError, match="did you mean 'start'"):
        command_frames(load_device("jr3_uc3m"), "strt")


def test_full_scales_of_the_strain_are_collected_whatever_comes_between() -> None:
    device = load_device("iit_strain", {"board": 2})
    listener = Listener(device)
    for channel in range(6):
        listener.see(batch_of((0x202, bytes([0x18, channel])), (0x32A, bytes(6))))
        assert listener.is_waiting
        wrong = (0x220, bytes([0x18, (channel + 1) % 6, 9, 9]))
        listener.see(batch_of(wrong, (0x220, struct.pack(">BBH", 0x18, channel, 1500 + channel))))
        assert not listener.is_waiting
    assert listener.values == {"full_scale": tuple(1500.0 + c for c in range(6))}


def test_an_unanswered_question_tells_nothing() -> None:
    device = load_device("jr3_uc3m")
    listener = Listener(device)
    ack = struct.pack("<BHHH", 0, 100, 200, 400)
    listener.see(batch_of((0x481, b""), (0x501, b""), (0x101, ack)))
    assert listener.values == {}
    listener.see(batch_of((0x481, b""), (0x101, ack), (0x501, b""), (0x101, b"\0" + bytes(6))))
    assert listener.values == {"full_scale": (100.0, 200.0, 400.0, 0.0, 0.0, 0.0)}


def test_serial_number_is_text_and_units_are_looked_up() -> None:
    device = load_device("ati_netcanoem")
    listener = Listener(device)
    listener.see(batch_of((0x205, b""), (0x205, b"FT12345\0"), (0x208, b""), (0x208, b"\1\2")))
    assert listener.values["serial"] == "FT12345"
    assert listener.values["force_unit"] == (4.4482216152605,)
    assert listener.values["torque_unit"] == pytest.approx((1.3558179483314,))
