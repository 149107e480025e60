# SPDX-License-Identifier: Apache-2.0
"""Everything that an emulator consists of, put together from robot.yaml and a few options."""

from __future__ import annotations

import sys
import tempfile
import threading
from collections.abc import Callable, Generator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import TracebackType

import numpy as np

from comcal.errors import ConfigError, HardwareError
from comcal.measure.plan import PlannedPose
from comcal.measure.plan_csv import read_plan
from comcal.measure.source import SimulatedSource, SourceRequest
from comcal.robot.description import load_robot
from comcal.robot.model import Robot
from comcal.workflow.sources import open_source, source_names
from comcal_drivers.canopen_setup.fit import fit_joint
from comcal_drivers.devices.configuration import BusConfig, CanConfig, read_configuration
from comcal_drivers.emulator.adapter import Adapter
from comcal_drivers.emulator.device import EmulatedDevice
from comcal_drivers.emulator.faults import Fault
from comcal_drivers.emulator.injector import Injector, check_faults
from comcal_drivers.emulator.registry import emulate_all
from comcal_drivers.emulator.robot import Behaviour, EmulatedRobot, check_ids
from comcal_drivers.emulator.server import Server
from comcal_drivers.emulator.truth import TruthLog

ADAPTERS = ("slcan", "socketcand", "socketcan", "virtual")
UNPACED_LENGTH = 5.0
"""How much of a pose is streamed at most without a pace [s of the robot's clock]."""
MEASURING = frozenset({"can", "replay", "bag"})
"""Sources of this package: they measure, perhaps on this very bus, and move nothing."""
JOIN_PATIENCE = 5.0


@dataclass(frozen=True)
class Options:
    """How to emulate.

    Parameters
    ----------
    robot_yaml : Path
        With ``sources.can``; interfaces and channels of its buses are not used, but for the
        channel of a bus behind the adapter ``socketcan``: the network interface.
    adapter : str
        One of :data:`ADAPTERS`.
    source : str
        Name among the entry points ``comcal.sources``, of a simulated one.
    plan : Path or None
        None: ``plan.csv`` beside robot.yaml.
    seed : int
    noise : bool
    effects : tuple of str
        As ``--effect`` of ``comcal record``.
    rate : float
        Seconds of the robot's clock per second; zero: as fast as the host listens.
    length : float or None
        How much of a pose is streamed [s]; None: all, or five seconds without a pace.
    slot : int
        Samples between the counters of consecutive poses.
    started : bool
        Whether the devices were started, and are polled, by somebody else on the bus.
    pose : int or None
        In which the robot stands from the beginning; None: in the first of the plan, or, without a
        pace, nowhere, and it is silent.
    move_time : float
        How long a move takes [s].
    fifo : int
        Frames that fit into an slcan adapter before it loses some; zero: it waits.
    ports : Path or None
        Folder in which the serial ports of slcan adapters appear; None: a new temporary one.
    faults : tuple of Fault
    truth : Path or None
        Where to write down what the faults did.
    """

    robot_yaml: Path
    adapter: str = "slcan"
    source: str = "builtin"
    plan: Path | None = None
    seed: int = 0
    noise: bool = True
    effects: tuple[str, ...] = ()
    rate: float = 1.0
    length: float | None = None
    slot: int = Behaviour().slot
    started: bool = False
    pose: int | None = None
    move_time: float = 0.0
    fifo: int = 0
    ports: Path | None = None
    faults: tuple[Fault, ...] = ()
    truth: Path | None = None


@dataclass(frozen=True)
class Emulator:
    """A server that is ready to run.

    Parameters
    ----------
    server : Server
    connections : mapping from bus to mapping
        What robot.yaml has to say of each bus to reach it.
    """

    server: Server
    connections: Mapping[str, Mapping[str, object]]


@contextmanager
def opened(options: Options, notice: Callable[[str], None]) -> Generator[Emulator]:
    """Open source, devices and adapters, and close them again.

    Raises
    ------
    UsageError, ConfigError
        If robot.yaml, plan, source or a fault are not usable.
    """
    robot = load_robot(options.robot_yaml)
    config = _configuration(robot, options.robot_yaml)
    plan = read_plan(options.plan or options.robot_yaml.parent / "plan.csv", robot.tree.joint_names)
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="comcal-layouts-")))
        joints = {name: fit_joint(joint, folder) for name, joint in config.joints.items()}
        config = replace(config, joints=joints)
        devices = emulate_all(config, robot, started=options.started)
        check_ids(devices)
        check_faults(options.faults, {d.name: d.layout for each in devices.values() for d in each})
        source = stack.enter_context(_source(options, robot, plan))
        truth = TruthLog(options.truth)
        stack.callback(truth.close)
        adapters = dict[str, Adapter]()
        for bus in config.buses.values():
            adapters[bus.name] = _adapter(options, bus)
            stack.callback(adapters[bus.name].close)
        server = Server(
            EmulatedRobot(source, plan, devices, _behaviour(options)),
            adapters,
            _injectors(options, devices, truth),
            rate=options.rate,
            move_time=options.move_time,
            clock_device=config.clock,
            notice=notice,
        )
        pose = options.pose
        if pose is None and options.rate > 0.0 and plan:
            pose = plan[0].pose
        if pose is not None:
            server.stand(pose)
        yield Emulator(server, {bus: adapters[bus].connection for bus in adapters})


@dataclass
class RunningEmulator:
    """An emulator in a thread of this process.

    For hosts on python-can's virtual bus, which does not leave a process, and for tests that
    cannot afford to start one.

    Use it as a context manager; entering returns what robot.yaml has to say of each bus.

    Parameters
    ----------
    options : Options
        But for its ``adapter``.
    adapter : str
        One of :data:`ADAPTERS`.
    """

    options: Options
    adapter: str = "virtual"
    _over: threading.Event = field(default_factory=threading.Event)
    _ready: threading.Event = field(default_factory=threading.Event)
    _thread: threading.Thread | None = None
    _connections: Mapping[str, Mapping[str, object]] = field(
        default_factory=dict[str, Mapping[str, object]]
    )
    _error: BaseException | None = None

    def __enter__(self) -> Mapping[str, Mapping[str, object]]:
        self._thread = threading.Thread(target=self._run, name="emulator", daemon=True)
        self._thread.start()
        self._ready.wait()
        if self._error is not None:
            raise self._error
        return self._connections

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._over.set()
        if self._thread is not None:
            self._thread.join(JOIN_PATIENCE)
            if self._thread.is_alive():
                raise HardwareError("the emulated robot does not stop", where="virtual bus")
        if self._error is not None and error is None:
            raise self._error

    def _run(self) -> None:
        # Whatever goes wrong here is raised in the thread that entered.
        try:
            options = replace(self.options, adapter=self.adapter)
            with opened(options, _to_stderr) as emulator:
                self._connections = emulator.connections
                self._ready.set()
                emulator.server.run(self._over.is_set)
        except BaseException as error:  # noqa: BLE001
            self._error = error
        finally:
            self._ready.set()


def _to_stderr(text: str) -> None:
    sys.stderr.write(f"emulator: {text}\n")


def _configuration(robot: Robot, path: Path) -> CanConfig:
    options = robot.sources.get("can")
    if options is None:
        raise ConfigError(
            "robot.yaml does not say which devices hang on which bus",
            where=f"{path}, sources",
            next_step="describe them under sources: can:",
        )
    return read_configuration(options, robot)


def _source(options: Options, robot: Robot, plan: tuple[PlannedPose, ...]) -> SimulatedSource:
    name, _, argument = options.source.partition(":")
    if name in MEASURING:
        usable = [known for known in source_names() if known not in MEASURING]
        raise ConfigError(
            f"the source {name} cannot stand behind an emulated robot",
            where="--source",
            next_step=f"use one of {', '.join(usable)}",
        )
    request = SourceRequest(
        robot=robot,
        seed=options.seed,
        argument=argument,
        effects=options.effects,
        noise=options.noise,
        options=robot.sources.get(name),
        plan=plan,
    )
    return open_source(name, request)


def _behaviour(options: Options) -> Behaviour:
    is_paced = options.rate > 0.0
    length = np.inf if is_paced else UNPACED_LENGTH
    length = length if options.length is None else options.length
    return Behaviour(options.slot, length, is_paced)


def _adapter(options: Options, bus: BusConfig) -> Adapter:
    if options.adapter == "slcan":
        from comcal_drivers.emulator.slcan_adapter import SlcanAdapter

        return SlcanAdapter(bus.name, bus.bitrate or 1_000_000, options.fifo, options.ports)
    if options.adapter == "socketcand":
        from comcal_drivers.emulator.socketcand_adapter import SocketcandAdapter

        return SocketcandAdapter(bus.name)
    if options.adapter == "socketcan":
        from comcal_drivers.emulator.socketcan_adapter import SocketcanAdapter

        return SocketcanAdapter(str(bus.channel), bus.bitrate or 1_000_000)
    from comcal_drivers.emulator.virtual_adapter import VirtualAdapter

    return VirtualAdapter(f"{options.robot_yaml}:{bus.name}")


def _injectors(
    options: Options, devices: Mapping[str, list[EmulatedDevice]], truth: TruthLog
) -> dict[str, Injector]:
    speed = options.rate if options.rate > 0.0 else 1.0
    return {
        bus: Injector(bus, options.faults, {d.name: d.layout for d in each}, truth, speed)
        for bus, each in devices.items()
    }
