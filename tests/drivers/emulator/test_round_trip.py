# SPDX-License-Identifier: Apache-2.0
"""What an emulated device measures, the reader's own pipeline reads, up to quantisation.

The devices were written from their manuals, the pipeline from the descriptions: they check each
other.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import can
import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from comcal.measure.source import Block
from comcal_drivers.calibrate.calibrated import Calibrated
from comcal_drivers.calibrate.drive import drive_calibration
from comcal_drivers.calibrate.wrench import wrench_calibration
from comcal_drivers.decode.table import decode
from comcal_drivers.devices.commands import DeviceValues, Listener, command_frames
from comcal_drivers.devices.configuration import DeviceConfig, JointConfig, SensorConfig
from comcal_drivers.devices.tables import bus_table
from comcal_drivers.emulator.device import EmulatedDevice
from comcal_drivers.emulator.frame import EXTENDED, Frame
from comcal_drivers.emulator.registry import emulate
from comcal_drivers.frames.messages import pack
from comcal_drivers.join.joiner import Joiner

COUNTS = {"counts_per_force": 1000.0, "counts_per_torque": 20000.0}
SENSORS: dict[str, tuple[dict[str, Any], tuple[float, float]]] = {
    "ati_netcanoem": ({}, (0.2, 0.01)),
    "ati_netbox_long": (COUNTS, (0.001, 1e-4)),
    "ati_netbox_short": ({**COUNTS, "scale": np.array([60.0] * 3 + [30.0] * 3)}, (0.06, 0.003)),
    "iit_strain": ({}, (0.07, 0.002)),
    "jr3_uc3m": ({}, (0.08, 0.004)),
    "sunrise_m8123": ({}, (1e-4, 1e-5)),
    "robotous_rft": ({}, (0.02, 6e-4)),
    "optoforce": ({"scale": np.array([0.1] * 3)}, (0.1, 0.0)),
}
"""Configuration, and twice the resolution of force [N] and moment [N m]."""
DRIVES: dict[str, tuple[dict[str, Any], tuple[float, float]]] = {
    "maxon_epos": ({}, (2e-5, 0.001)),
    "cia402": ({}, (2e-5, 0.01)),
    "cia402_torque": ({}, (2e-5, 0.0)),
    "odrive_cansimple": ({}, (1e-6, 1e-6)),
    "vesc_status": ({}, (4e-4, 0.1)),
    "mit_ak": ({"ids": {"host": 0, "motor": 3}}, (4e-4, 0.007)),
}
"""Configuration, and twice the resolution of position [rad] and current [A]."""


def batch(frames: Sequence[Frame]) -> Any:
    return pack(
        can.Message(
            timestamp=frame.t,
            arbitration_id=frame.bare_id,
            is_extended_id=frame.id >= EXTENDED,
            data=frame.data,
        )
        for frame in frames
    )


def told(device: EmulatedDevice, config: DeviceConfig) -> DeviceValues:
    """Start a device as the reader would, and return what it answered."""
    listener = Listener(config.device)
    for name in config.device.description.start:
        for frame in command_frames(config.device, name, config.settings):
            sent = Frame(frame.id, frame.data)
            answers = device.hear(sent)
            listener.see(batch([sent, *answers]))
        assert not listener.is_waiting, f"{name} was not answered"
    return listener.values


def read(device: EmulatedDevice, config: DeviceConfig, block: Block) -> tuple[Calibrated, Any]:
    values = dict(told(device, config))
    if isinstance(config, SensorConfig):
        calibration: Any = wrench_calibration(config, values)
    else:
        assert isinstance(config, JointConfig)
        values |= {"rated_current": 10.0, "rated_torque": 1.0}  # read through SDO by others
        calibration = drive_calibration(config, values)
    stream = device.stream(block, 100, 0)
    frames = list[Frame]()
    for sample, beside in zip(stream.samples, stream.beside, strict=True):
        poll = [] if device.poll is None else [device.poll._replace(t=sample[0].t)]
        frames += [*poll, *beside, *sample]
    joiner = Joiner(config.device, bus_table(config.device))
    everything = batch(frames)
    samples = joiner.feed(decode(bus_table(config.device), everything), everything, 0)
    return calibration.apply(samples), joiner.counts


def block_of(**columns: Any) -> Block:
    first = next(iter(columns.values()))
    n = len(next(iter(first.values())) if isinstance(first, dict) else first)
    t = 60.0 + np.arange(n) / 120.0
    return Block(t=t, **{"q": np.zeros((n, 14)), "wrenches": {}, **columns})


SAMPLES = 40
SEEDS = st.integers(0, 2**32 - 1)
WIDEST = np.array([500.0] * 3 + [15.0] * 3)


@pytest.mark.parametrize("name", SENSORS)
@settings(max_examples=3, phases=[Phase.generate])
@given(seed=SEEDS)
def test_wrenches_survive_the_bus(name: str, seed: int, biped: Any) -> None:
    settings_, (force, moment) = SENSORS[name]
    turned = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    signs = np.array([1.0, 1.0, -1.0, -1.0, 1.0, 1.0])
    config = biped.sensor(name, R_sensor_device=turned, signs=signs, **settings_)
    device = emulate(config, biped.robot, started=False)
    wanted = np.random.default_rng(seed).uniform(-WIDEST, WIDEST, (SAMPLES, 6))
    got, counts = read(device, config, block_of(wrenches={"l_foot": wanted}))
    assert len(got) >= len(wanted) - 1  # a sample without a counter is proven by the next one
    error = np.abs(got.values - wanted[: len(got)])
    unmeasured = np.isnan(got.values).all(axis=0)
    assert error[:, :3].max() <= force
    if name == "optoforce":
        assert unmeasured[3:].all()
    else:
        assert error[:, 3:].max() <= moment
    assert not got.flags.any()
    assert counts.lost == counts.orphaned == counts.short == counts.resyncs == 0


@pytest.mark.parametrize("name", DRIVES)
@settings(max_examples=3, phases=[Phase.generate])
@given(seed=SEEDS, sign=st.sampled_from([1, -1]))
def test_positions_and_currents_survive_the_bus(
    name: str, seed: int, sign: int, biped: Any
) -> None:
    rng = np.random.default_rng(seed)
    q, i = rng.uniform(-1.2, 1.2, SAMPLES), rng.uniform(-9.0, 9.0, SAMPLES)
    settings_, (position, current) = DRIVES[name]
    config = biped.drive(name, sign=sign, zero=0.1, **settings_)
    device = emulate(config, biped.robot, started=True)
    k = biped.robot.tree.joint_names.index("l_knee")
    joints, currents = np.zeros((SAMPLES, 14)), np.full((SAMPLES, 14), np.nan)
    joints[:, k], currents[:, k] = q, i
    got, counts = read(device, config, block_of(q=joints, currents=currents))
    assert len(got) >= SAMPLES - 1
    turn = 2.0 * np.pi
    error = got.values[:, 0] - q[: len(got)]
    assert np.abs(error - turn * np.rint(error / turn)).max() <= position
    if name == "cia402_torque":
        motor = biped.robot.motors["l_knee"]
        torque = motor.torque_constant * motor.gear * motor.sign * i[: len(got)]
        assert np.abs(got.values[:, 2] - torque).max() <= 50.0 * 1e-3
    else:
        assert np.abs(got.values[:, 1] - i[: len(got)]).max() <= current
    assert counts.lost == counts.orphaned == counts.short == 0


@pytest.mark.parametrize("name", ["ati_netcanoem", "iit_strain", "jr3_uc3m", "robotous_rft"])
def test_what_is_beyond_the_range_is_read_as_saturated(name: str, biped: Any) -> None:
    config = biped.sensor(name)
    device = emulate(config, biped.robot, started=False)
    wanted = np.zeros((6, 6))
    wanted[2, 2] = 1e6
    got, _ = read(device, config, block_of(wrenches={"l_foot": wanted}))
    saturated = (got.flags & 2).astype(bool)
    assert saturated.tolist() == [False, False, True, False, False, False][: len(got)]


def test_the_counter_goes_round_without_a_loss(biped: Any) -> None:
    config = biped.sensor("jr3_uc3m")
    device = emulate(config, biped.robot, started=True)
    wrenches = {"l_foot": np.zeros((20, 6))}
    stream = device.stream(block_of(wrenches=wrenches), 65530, 0)
    joiner = Joiner(config.device, bus_table(config.device))
    everything = batch([f for sample in stream.samples for f in sample])
    samples = joiner.feed(decode(bus_table(config.device), everything), everything, 0)
    assert samples.counter.tolist() == [n % 65536 for n in range(65530, 65550)]
    assert joiner.counts.lost == joiner.counts.resyncs == 0
