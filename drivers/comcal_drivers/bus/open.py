# SPDX-License-Identifier: Apache-2.0
"""Open a bus of robot.yaml; what stands in the way is said with what to do about it."""

from __future__ import annotations

import difflib
import errno
import grp
import inspect
import os
import socket
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import can

from comcal.errors import ComcalError, ConfigError, HardwareError, MissingExtraError
from comcal_drivers.bus.batch_bus import BatchBus
from comcal_drivers.devices.configuration import BusConfig


def open_bus(config: BusConfig) -> can.BusABC:
    """Open a bus.

    SocketCAN, slcan and socketcand are read in bulk by classes of this package; every other
    interface is python-can's own.

    Parameters
    ----------
    config : BusConfig

    Returns
    -------
    can.BusABC

    Raises
    ------
    ConfigError
        No such interface, or an option that it does not take.
    HardwareError
        The device is missing, busy, forbidden or down, or does not answer.
    MissingExtraError
        The interface needs a package that is not installed.
    """
    where = f"bus {config.name}"
    ours = _bulk_class(config.interface)
    options = dict(config.options)
    # SocketCAN's bit rate is set by `ip link`, as the administrator; the others take it here.
    if config.bitrate is not None and config.interface not in ("socketcan", "socketcand"):
        options["bitrate"] = config.bitrate
    try:
        if ours is not None:
            _check_options(where, ours, options)
            return ours(str(config.channel), **options)
        _check_interface(where, config.interface)
        return can.Bus(
            channel=config.channel, interface=config.interface, ignore_config=True, **options
        )
    except ComcalError:
        raise
    except (TypeError, ValueError) as error:
        raise ConfigError(
            f"{config.interface} cannot be opened like this: {error}",
            where=where,
            next_step="correct the options of the bus in robot.yaml",
        ) from error
    except ImportError as error:
        raise MissingExtraError(
            f"the interface {config.interface} needs a package that is not installed: {error}",
            where=where,
            next_step="type: pip install 'comcal[can]'",
        ) from error
    except (can.CanError, OSError) as error:
        raise HardwareError(
            f"{config.interface} {config.channel} cannot be opened: {_words(error)}",
            where=where,
            next_step=_next_step(config, error),
        ) from error


def _bulk_class(interface: str) -> type[BatchBus] | None:
    # Imported when used: a computer without serial ports or SocketCAN can use the others.
    if interface == "socketcan":
        from comcal_drivers.bus.socketcan import BulkSocketcanBus

        return BulkSocketcanBus
    if interface == "slcan":
        from comcal_drivers.bus.slcan import SlcanBus

        return SlcanBus
    if interface == "socketcand":
        from comcal_drivers.bus.socketcand import SocketcandBus

        return SocketcandBus
    return None


def _check_interface(where: str, interface: str) -> None:
    known = sorted(can.VALID_INTERFACES)
    if interface not in known:
        raise ConfigError(
            f"no interface is called {interface}",
            where=where,
            next_step=f"did you mean {_nearest(interface, known)}?",
        )


def _check_options(where: str, bus: type[BatchBus], options: Mapping[str, Any]) -> None:
    known = [name for name in inspect.signature(bus).parameters if name != "channel"]
    for name in options:
        if name not in known:
            raise ConfigError(
                f"the bus has no option {name}",
                where=where,
                next_step=f"did you mean {_nearest(name, known)}?",
            )


def _nearest(word: str, known: list[str]) -> str:
    return " or ".join(difflib.get_close_matches(word, known, 2, 0.5) or known)


def _number(error: BaseException) -> int | None:
    """Return the errno behind an error of python-can or pyserial."""
    seen: BaseException | None = error
    while seen is not None:
        if isinstance(seen, OSError) and seen.errno is not None:
            return seen.errno
        if isinstance(seen, can.CanError) and seen.error_code is not None:
            return seen.error_code
        seen = seen.__cause__ or seen.__context__
    return None


def _words(error: BaseException) -> str:
    # pyserial's own text says the number, the device and the reason twice.
    if isinstance(error, OSError) and error.errno is not None:
        return os.strerror(error.errno)
    return str(error).strip() or type(error).__name__


def _next_step(config: BusConfig, error: BaseException) -> str:
    if config.interface == "socketcan":
        return _for_socketcan(config, _number(error))
    if config.interface == "slcan":
        return _for_serial(str(config.channel), _number(error), error)
    if config.interface == "socketcand":
        return "see that socketcand runs there and serves this bus; check host and port"
    return f"see that the adapter is plugged in and the driver of {config.interface} is installed"


def _for_socketcan(config: BusConfig, number: int | None) -> str:
    name, bitrate = config.channel, config.bitrate or 1_000_000
    up = f"sudo ip link set {name} up type can bitrate {bitrate}"
    if number == errno.ENETDOWN:
        return f"the interface is down; type: {up}"
    if number == errno.ENODEV:
        there = [n for _, n in socket.if_nameindex() if "can" in n]
        found = ", ".join(there) or "none"
        return f"the CAN interfaces here are: {found}; plug the adapter in and type: {up}"
    if number in (errno.EAFNOSUPPORT, errno.EPROTONOSUPPORT):
        return (
            "this kernel has no SocketCAN; type: sudo modprobe can_raw;"
            " or use the adapter with interface: slcan"
        )
    return f"type: ip -details link show {name}"


def _for_serial(device: str, number: int | None, error: BaseException) -> str:
    path = Path(device)
    if number == errno.ENOENT:
        there = sorted({*Path("/dev").glob("ttyACM*"), *Path("/dev").glob("ttyUSB*")})
        found = ", ".join(map(str, there)) or "none"
        return f"the USB serial devices here are: {found}; plug the adapter in"
    if number in (errno.EACCES, errno.EPERM):
        return f"type: sudo usermod -aG {_group_of(path)} $USER; then log in again"
    if number in (errno.EBUSY, errno.EWOULDBLOCK) or "lock" in str(error):
        return f"another program uses it; see which: fuser {device}"
    if isinstance(error, can.CanInitializationError):
        return "see that the adapter speaks slcan and has this bit rate; plug it in anew"
    return "unplug the adapter and plug it in again"


def _group_of(path: Path) -> str:
    try:
        return grp.getgrgid(path.stat().st_gid).gr_name
    except (OSError, KeyError):
        return "dialout"
