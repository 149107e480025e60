# SPDX-License-Identifier: Apache-2.0
"""Parts with the same counter are one sample; a missing number is a lost sample.

Samples are given out in the order of their numbers. One that is not complete is waited for until
the counter is ``window`` samples further; its parts, and those that come later still, are orphans.

A frame whose number lies far off (more than a quarter of the modulus ahead, or further back than
the window) is held until the next frame comes. If that one agrees with it, the device began to
count anew, or the gap is too wide to be told from going backwards: counting is resynchronised, with
an unknown number lost. If not, the frame was a straggler or damaged, and is an orphan. Counting is
resynchronised as well after a silence of ``silence`` seconds, in which the counter may have gone
round.

What cannot be seen: a gap of a whole number of turns of the counter, without stamps or period.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from comcal_drivers.join.events import Events
from comcal_drivers.join.pairs import Index, Pairs
from comcal_drivers.join.sample import LOST, RESYNC

WINDOW = 8
"""Samples that are waited for."""


@dataclass
class Counter:
    """State of the pairing between two batches.

    Parameters
    ----------
    parts : int
        Parts of a sample.
    modulus : int
        The counter goes from ``modulus - 1`` to 0.
    step : int
        What it grows by from sample to sample.
    timeout : float
        Seconds between two parts of a sample at most.
    silence : float
        Seconds after which the counter proves nothing any more.
    """

    parts: int
    modulus: int
    step: int
    timeout: float
    silence: float = np.inf
    orphaned: int = 0
    short: int = 0
    duplicated: int = 0
    other: int = 0
    resyncs: int = 0
    lost: int = 0
    flags: int = 0
    """Marks for the next sample."""
    begun: bool = False
    """Whether there was a sample; before it nothing counts as lost."""
    base: int | None = None
    """Unwrapped number of the next sample to be given out; None before the first frame."""
    head: int = 0
    """Newest number, unwrapped."""
    last_t: float = np.nan
    """Stamp of the newest frame [s]."""
    slots: dict[int, list[int]] = field(default_factory=dict[int, list[int]])
    """By number, the places of the parts that came; -1 where one is missing."""
    suspect: int = -1
    """Place of a frame whose number lies far off; -1 without one."""
    held: int = 0
    """How many of the next events were seen already."""
    given: dict[int, int] = field(default_factory=dict[int, int])
    """For the last numbers that are settled, the parts that came, as bits."""

    @property
    def window(self) -> int:
        """How far behind the newest a number may be."""
        return min(WINDOW, max(1, self.modulus // (4 * self.step))) * self.step

    def pair(self, events: Events, *, at_end: bool) -> Pairs:
        """Find the samples: see :class:`~comcal_drivers.join.pairs.Pairing`."""
        scan = _Scan(self, events)
        scan.run()
        if at_end:
            scan.finish()
        return scan.pairs()


class _Scan:
    """One pass over events, one by one where anything is unusual, else all at once."""

    def __init__(self, state: Counter, events: Events) -> None:
        self.state = state
        self.codes: list[int] = events.code.tolist()
        self.counters: list[int] = events.counter.tolist()
        self.times: list[float] = events.t.tolist()
        self.ok: list[bool] = events.ok.tolist()
        self.n = len(self.codes)
        self.found: list[tuple[Index, int]] = []
        self.breaks = self._find_breaks(events)
        self.next_break = 0

    def run(self) -> None:
        """Look at every event that was not seen before."""
        at = self.state.held
        while at < self.n:
            at = self._clean(at) or self._one(at)

    def pairs(self) -> Pairs:
        """Return what was found, and renumber what is kept."""
        state = self.state
        places = [p for slot in state.slots.values() for p in slot if p >= 0]
        keep = sorted([*places, *([state.suspect] if state.suspect >= 0 else [])])
        moved = {place: k for k, place in enumerate(keep)} | {-1: -1}
        state.slots = {number: [moved[p] for p in slot] for number, slot in state.slots.items()}
        state.suspect = moved[state.suspect]
        state.held = len(keep)
        index = [np.empty((0, state.parts), np.intp), *(i for i, _ in self.found)]
        flags = np.zeros(sum(len(i) for i in index), np.uint8)
        first = 0
        for samples, marks in self.found:
            flags[first] = marks
            first += len(samples)
        return Pairs(np.concatenate(index), flags, np.array(keep, np.intp))

    # Clean stretches

    def _find_breaks(self, events: Events) -> Index:
        """Return the places whose next event does not continue a clean stretch."""
        state, code, counter, t = self.state, events.code, events.counter, events.t
        ends = code[:-1] == state.parts - 1
        expected = np.where(ends, (counter[:-1] + state.step) % state.modulus, counter[:-1])
        begin = np.arange(len(events) - 1) - code[:-1]
        elapsed = np.abs(t[1:] - t[np.maximum(begin, 0)])
        good = (code[1:] == np.where(ends, 0, code[:-1] + 1)) & (counter[1:] == expected)
        good &= events.ok[1:] & events.ok[:-1] & (counter[1:] >= 0)
        good &= ends | ~(elapsed > state.timeout)
        good &= ~(t[1:] - t[:-1] > state.silence)
        return np.flatnonzero(~good)

    def _clean(self, at: int) -> int:
        """Give out the whole samples of a clean stretch; return its end, 0 if there is none."""
        state = self.state
        if state.slots or state.suspect >= 0 or self.codes[at] != 0 or not self.ok[at]:
            return 0
        counter = self.counters[at]
        if counter < 0 or self.times[at] - state.last_t > state.silence:
            return 0
        if state.base is None:
            state.base, state.head = counter, counter - state.step
        elif counter != state.base % state.modulus or state.base != state.head + state.step:
            return 0
        while self.next_break < self.breaks.size and self.breaks[self.next_break] < at:
            self.next_break += 1
        known = self.next_break < self.breaks.size
        last = int(self.breaks[self.next_break]) if known else self.n - 1
        samples = (last - at + 1) // state.parts
        if samples == 0:
            return 0
        end = at + samples * state.parts
        self._emit(np.arange(at, end, dtype=np.intp).reshape(samples, state.parts))
        whole = (1 << state.parts) - 1
        for k in range(max(0, samples - WINDOW), samples):
            self._settle(state.base + k * state.step, whole)
        state.base += samples * state.step
        state.head = state.base - state.step
        state.last_t = self.times[end - 1]
        return end

    # One by one

    def _one(self, at: int) -> int:
        """Look at one event; return the place behind it."""
        state = self.state
        if self.codes[at] < 0:
            state.other += 1
            return at + 1
        counter, t = self.counters[at], self.times[at]
        if not self.ok[at] or counter < 0:
            state.short += 1
            return at + 1
        silent = t - state.last_t > state.silence
        state.last_t = t
        if state.base is None:
            state.base = state.head = counter
        elif silent:
            self._restart(at)
        elif self._is_far(counter, state.head):
            if state.suspect < 0 or self._is_far(counter, self.counters[state.suspect]):
                self._drop_suspect()
                state.suspect = at
                return at + 1
            first, state.suspect = state.suspect, -1
            self._restart(first)
            self._place(first)
        else:
            self._drop_suspect()
        self._place(at)
        return at + 1

    def _ahead(self, counter: int, of: int) -> int:
        """Return how far *counter* is ahead of *of*, between minus and plus half a turn."""
        half = self.state.modulus // 2
        return (counter - of + half) % self.state.modulus - half

    def _is_far(self, counter: int, of: int) -> bool:
        """Tell whether a number is none that can follow *of*."""
        state = self.state
        ahead = self._ahead(counter, of)
        return not -state.window <= ahead <= state.modulus // 4 or ahead % state.step != 0

    def _place(self, at: int) -> None:
        """Put a part to its sample, and give out what is complete."""
        state = self.state
        base = 0 if state.base is None else state.base
        number = state.head + self._ahead(self.counters[at], state.head)
        state.head = max(state.head, number)
        bit = 1 << self.codes[at]
        if number < base:
            came = state.given.get(number, 0)
            state.duplicated += bool(came & bit)
            state.orphaned += not came & bit
            return
        slot = state.slots.setdefault(number, [-1] * state.parts)
        if slot[self.codes[at]] >= 0:
            state.duplicated += 1
            return
        slot[self.codes[at]] = at
        self._give_out(base)

    def _give_out(self, base: int) -> None:
        """Give out complete samples in order; give up those that were waited for long enough."""
        state = self.state
        while True:
            slot = state.slots.get(base)
            if slot is not None and min(slot) >= 0:
                self._complete(base)
            elif state.head - base >= state.window:
                if slot is not None:
                    self._give_up(base)
                else:
                    skipped = min([state.head - state.window + state.step, *state.slots])
                    self._lose((skipped - base) // state.step)
                    base = skipped
                    continue
            else:
                break
            base += state.step
        state.base = base

    def _complete(self, number: int) -> None:
        """Give out one sample, unless its parts are too far apart."""
        state = self.state
        slot = state.slots[number]
        if any(abs(self.times[p] - self.times[slot[0]]) > state.timeout for p in slot):
            self._give_up(number)
            return
        del state.slots[number]
        self._settle(number, (1 << state.parts) - 1)
        self._emit(np.array([slot], np.intp))

    def _give_up(self, number: int) -> None:
        """Drop a sample of which parts are missing, or too far apart."""
        state = self.state
        slot = state.slots.pop(number)
        came = [p >= 0 for p in slot]
        state.orphaned += sum(came)
        self._settle(number, sum(1 << code for code, there in enumerate(came) if there))
        self._lose(1)

    def _settle(self, number: int, came: int) -> None:
        """Remember which parts of a settled sample came; forget the oldest."""
        given = self.state.given
        given[number] = came
        while len(given) > 4 * WINDOW:
            del given[next(iter(given))]

    def _lose(self, samples: int) -> None:
        state = self.state
        if state.begun and samples:
            state.lost += samples
            state.flags |= int(LOST)

    def _emit(self, index: Index) -> None:
        state = self.state
        self.found.append((index, state.flags))
        state.flags = 0
        state.begun = True

    def _drop_suspect(self) -> None:
        state = self.state
        if state.suspect >= 0:
            state.orphaned += 1
            state.suspect = -1

    def _restart(self, at: int) -> None:
        """Count anew from the event *at*."""
        state = self.state
        self.finish()
        state.given.clear()
        state.base = state.head = self.counters[at]
        state.resyncs += 1
        state.flags |= int(LOST | RESYNC) if state.begun else 0

    def finish(self) -> None:
        """Give out or give up everything that is held."""
        state = self.state
        self._drop_suspect()
        for number in sorted(state.slots):
            base = number if state.base is None else state.base
            self._lose((number - base) // state.step)
            if min(state.slots[number]) >= 0:
                self._complete(number)
            else:
                self._give_up(number)
            state.base = number + state.step
