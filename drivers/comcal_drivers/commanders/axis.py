# SPDX-License-Identifier: Apache-2.0
"""One joint moved by one CiA 402 drive in profile position mode."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

from comcal.errors import HardwareError
from comcal_drivers.canopen_setup import objects
from comcal_drivers.canopen_setup.sdo import Drive, MissingObjectError
from comcal_drivers.commanders import state_machine as cia402
from comcal_drivers.commanders.profile import JointUnits
from comcal_drivers.commanders.state_machine import State, state_of, towards_enabled

POLL = 0.002
"""Between two looks at a status word that is about to change [s]."""

Perform = Callable[[Callable[[], None]], None]
"""Carries out a write, or refuses because the motion has been stopped meanwhile."""


@dataclass(frozen=True)
class Patience:
    """How long a drive may take.

    Parameters
    ----------
    state : float
        For one change of state [s].
    acknowledge : float
        To take a set-point [s].
    """

    state: float = 1.0
    acknowledge: float = 0.5


@dataclass(frozen=True)
class Axis:
    """A joint, its drive and its limits.

    Parameters
    ----------
    drive : Drive
    units : JointUnits
    column : int
        Of the joint in ``q``.
    lower, upper : float
        Limits of the URDF [rad].
    patience : Patience
    """

    drive: Drive
    units: JointUnits
    column: int
    lower: float
    upper: float
    patience: Patience = Patience()

    def position(self) -> float:
        """Return where the joint is [rad]."""
        return self.units.position(self.drive.read(objects.POSITION, signed=True))

    def statusword(self) -> int:
        """Return 0x6041."""
        return self.drive.read(objects.STATUSWORD)

    def check(self, statusword: int) -> None:
        """Require that the drive follows its set-point.

        Raises
        ------
        HardwareError
            If it left Operation Enabled, or reports a following error.
        """
        state = state_of(statusword)
        if state is not State.OPERATION_ENABLED:
            raise self.fault(state)
        if statusword & cia402.FOLLOWING_ERROR:
            raise self.drive.failure(
                "cannot follow its set-point (following error, bit 13 of 0x6041)",
                next_step="see what holds the joint, or move more slowly",
            )

    def enable(self, perform: Perform, *, reset_fault: bool) -> None:
        """Bring the drive to Operation Enabled, in profile position mode, where it stands.

        Parameters
        ----------
        perform : callable
        reset_fault : bool
            Whether a fault that is there already may be reset, once.

        Raises
        ------
        HardwareError
            If there is a fault, or the drive does not change its state in time.
        """
        drive = self.drive
        if state_of(self.statusword()) is State.FAULT_REACTION:
            self._await_other(State.FAULT_REACTION)
        if state_of(self.statusword()) is State.FAULT:
            if not reset_fault:
                raise self.fault(State.FAULT)
            # The reset is a rising edge of bit 7.
            perform(lambda: drive.write(objects.CONTROLWORD, 0, 2))
            perform(lambda: drive.write(objects.CONTROLWORD, cia402.FAULT_RESET, 2))
            if self._await_other(State.FAULT) is State.FAULT:
                raise self.fault(State.FAULT)
            drive.remote.emcy.reset()
        self._position_mode(perform)
        # Nothing old may be left to run to once the power is on.
        here = drive.read(objects.POSITION, signed=True)
        perform(lambda: drive.write(objects.TARGET_POSITION, here, 4))
        self._switch_on(perform)

    def prepare(self, perform: Perform, target: int, speed: int, acceleration: int) -> None:
        """Write the profile and the target, and read both back, without starting.

        Raises
        ------
        HardwareError
            If the drive has kept another number than it was given.
        """
        drive = self.drive
        wanted = (
            (objects.PROFILE_ACCELERATION, acceleration, False),
            (objects.PROFILE_DECELERATION, acceleration, False),
            (objects.PROFILE_VELOCITY, speed, False),
            (objects.TARGET_POSITION, target, True),
        )
        for index, value, signed in wanted:
            try:
                perform(lambda index=index, value=value: drive.write(index, value, 4))
            except MissingObjectError:
                if index != objects.PROFILE_DECELERATION:  # optional: then 0x6083 is for both
                    raise
                continue
            kept = drive.read(index, signed=signed)
            if kept != value:
                raise drive.failure(
                    f"did not keep what was written to 0x{index:04X}",
                    measured=f"{kept} units",
                    limit=f"{value} units",
                    next_step="check the drive's own limits (0x607D, 0x607F, 0x60C5)",
                )

    def start(self, perform: Perform) -> None:
        """Give the edge of bit 4 that starts the motion.

        Raises
        ------
        HardwareError
            If the acknowledgement of the last set-point is still up.
        """
        drive = self.drive
        perform(lambda: drive.write(objects.CONTROLWORD, cia402.ENABLE, 2))
        self._await_bit(cia402.ACKNOWLEDGED, up=False, what="does not end its last set-point")
        perform(lambda: drive.write(objects.CONTROLWORD, cia402.NEW_SET_POINT, 2))

    def confirm(self, perform: Perform) -> None:
        """Wait until the drive has taken the set-point, and take the edge back.

        Raises
        ------
        HardwareError
            If it does not in time, or reports a fault.
        """
        drive = self.drive
        self._await_bit(cia402.ACKNOWLEDGED, up=True, what="does not take the set-point")
        perform(lambda: drive.write(objects.CONTROLWORD, cia402.ENABLE, 2))

    def send_quick_stop(self) -> None:
        """Send the quick stop without waiting for anything."""
        self.drive.send_write(objects.CONTROLWORD, cia402.QUICK_STOP, 2)

    def quick_stop(self) -> None:
        """Stop, and require that the drive says so.

        Raises
        ------
        HardwareError
            If it does not answer, or still runs its set-point.
        """
        self.drive.write(objects.CONTROLWORD, cia402.QUICK_STOP, 2)
        if self._await_other(State.OPERATION_ENABLED) is State.OPERATION_ENABLED:
            raise self.drive.failure(
                "does not obey the quick stop",
                limit=f"{self.patience.state:g} s",
                next_step="use the emergency stop of the robot",
            )

    def fault(self, state: State) -> HardwareError:
        """Return the error of a drive that left Operation Enabled, with its own code."""
        code = self.drive.read_optional(objects.ERROR_CODE)
        told = "" if not code else f", error code 0x{code:04X}"
        return self.drive.failure(
            f"is in {state.value}{told}",
            next_step="look the code up in the manual of the drive, remove the cause, and "
            "start again",
        )

    def _position_mode(self, perform: Perform) -> None:
        drive = self.drive
        perform(lambda: drive.write(objects.MODE, cia402.POSITION_MODE, 1))
        deadline = time.monotonic() + self.patience.state
        while (mode := drive.read(objects.MODE_DISPLAY, signed=True)) != cia402.POSITION_MODE:
            if time.monotonic() > deadline:
                raise drive.failure(
                    "does not change to profile position mode",
                    measured=f"mode {mode}",
                    next_step="check in its manual that it has this mode (0x6502, bit 0)",
                )
            time.sleep(POLL)

    def _switch_on(self, perform: Perform) -> None:
        drive = self.drive
        # Three steps lead there; a drive that falls back would otherwise go round for ever.
        for _ in range(5):
            state = state_of(self.statusword())
            if state is State.OPERATION_ENABLED:
                return
            if state in (State.FAULT, State.FAULT_REACTION, State.UNKNOWN):
                raise self.fault(state)
            word = towards_enabled(state)
            if word is not None:
                perform(lambda word=word: drive.write(objects.CONTROLWORD, word, 2))
            if self._await_other(state) is state:
                sent = "" if word is None else f" after control word 0x{word:04X}"
                raise drive.failure(
                    f"stays in {state.value}{sent}",
                    limit=f"{self.patience.state:g} s",
                    next_step="check its power supply and its enable input",
                )
        raise drive.failure(
            "does not reach Operation Enabled", next_step="check its enable input and its fault log"
        )

    def _await_other(self, state: State) -> State:
        """Wait for another state than *state*; return the last one seen."""
        deadline = time.monotonic() + self.patience.state
        while (seen := state_of(self.statusword())) is state and time.monotonic() < deadline:
            time.sleep(POLL)
        return seen

    def _await_bit(self, bit: int, *, up: bool, what: str) -> None:
        deadline = time.monotonic() + self.patience.acknowledge
        while True:
            word = self.statusword()
            self.check(word)
            if bool(word & bit) == up:
                return
            if time.monotonic() > deadline:
                raise self.drive.failure(
                    f"{what} (bit 12 of 0x6041)",
                    limit=f"{self.patience.acknowledge:g} s",
                    next_step="check that it is homed and that its inputs allow motion",
                )
            time.sleep(POLL)
