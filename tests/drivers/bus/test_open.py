# SPDX-License-Identifier: Apache-2.0
"""Every way in which a bus cannot be opened says what to do next."""

from __future__ import annotations

import errno
import grp
import os
import socket

import can
import pytest
import serial

from comcal.errors import ConfigError, HardwareError, MissingExtraError
from comcal_drivers.bus import open as opening
from comcal_drivers.bus.open import open_bus
from comcal_drivers.devices.configuration import BusConfig

HAS_CAN = hasattr(socket, "AF_CAN")


def test_any_interface_of_python_can_is_opened():
    bus = open_bus(BusConfig("can0", "virtual", "test_open", 500_000, {"rx_queue_size": 7}))
    try:
        assert bus.queue.maxsize == 7
    finally:
        bus.shutdown()


@pytest.mark.parametrize(
    ("interface", "options", "words"),
    [
        ("socketcam", {}, "no interface is called socketcam; did you mean socketcan"),
        ("slcan", {"tty_baud_rate": 1}, "no option tty_baud_rate; did you mean tty_baudrate"),
        ("socketcand", {"prot": 1}, "did you mean port"),
        ("slcan", {"tty_baudrate": "fast"}, "cannot be opened like this"),
    ],
)
def test_what_robot_yaml_says_wrong_is_a_configuration_error(interface, options, words):
    with pytest.raises(ConfigError, match=words) as caught:
        open_bus(BusConfig("left", interface, "x", None, options))
    assert caught.value.where == "bus left"


def test_a_bit_rate_that_slcan_has_not_names_those_that_it_has():
    with pytest.raises(ConfigError, match=r"bit rate of 123.*500000"):
        open_bus(BusConfig("can0", "slcan", "/dev/null", 123))


def test_a_missing_serial_device_names_those_that_are_there(tmp_path):
    with pytest.raises(HardwareError, match=r"USB serial devices here are.*plug the adapter in"):
        open_bus(BusConfig("can0", "slcan", str(tmp_path / "ttyACM7"), 500_000))


def test_something_that_is_no_serial_device_is_a_hardware_error(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(HardwareError) as caught:
        open_bus(BusConfig("can0", "slcan", str(tmp_path / "file"), 500_000))
    assert caught.value.next_step


def test_a_forbidden_serial_device_names_the_group_to_join(tmp_path, monkeypatch):
    device = tmp_path / "ttyACM0"
    device.touch()

    def refuse(*_: object, **__: object) -> None:
        raise serial.SerialException(errno.EACCES, "Permission denied")

    monkeypatch.setattr(serial, "Serial", refuse)
    group = grp.getgrgid(os.stat(device).st_gid).gr_name
    with pytest.raises(HardwareError, match=f"usermod -aG {group} "):
        open_bus(BusConfig("can0", "slcan", str(device), 500_000))


@pytest.mark.parametrize(
    ("number", "words"),
    [
        (
            errno.ENETDOWN,
            "interface is down; type: sudo ip link set can3 up type can bitrate 250000",
        ),
        (errno.ENODEV, "the CAN interfaces here are: .*ip link set can3 up"),
        (errno.EAFNOSUPPORT, "kernel has no SocketCAN.*modprobe"),
        (errno.EIO, "ip -details link show can3"),
    ],
)
def test_what_is_wrong_with_a_socketcan_interface_is_said_as_a_command(monkeypatch, number, words):
    def fail(*_: object, **__: object) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr("comcal_drivers.bus.socketcan.require", fail)
    with pytest.raises(HardwareError, match=words):
        open_bus(BusConfig("can0", "socketcan", "can3", 250_000))


@pytest.mark.skipif(not HAS_CAN, reason="Python was built without AF_CAN")
def test_socketcan_without_an_interface_is_a_hardware_error_here():
    """Whether the kernel knows AF_CAN (no such device) or not."""
    with pytest.raises(HardwareError) as caught:
        open_bus(BusConfig("can0", "socketcan", "nocan7"))
    assert caught.value.next_step


def test_a_package_that_is_missing_names_the_extra(monkeypatch):
    def fail(**_: object) -> None:
        raise ImportError("No module named 'usb'")

    monkeypatch.setattr(can, "Bus", fail)
    with pytest.raises(MissingExtraError, match=r"usb.*comcal\[can\]"):
        open_bus(BusConfig("can0", "gs_usb", "0"))


def test_the_error_behind_an_error_is_found():
    inner = OSError(errno.ENODEV, "No such device")
    outer = can.CanInitializationError("no")
    outer.__cause__ = inner
    assert opening._number(outer) == errno.ENODEV
