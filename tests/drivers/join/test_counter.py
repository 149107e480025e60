# SPDX-License-Identifier: Apache-2.0
"""Pairing by counter: whatever is lost, doubled or exchanged, no sample is mixed or miscounted."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from comcal_drivers.join.sample import LOST, RESYNC

N = 40


@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data(), stamps=st.booleans())
def test_losses_are_counted_exactly_and_nothing_is_mixed(
    speakers: Any, data: st.DataObject, stamps: bool
) -> None:
    speaker = speakers["jr3_uc3m"]
    frames = speaker.send(N)
    lost = data.draw(st.sets(st.integers(0, 2 * N - 1), max_size=30))
    doubled = data.draw(st.sets(st.integers(0, 2 * N - 1), max_size=10)) - lost
    order = sorted(
        [k for k in range(2 * N) if k not in lost] + sorted(doubled),
        key=lambda k: k + data.draw(st.floats(0.0, 6.0)),
    )
    samples, counts = speaker.join([frames[k] for k in order], stamps=stamps)
    found = speaker.found(samples)
    whole = [s for s in range(N) if not {2 * s, 2 * s + 1} & lost]
    # A sample before the first number that is seen cannot be waited for.
    first = min(frames[order[0]].sample if order else 0, *(whole or [0]))
    assert found == [s for s in whole if s >= found[0]] if found else True
    assert set(whole) - set(found) <= set(range(first, first + 4))
    if found:
        halves = [k // 2 for k in order if k // 2 > found[-1]]
        span = max(halves, default=found[-1]) - found[0] + 1
        assert counts.samples + counts.lost == span
    assert counts.duplicated >= len({k for k in doubled if k // 2 in found})
    for after, flags in zip(found[1:], samples.flags[1:], strict=True):
        assert bool(flags & LOST) == (after - 1 not in found)


@pytest.mark.parametrize("start", [65_530 - 10, 0])
def test_the_counter_goes_round_without_a_gap(speakers: Any, start: int) -> None:
    speaker = speakers["jr3_uc3m"]
    frames = speaker.send(N)
    turned = [
        type(f)(f.id, f.data[:6] + ((f.sample + start) % 65_536).to_bytes(2, "little"), f.t, 0, 0)
        for f in frames
    ]
    samples, counts = speaker.join(turned)
    assert speaker.found(samples) == list(range(N))
    assert (counts.lost, counts.resyncs) == (0, 0)
    np.testing.assert_array_equal(samples.counter, (np.arange(N) + start) % 65_536)


def test_a_long_gap_is_counted(speakers: Any) -> None:
    speaker = speakers["jr3_uc3m"]
    frames = [*speaker.send(5), *speaker.send(5, first=2005)]
    samples, counts = speaker.join(frames)
    assert counts.lost == 2000
    assert counts.resyncs == 0
    assert samples.flags[5] == LOST


@pytest.mark.parametrize("jump", [20_000, 40_000, 60_000])
def test_a_jump_is_a_new_beginning_of_which_no_number_is_invented(speakers: Any, jump: int) -> None:
    speaker = speakers["jr3_uc3m"]
    frames = speaker.send(20)
    jumped = [
        type(f)(f.id, f.data[:6] + ((f.sample + jump) % 65_536).to_bytes(2, "little"), f.t, 0, 0)
        for f in frames[20:]
    ]
    samples, counts = speaker.join([*frames[:20], *jumped])
    assert speaker.found(samples) == list(range(20))
    assert (counts.lost, counts.resyncs) == (0, 1)
    assert samples.flags[10] == LOST | RESYNC
    assert np.count_nonzero(samples.flags) == 1


def test_one_damaged_counter_costs_one_sample(speakers: Any) -> None:
    speaker = speakers["jr3_uc3m"]
    frames = speaker.send(20)
    f = frames[15]
    frames[15] = type(f)(f.id, f.data[:6] + b"\x00\x90", f.t, f.sample, f.part)
    samples, counts = speaker.join(frames)
    assert speaker.found(samples) == [k for k in range(20) if k != 7]
    assert (counts.lost, counts.orphaned, counts.resyncs) == (1, 2, 0)


def test_after_a_silence_of_a_whole_turn_counting_begins_anew(speakers: Any) -> None:
    """65,536 samples at 1 kHz are 65 s: the counter is where it was."""
    speaker = speakers["jr3_uc3m"]
    frames = speaker.send(20)
    later = [type(f)(f.id, f.data, f.t + 65.536, f.sample, f.part) for f in frames[20:]]
    _, blind = speaker.join([*frames[:20], *later])
    samples, counts = speaker.join([*frames[:20], *later], period=0.001)
    assert (blind.lost, blind.resyncs) == (0, 0)
    assert (counts.lost, counts.resyncs) == (0, 1)
    assert samples.flags[10] == LOST | RESYNC


def test_a_counter_of_whole_samples_tells_what_pairing_cannot(speakers: Any) -> None:
    """The Net F/T box numbers its samples; where the step is known, gaps are losses."""
    speaker = speakers["ati_netbox_short"]
    frames = [f for f in speaker.send(20) if f.sample != 9]
    _, blind = speaker.join(frames)
    samples, counts = speaker.join(frames, counter_step=1)
    assert blind.lost == 0
    assert counts.lost == 1
    assert samples.flags[9] == LOST
