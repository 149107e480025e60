# SPDX-License-Identifier: Apache-2.0
"""Does what the faults say to the frames of one bus, and writes it down."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby

import numpy as np

from comcal.errors import ConfigError
from comcal_drivers.emulator.faults import Fault
from comcal_drivers.emulator.frame import Frame
from comcal_drivers.emulator.layout import DeviceLayout
from comcal_drivers.emulator.truth import TruthLog


@dataclass(frozen=True)
class Outage:
    """From here on nothing passes for *duration* seconds of wall-clock time."""

    kind: str
    duration: float


@dataclass
class _Armed:
    """A fault with its random numbers and what it did so far."""

    fault: Fault
    rng: np.random.Generator
    done: int = 0


@dataclass
class _Held:
    """A frame that comes late."""

    frame: Frame
    waits: int


@dataclass
class _Silence:
    """Until when somebody is silent, why, and the samples that are lost by it."""

    until: float
    armed: _Armed
    lost: dict[str, set[int]] = field(default_factory=dict[str, set[int]])


@dataclass
class _Injection:
    """What is remembered between two samples."""

    pose: int = 0
    index: dict[str, int] = field(default_factory=dict[str, int])
    ticks: int = 0
    held: list[_Held] = field(default_factory=list[_Held])
    counts: dict[str, int] = field(default_factory=dict[str, int])
    clock: float = 0.0
    t: float = 0.0
    muted: dict[str, _Silence] = field(default_factory=dict[str, "_Silence"])
    frames: int = 0


class Injector:
    """The place between the encoder and the adapter of one bus.

    Parameters
    ----------
    bus : str
        Its name.
    faults : sequence of Fault
        Those that name a device of another bus are not this one's.
    layouts : mapping from device name to DeviceLayout
        The devices of this bus.
    truth : TruthLog
    speed : float
        Seconds of the stream's clock per second of wall-clock time.
    """

    def __init__(
        self,
        bus: str,
        faults: Sequence[Fault],
        layouts: Mapping[str, DeviceLayout],
        truth: TruthLog,
        speed: float = 1.0,
    ) -> None:
        self._bus = bus
        self._layouts = layouts
        self._truth = truth
        self._speed = speed
        self._armed = [
            _Armed(fault, np.random.default_rng(np.random.SeedSequence([fault.seed, i])))
            for i, fault in enumerate(faults)
            if fault.device in layouts or not fault.device
        ]
        self._now = _Injection()

    def begin(self, pose: int) -> None:
        """Count samples anew: a pose begins."""
        self._now.pose = pose
        self._now.ticks = 0
        self._now.index.clear()

    def announced(self, device: str, count: int) -> int:
        """Return what *device* will count for the first sample of the pose, jumps included."""
        shift = self._now.counts.get(device, 0)
        for armed in self._armed:
            if armed.fault.kind in ("counter_jump", "counter_wrap") and armed.fault.at == 0:
                layout = self._layouts.get(device)
                if layout is not None and self._concerns(armed, layout) and self._may(armed):
                    shift += self._jump(armed.fault, layout, count + shift)
        return count + shift

    def inject(self, frames: Sequence[Frame]) -> list[Frame | Outage]:
        """Return what becomes of the frames of one moment on this bus.

        Parameters
        ----------
        frames : sequence of Frame
            Parts of a sample of one device follow each other.
        """
        now = self._now
        out = list[Frame | Outage]()
        t = now.t = frames[0].t if frames else now.t
        self._end_silences(t)
        self._strike_bus(t, out)
        now.ticks += 1
        for (device, sample), group in groupby(frames, key=lambda f: (f.device, f.sample)):
            passing = list(group)
            if device in self._layouts and sample >= 0:
                passing = self._strike_sample(self._layouts[device], passing)
            silence = now.muted.get("") or now.muted.get(device)
            if silence is not None:
                silence.lost.setdefault(device, set()).add(sample)
                continue
            for frame in passing:
                self._emit(frame._replace(t=frame.t + now.clock), out)
        return out

    def stamped(self, frames: Sequence[Frame]) -> list[Frame]:
        """Return frames that do not go through here with the stamps of the clock as it is now."""
        clock = self._now.clock
        return [frame._replace(t=frame.t + clock) for frame in frames] if clock else list(frames)

    def release(self) -> list[Frame]:
        """Return the frames that were held back: nothing comes after which they could come.

        What is silent is so no longer: another pose begins.
        """
        self._end_silences(np.inf)
        return self._released()

    def _released(self) -> list[Frame]:
        late = [held.frame for held in self._now.held]
        self._now.held.clear()
        return late

    # Faults of the whole bus

    def _strike_bus(self, t: float, out: list[Frame | Outage]) -> None:
        for armed in self._armed:
            fault = armed.fault
            is_dead = fault.kind != "clock_step" and "" in self._now.muted
            if not fault.is_of_the_bus or is_dead or not self._strikes(armed, self._now.ticks):
                continue
            if fault.kind == "clock_step":
                step = 1.0 if fault.by is None else fault.by
                self._now.clock += step
                self._note(armed, t=t, by=step)
                continue
            out.extend(self._released())
            self._now.muted[""] = _Silence(t + fault.duration * self._speed, armed)
            self._note(armed, t=t, duration=fault.duration)
            out.append(Outage(fault.kind, fault.duration))

    def _end_silences(self, t: float) -> None:
        """Write down what was lost in silences that are over."""
        for who, silence in tuple(self._now.muted.items()):
            if t < silence.until:
                continue
            del self._now.muted[who]
            lost = {name: len(samples - {-1}) for name, samples in silence.lost.items() if name}
            device = {"device": who} if who else {}
            self._write(silence.armed.fault, **device, is_over=True, lost=lost)

    # Faults of one sample of one device

    def _strike_sample(self, layout: DeviceLayout, frames: list[Frame]) -> list[Frame]:
        now = self._now
        index = now.index.get(layout.name, 0)
        now.index[layout.name] = index + 1
        shift = now.counts.get(layout.name, 0)
        if shift:
            frames = layout.with_count(frames, shift)
        for armed in self._armed:
            if armed.fault.is_of_the_bus or not self._concerns(armed, layout) or not frames:
                continue
            if self._strikes(armed, index):
                frames = self._done(armed, layout, frames)
        return frames

    def _done(self, armed: _Armed, layout: DeviceLayout, frames: list[Frame]) -> list[Frame]:
        fault, first = armed.fault, frames[0]
        where = {"device": layout.name, "sample": first.sample, "t": first.t}
        if fault.kind == "silence":
            until = self._now.t + fault.duration * self._speed
            self._now.muted[layout.name] = _Silence(until, armed)
            self._note(armed, **where, duration=fault.duration)
        elif fault.kind == "status":
            bit = self._status_bit(armed, layout)
            self._note(armed, **where, bit=bit)
            return layout.with_status(frames, bit)
        elif fault.kind == "saturate":
            channel = fault.channel
            channel = int(armed.rng.integers(layout.channels)) if channel is None else channel
            self._note(armed, **where, channel=channel, low=bool(fault.low))
            return layout.with_limit(frames, channel, low=bool(fault.low))
        elif fault.kind in ("counter_jump", "counter_wrap"):
            shift = self._now.counts.get(layout.name, 0)
            by = self._jump(fault, layout, first.sample + shift)
            self._now.counts[layout.name] = shift + by
            self._note(armed, **where, by=by)
            return layout.with_count(frames, by)
        elif fault.kind == "swap_halves":
            self._note(armed, **where, parts=[f.part for f in reversed(frames)])
            return frames[::-1]
        else:
            return self._done_to_frame(armed, frames, where)
        return frames

    def _done_to_frame(
        self, armed: _Armed, frames: list[Frame], where: Mapping[str, object]
    ) -> list[Frame]:
        """Do what concerns one frame of a sample."""
        fault = armed.fault
        parts = [i for i, f in enumerate(frames) if fault.part is None or f.part == fault.part]
        if not parts:
            return frames
        i = parts[int(armed.rng.integers(len(parts)))]
        frame = frames[i]
        before, after = frames[:i], frames[i + 1 :]
        note = {**where, "part": frame.part, "id": f"{frame.bare_id:X}"}
        if fault.kind == "drop":
            self._note(armed, **note)
            return before + after
        if fault.kind == "duplicate":
            self._note(armed, **note)
            return [*before, frame, frame, *after]
        if fault.kind == "dlc":
            length = max(0, len(frame.data) - 1) if fault.length is None else fault.length
            self._note(armed, **note, was=len(frame.data), length=length)
            data = frame.data[:length].ljust(length, b"\0")
            return [*before, frame._replace(data=data), *after]
        late = 1 if fault.by is None else int(fault.by)
        self._note(armed, **note, by=late)
        # Counted from the frame that it would have come before.
        self._now.held.append(_Held(frame, late))
        return before + after

    def _emit(self, frame: Frame, out: list[Frame | Outage]) -> None:
        """Let a frame pass, and behind it those that waited for it.

        Nothing on a bus lets a frame overtake another one of its identifier; adapters that do are
        found out by a counter, and by nothing where there is none.
        """
        if not self._is_counted(frame.device):
            out.extend(held.frame for held in self._now.held if held.frame.id == frame.id)
            self._now.held = [held for held in self._now.held if held.frame.id != frame.id]
        out.append(frame)
        self._now.frames += 1
        due = list[_Held]()
        for held in self._now.held:
            held.waits -= 1
            if held.waits <= 0:
                due.append(held)
        for held in due:
            self._now.held.remove(held)
            out.append(held.frame)

    def _is_counted(self, device: str) -> bool:
        layout = self._layouts.get(device)
        return layout is not None and layout.modulus is not None

    def _jump(self, fault: Fault, layout: DeviceLayout, count: int) -> int:
        if fault.kind == "counter_jump":
            return 1000 if fault.by is None else int(fault.by)
        wraps_at = (layout.modulus or 1) // layout.counter_step
        return (wraps_at - fault.before - count) % wraps_at

    def _status_bit(self, armed: _Armed, layout: DeviceLayout) -> int:
        if armed.fault.bit is not None:
            return armed.fault.bit
        status = layout.description.status
        bits = sorted(status.bits) if status is not None else []
        return int(armed.rng.choice(bits)) if bits else 0

    # When

    def _concerns(self, armed: _Armed, layout: DeviceLayout) -> bool:
        fault = armed.fault
        if fault.kind == "silence" and layout.name in self._now.muted:
            return False
        return fault.device in ("", layout.name) and can_have(fault.kind, layout)

    def _may(self, armed: _Armed) -> bool:
        fault = armed.fault
        in_time = fault.times is None or armed.done < fault.times
        return in_time and (fault.pose is None or fault.pose == self._now.pose)

    def _strikes(self, armed: _Armed, index: int) -> bool:
        fault = armed.fault
        if not self._may(armed):
            return False
        if fault.at is not None:
            return index == fault.at
        return bool(armed.rng.random() < fault.probability)

    def _note(self, armed: _Armed, **details: object) -> None:
        armed.done += 1
        self._write(armed.fault, **details)

    def _write(self, fault: Fault, **details: object) -> None:
        self._truth.note(
            fault.kind,
            bus=self._bus,
            pose=self._now.pose,
            frame=self._now.frames,
            **details,
        )


def can_have(kind: str, layout: DeviceLayout) -> bool:
    """Whether a fault of this kind can befall the samples of a device."""
    if kind == "status":
        return layout.has_status
    if kind in ("counter_jump", "counter_wrap"):
        return layout.modulus is not None
    if kind == "swap_halves":
        return len(layout.description.parts) > 1
    return True


def check_faults(faults: Sequence[Fault], layouts: Mapping[str, DeviceLayout]) -> None:
    """Refuse faults that would never strike.

    Raises
    ------
    ConfigError
        If a fault names a device that there is not, or that cannot have it, or if none can.
    """
    for fault in faults:
        if fault.is_of_the_bus:
            continue
        named = {fault.device} & layouts.keys() if fault.device else layouts.keys()
        if not any(can_have(fault.kind, layouts[name]) for name in named):
            able = sorted(name for name, each in layouts.items() if can_have(fault.kind, each))
            raise ConfigError(
                f"no device {fault.device or 'at all'} can have the fault {fault.kind}",
                where=f"--fault {fault.kind}",
                next_step=f"devices that can: {', '.join(able) or 'none'}",
            )
