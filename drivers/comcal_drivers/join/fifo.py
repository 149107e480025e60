# SPDX-License-Identifier: Apache-2.0
"""First in, first out: parts paired in order, where being balanced proves that nothing is missing.

A group opens with the first part of a sample (or with the host's request, where requests are
seen) while nothing is outstanding, and closes at the next such opener while every part came equally
often. Within a closed group the k-th of each part are one sample, however far they are interleaved:
this is how a second half that came after the next request still finds its first half.

What is proven, and under which assumptions. Frames of one identifier keep their order, and no
backlog lasts longer than ``depth`` samples: that is what ``depth`` says about a device and its bus.
Then

- a group that grows beyond ``depth`` samples has lost a part; it is dropped whole,
- as is one with an orphan (a part more often than its opener) or with stamps more than ``timeout``
  apart, or running backwards; polls do not count here, another clock stamps them,
- after that, ``depth`` clean samples in a row (each part once, in order) show that nothing is
  outstanding; they are held until then and emitted together, the first one marked as
  resynchronised. A stream that does not begin with a request begins in this state, too.

What cannot be seen. Where requests are not seen, a group that lost the last part of one sample and
the first part of a later one is balanced again, and so is one in which a part was doubled and
another of its kind was lost; only stamps more than ``timeout`` apart betray them. Where requests
are seen, that takes the loss of the request in between as well. A counter in the frames avoids it.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from comcal_drivers.join.events import REQUEST, Events
from comcal_drivers.join.pairs import Index, Pairs
from comcal_drivers.join.sample import LOST, RESYNC


@dataclass
class Fifo:
    """State of the pairing between two batches: a few numbers, no events.

    Parameters
    ----------
    parts : int
        Parts of a sample.
    depth : int
        Samples that a backlog lasts at most.
    timeout : float
        Seconds between two parts of a group at most.
    """

    parts: int
    depth: int
    timeout: float
    polled: bool = False
    """Whether requests are seen."""
    seeking: bool = True
    """Whether step must be found first."""
    fresh: bool = True
    """Whether nothing came yet."""
    begun: bool = False
    """Whether the stream was in step at least once."""
    flags: int = 0
    """Marks for the next sample."""
    orphaned: int = 0
    short: int = 0
    duplicated: int = 0
    """Never told from other orphans."""
    other: int = 0
    """Requests."""
    resyncs: int = 0
    found_lost: int = 0
    """Samples missing in breaks that are over."""
    unasked: int = 0
    """Parts dropped since the last request."""
    missed: dict[int, int] = field(default_factory=dict[int, int])
    """Frames dropped since step was lost, by code."""

    @property
    def lost(self) -> int:
        """Samples missing: since step was lost, as many as the most frequent part was dropped.

        The rest of a sample that had begun before the stream did does not count.
        """
        return self.found_lost + max(self.missed.values(), default=0)

    @property
    def opener(self) -> int:
        """Code of what opens a group."""
        return REQUEST if self.polled else 0

    @property
    def period(self) -> int:
        """Frames of a clean sample, its request included."""
        return self.parts + self.polled

    def pair(self, events: Events, *, at_end: bool) -> Pairs:
        """Find the samples: see :class:`~comcal_drivers.join.pairs.Pairing`."""
        scan = _Scan(self, events, at_end=at_end)
        settled = scan.run()
        return scan.pairs(settled)


class _Scan:
    """One pass over events; everything that outlives it is in ``state``.

    Each step looks only at events up to the one that decides, so that the result does not depend
    on how the stream was cut. Clean stretches are found for all events at once.
    """

    def __init__(self, state: Fifo, events: Events, *, at_end: bool) -> None:
        self.state = state
        self.at_end = at_end
        self.events = events
        self.codes: list[int] = events.code.tolist()
        self.t = _without_polls(events)
        self.times: list[float] = self.t.tolist()
        self.n = len(self.codes)
        self.found: list[tuple[Index, int]] = []
        self._find_breaks()

    def pairs(self, settled: int) -> Pairs:
        """Return what was found among the events that are settled."""
        index = [np.empty((0, self.state.parts), np.intp), *(i for i, _ in self.found)]
        flags = np.zeros(sum(len(i) for i in index), np.uint8)
        first = 0
        for samples, marks in self.found:
            flags[first] = marks
            first += len(samples)
        return Pairs(np.concatenate(index), flags, np.arange(settled, self.n, dtype=np.intp))

    def run(self) -> int:
        """Settle as many events as possible; return how many."""
        at = 0
        while at < self.n:
            self._watch_requests(at)
            settled = self._seek(at) if self.state.seeking else self._follow(at)
            if settled == at:
                break
            self.state.fresh = False
            at = settled
        return at

    def _watch_requests(self, at: int) -> None:
        """Notice that the host's requests begin, or end, to be seen."""
        state = self.state
        if self.codes[at] == REQUEST and not state.polled:
            state.polled = True
            if state.fresh:  # before the host's first request nothing is outstanding
                state.seeking, state.begun = False, True
        elif state.polled and state.seeking and state.unasked > state.depth * state.parts:
            state.polled = False
        else:
            return
        self._find_breaks()

    # Clean stretches

    def _find_breaks(self) -> None:
        """Find where an event does not follow the one before, and samples with stamps apart."""
        state, code, t = self.state, self.events.code, self.t
        last = state.parts - 1
        follows = code[1:] == np.where(code[:-1] == last, state.opener, code[:-1] + 1)
        self.breaks = np.flatnonzero(~follows)
        apart = np.zeros(self.n, np.bool_)
        for k in range(1, state.period):
            apart[:-k] |= np.abs(t[k:] - t[:-k]) > state.timeout
        self.apart = np.flatnonzero(apart & (code == state.opener))

    def _stretch(self, at: int) -> tuple[int, int | None]:
        """Return how many closed clean samples begin at the opener *at*, and what ends them.

        The second is the place of the last event that still fits; None where the events end before
        anything is wrong.
        """
        period = self.state.period
        nearest = int(np.searchsorted(self.breaks, at))
        end = int(self.breaks[nearest]) if nearest < self.breaks.size else None
        last = self.n - 1 if end is None else end
        closed = (last - at + (self.at_end and end is None)) // period
        nearest = int(np.searchsorted(self.apart, at))
        if nearest < self.apart.size:
            torn = int(self.apart[nearest])
            if torn + period - 1 <= last:
                return min(closed, (torn - at) // period), torn
        return closed, end

    # In step

    def _follow(self, at: int) -> int:
        """Settle the clean samples or the one group at *at*; *at* where more must come first."""
        state = self.state
        if self.codes[at] != state.opener:
            return self._lose_step(at, at + 1)
        closed, _ = self._stretch(at)
        if closed:
            return self._emit_clean(at, closed)
        return self._group(at)

    def _group(self, at: int) -> int:
        """Settle the group that opens at *at*."""
        state = self.state
        seen: list[list[int]] = [[] for _ in range(state.parts)]
        opened = 0
        for place in range(at, self.n):
            code = self.codes[place]
            if code in (state.opener, REQUEST):
                if opened and all(len(part) == opened for part in seen):
                    return self._emit_group(seen, place)
                if opened == state.depth or code != state.opener:
                    return self._lose_step(at, place)
            if abs(self.times[place] - self.times[at]) > state.timeout:
                return self._lose_step(at, place)
            opened += code == state.opener
            if code != REQUEST:
                seen[code].append(place)
                if len(seen[code]) > opened:
                    return self._lose_step(at, place + 1)
        if not self.at_end:
            return at
        if all(len(part) == opened for part in seen):
            return self._emit_group(seen, self.n)
        return self._lose_step(at, self.n)

    def _emit_group(self, seen: list[list[int]], end: int) -> int:
        self._emit(np.array(seen, np.intp).T)
        return end

    def _emit_clean(self, at: int, samples: int) -> int:
        state = self.state
        begin = at + np.arange(samples, dtype=np.intp)[:, None] * state.period
        self._emit(begin + state.polled + np.arange(state.parts))
        return at + samples * state.period

    def _emit(self, index: Index) -> None:
        state = self.state
        self.found.append((index, state.flags))
        state.flags = 0
        state.other += len(index) * state.polled

    # Out of step

    def _seek(self, at: int) -> int:
        """Settle ``depth`` clean samples from *at*, or drop what cannot begin them."""
        state = self.state
        if self.codes[at] != state.opener:
            return self._drop(at, at + 1)
        closed, end = self._stretch(at)
        if closed >= state.depth:
            return self._regain_step(at, state.depth)
        if end is not None:
            return self._drop(at, end + 1)
        if not self.at_end:
            return at
        dropped = state.orphaned + state.short
        if not state.begun and not dropped and at + closed * state.period == self.n:
            # The stream is balanced from its first frame to its last.
            return self._regain_step(at, closed)
        return self._drop(at, self.n)

    def _regain_step(self, at: int, samples: int) -> int:
        state = self.state
        state.found_lost = state.lost
        state.missed.clear()
        state.unasked = 0
        state.seeking, state.begun = False, True
        return self._emit_clean(at, samples)

    def _lose_step(self, begin: int, end: int) -> int:
        state = self.state
        state.seeking = True
        state.resyncs += 1
        state.flags = int(LOST | RESYNC)
        return self._drop(begin, end)

    def _drop(self, begin: int, end: int) -> int:
        state = self.state
        for place in range(begin, end):
            code = self.codes[place]
            if state.begun or state.missed or code == state.opener:
                state.missed[code] = state.missed.get(code, 0) + 1
            if code == REQUEST:
                state.other += 1
                state.unasked = 0
            else:
                state.unasked += 1
                state.orphaned += bool(self.events.ok[place])
                state.short += not self.events.ok[place]
        return end


def _without_polls(events: Events) -> npt.NDArray[np.float64]:
    """Return stamps [s] in which a poll has that of the next part, NaN as long as there is none.

    The host stamps the polls, by another clock than the adapter the answers.
    """
    n = len(events)
    answers = np.where(events.code == REQUEST, n, np.arange(n))
    following = np.minimum.accumulate(answers[::-1])[::-1]
    return np.append(events.t, np.nan)[following]
