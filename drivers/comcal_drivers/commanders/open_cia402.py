# SPDX-License-Identifier: Apache-2.0
"""The entry point ``cia402`` of the group ``comcal.commanders``."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack

import can
import numpy as np

from comcal.errors import ConfigError, HardwareError
from comcal.measure.plan import PlannedPose
from comcal.measure.source import CommanderRequest
from comcal.robot.model import Robot
from comcal.robot.tree import JointType
from comcal.robot.validate import did_you_mean
from comcal_drivers.bus.open import open_bus
from comcal_drivers.canopen_setup import objects
from comcal_drivers.canopen_setup.conflicts import is_canopen, node_of, sync_conflict
from comcal_drivers.canopen_setup.sdo import Drive, open_network
from comcal_drivers.commanders.axis import Axis, Patience
from comcal_drivers.commanders.cia402 import ProfilePositionCommander
from comcal_drivers.commanders.options import Options, read_options
from comcal_drivers.commanders.profile import JointUnits, speed_unit_at_joint
from comcal_drivers.commanders.state_machine import HOLDING_STOPS
from comcal_drivers.commanders.units import velocity_unit
from comcal_drivers.devices.configuration import BusConfig, JointConfig, read_configuration

RAMP = 0.5
"""Full speed is reached after this time unless robot.yaml limits the acceleration [s]."""
NOT_MOVED = 1e-6
"""Joints that differ by less over the whole plan need no drive [rad]."""

OpenBus = Callable[[BusConfig], can.BusABC]


def open_cia402(request: CommanderRequest) -> ProfilePositionCommander:
    """Connect to the drives of ``sources.can.joints``, without moving or powering anything.

    Raises
    ------
    ConfigError
        If a joint that the plan moves has no CANopen drive, a drive does not tell its velocity
        unit, the speed is below what a drive can be told, or identifiers conflict.
    HardwareError
        If a drive does not answer, or would let its joint go after a quick stop.
    """
    return open_commander(request, open_bus)


def open_commander(request: CommanderRequest, opener: OpenBus) -> ProfilePositionCommander:
    """Do what :func:`open_cia402` does, with buses opened by *opener*."""
    robot = request.robot
    options = read_options(request.options, robot.yaml_path)
    config = read_configuration(robot.sources.get("can", {}), robot)
    conflict = sync_conflict(config)
    if conflict is not None:
        raise conflict
    joints = {n: j for n, j in config.joints.items() if is_canopen(j.device)}
    _require_drives(request.plan, robot, joints, options)
    with ExitStack() as opened:
        drives = _connect(opened, joints, config.buses, opener)
        axes = [
            _axis(robot, joint, drives[name], options, request.speed)
            for name, joint in joints.items()
        ]
        return ProfilePositionCommander(
            axes,
            request.plan,
            request.speed,
            options.max_acceleration or request.speed / RAMP,
            opened.pop_all().close,
        )


def _connect(
    opened: ExitStack,
    joints: Mapping[str, JointConfig],
    buses: Mapping[str, BusConfig],
    opener: OpenBus,
) -> dict[str, Drive]:
    """Open every bus that has drives, and a drive for every joint."""
    drives: dict[str, Drive] = {}
    for name in sorted({joint.bus for joint in joints.values()}):
        here = {n: j for n, j in joints.items() if j.bus == name}
        if buses[name].interface == "slcan":
            raise ConfigError(
                "the drives cannot be moved over the adapter that is being recorded: slcan can be "
                "opened only once",
                where=f"bus {name}",
                next_step="attach the adapter to the kernel (slcand) and use interface: socketcan",
            )
        bus = opener(buses[name])
        opened.callback(bus.shutdown)
        nodes = [node_of(joint.device) for joint in here.values()]
        network = opened.enter_context(open_network(bus, nodes))
        for (joint, _), node in zip(here.items(), nodes, strict=True):
            drives[joint] = Drive(network, node, joint)
    return drives


def _axis(robot: Robot, joint: JointConfig, drive: Drive, options: Options, speed: float) -> Axis:
    _require_holding_stop(drive, options)
    own = options.joints.get(joint.name)
    configured = (own.velocity_unit if own is not None else None) or options.velocity_unit
    rule = joint.device.description.calibrate.drive
    position = rule.position if rule is not None else None
    counts_motor = position is not None and (position.unit, position.side) == ("counts", "motor")
    if joint.counts_per_turn is None or not counts_motor:
        raise ConfigError(
            f"joint {joint.name} is not moved by its drive, which does not count at the motor",
            where="sources.can.joints",
            next_step="give counts_per_turn, and a device whose position is in counts of the motor",
        )
    unit, exponent = velocity_unit(drive, configured)
    units = JointUnits(
        joint.name,
        joint.counts_per_turn,
        joint.gear,
        joint.sign,
        joint.zero,
        speed_unit_at_joint(unit, exponent, joint.counts_per_turn, joint.gear),
    )
    if units.speed_unit > speed:
        raise ConfigError(
            f"joint {joint.name} cannot be moved as slowly as asked",
            where=str(drive),
            measured=f"one unit of its profile velocity is {units.speed_unit:.3g} rad/s",
            limit=f"{speed:.3g} rad/s",
            next_step="allow a higher speed, or give the drive a finer velocity unit (0x60A9)",
        )
    tree = robot.tree
    described = tree.joints[tree.joint_index[joint.name]]
    return Axis(
        drive,
        units,
        tree.joint_names.index(joint.name),
        described.lower,
        described.upper,
        Patience(options.state_timeout, options.acknowledge_timeout),
    )


def _require_holding_stop(drive: Drive, options: Options) -> None:
    """Refuse a drive that lets its joint go after a quick stop: a robot that stands would fall."""
    if options.quick_stop is not None:
        drive.write(objects.QUICK_STOP_OPTION, options.quick_stop, 2)
    # Where the object does not exist (EPOS), the drive stays in Quick Stop Active and holds.
    code = drive.read_optional(objects.QUICK_STOP_OPTION, signed=True)
    if code is not None and code not in HOLDING_STOPS:
        raise HardwareError(
            "the drive would let its joint go after a quick stop",
            where=str(drive),
            measured=f"quick stop option code (0x605A) {code}",
            limit="5, 6, 7 or 8",
            next_step="set it with the drive's own tool, or write commanders: {cia402: "
            "{quick_stop: 6}} into robot.yaml",
        )


def _require_drives(
    plan: Sequence[PlannedPose],
    robot: Robot,
    joints: Mapping[str, JointConfig],
    options: Options,
) -> None:
    """Require a drive for every joint that the plan moves, and rotary joints only."""
    for name in options.joints:
        if name not in joints:
            raise ConfigError(
                f"there is no CANopen drive for joint {name!r}",
                where="commanders.cia402.joints",
                next_step=did_you_mean(name, list(joints)),
            )
    names = robot.tree.joint_names
    q = np.array([pose.q for pose in plan]).reshape(len(plan), len(names))
    moved = np.ptp(q, axis=0) > NOT_MOVED if len(plan) else np.zeros(len(names), bool)
    missing = [n for n, is_moved in zip(names, moved, strict=True) if is_moved and n not in joints]
    if missing or not joints:
        raise ConfigError(
            "the plan moves joints that have no CANopen drive: " + ", ".join(missing)
            if missing
            else "no joint has a CANopen drive",
            where="sources.can.joints",
            next_step="name their drives (device: cia402 or maxon_epos), or let the operator move "
            "the robot",
        )
    for name in joints:
        if robot.tree.joints[robot.tree.joint_index[name]].kind is JointType.PRISMATIC:
            raise ConfigError(
                f"joint {name} is prismatic; only rotary joints are moved by their drives",
                where="sources.can.joints",
                next_step="let the operator move the robot",
            )
