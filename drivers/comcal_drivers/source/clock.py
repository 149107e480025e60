# SPDX-License-Identifier: Apache-2.0
"""The time of samples: what the sensor counts, where it counts, else the stamps of its frames.

A counter is the better clock: stamps are taken when a frame has gone through adapter, kernel and
program, and differ from path to path; what was counted is the same on all of them.
"""

from __future__ import annotations

import numpy as np

from comcal.errors import ConfigError
from comcal_drivers.source.series import Array, Series

LEAST_STEP = 1e-6
"""By how much a time grows at least [s], whatever the stamps do."""


class SampleClock:
    """Gives the samples of one device their times, however the stream is cut.

    Parameters
    ----------
    device : str
        Of which the samples are, for messages.
    period : float or None
        Seconds from one sample to the next.
    modulus : int or None
        At which the counter begins again; None: there is no counter.
    step : int
        By how much the counter grows from one sample to the next; zero: nobody knows.
    silence : float
        Longest time between two samples that are not counted [s].
    origin : float
        The stamp that is time zero, where stamps are the clock and not before it [s].

    Attributes
    ----------
    turned_back, restarted, paused : int
        How often the clock of the stamps went back, the counter began anew, and nothing came for
        longer than ``silence``, so far.
    """

    def __init__(
        self,
        device: str,
        period: float | None = None,
        modulus: int | None = None,
        step: int = 1,
        silence: float = np.inf,
        origin: float = 0.0,
    ) -> None:
        self.device, self.period, self.modulus, self.step = device, period, modulus, step
        self.silence, self.origin = silence, origin
        self.turned_back = self.restarted = self.paused = 0
        self._heard = np.nan
        self._counter: int | None = None
        self._stamp = self._t = np.nan
        self._total, self._offset = 0, 0.0

    def begin(self) -> None:
        """Take no pause amiss that lasts until the next sample: nobody was to listen."""
        self._heard = np.nan

    def times(self, of: Series) -> Array:
        """Return the times of the next samples, shape (n,) [s], always growing.

        Counted times are those since the counter was zero, stamped ones those since ``origin``.

        Raises
        ------
        ConfigError
            If there are neither stamps nor a period.
        """
        if not len(of):
            return np.empty(0)
        if self.modulus is not None and self.period is not None and self.step > 0:
            t = self._counted(of, self.modulus, self.period)
        elif np.isfinite(of.t).all():
            t = self._stamped(of.t)
        else:
            t = self._numbered(len(of))
        self._t = float(t[-1])
        return t

    def _numbered(self, n: int) -> Array:
        if self.period is None:
            raise ConfigError(
                "its frames have no time stamps, and no `period` is stated",
                where=f"sources.can: {self.device}",
                next_step="state `period`, the seconds from one sample to the next",
            )
        t = np.arange(self._total, self._total + n, dtype=np.float64) * self.period
        self._total += n
        return t

    def _stamped(self, stamps: Array) -> Array:
        steps = np.diff(stamps, prepend=self._stamp if np.isfinite(self._stamp) else stamps[0] - 1)
        is_first = not np.isfinite(self._stamp)
        pauses = np.diff(stamps, prepend=self._heard) > self.silence
        self.paused += int(np.count_nonzero(pauses))
        self._stamp = self._heard = float(stamps[-1])
        self.turned_back += int(np.count_nonzero(steps < 0.0))
        if is_first and stamps[0] < self.origin:
            self.origin = 0.0  # these count from when the adapter was switched on, not from 1970
        t = stamps - self.origin + self._offset
        for k in np.flatnonzero(steps <= 0.0):
            before = t[k - 1] if k else self._t
            more = float(before + LEAST_STEP - t[k])
            t[k:] += more
            self._offset += more
        return t

    def _counted(self, of: Series, modulus: int, period: float) -> Array:
        first = self._counter is None
        before = of.counter[0] if self._counter is None else self._counter
        ahead = np.mod(np.diff(of.counter, prepend=before), modulus)
        anew = (ahead > modulus // 4) | (ahead == 0)
        if first:
            ahead[0], anew[0] = of.counter[0], False
        stamps = np.diff(of.t, prepend=self._stamp)
        self._counter, self._stamp = int(of.counter[-1]), float(of.t[-1])
        # Counts are whole numbers: their sum has no rounding that depends on where it began.
        total = self._total + np.cumsum(np.where(anew, 0, ahead))
        self._total = int(total[-1])
        t = total * (period / self.step) + self._offset
        for k in np.flatnonzero(anew):
            self.restarted += 1
            # How many samples were lost nobody knows; the stamps say how long it took.
            waited = float(stamps[k]) if stamps[k] > 2.0 * period else 2.0 * period
            t[k:] += waited
            self._offset += waited
        return t
