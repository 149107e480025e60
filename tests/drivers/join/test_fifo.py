# SPDX-License-Identifier: Apache-2.0
"""Pairing in order: what it proves, and the one loss that it cannot see."""

from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np
import pytest

from comcal_drivers.join.sample import LOST, RESYNC

PERIOD = 0.01
N = 16
SETTLED = 5
"""Samples before the fault, so that it does not fall into the beginning of the stream."""


def without(frames: list[Any], *places: int) -> list[Any]:
    return [frame for k, frame in enumerate(frames) if k not in places]


def test_a_second_half_after_the_next_request_finds_its_first_half(speakers: Any) -> None:
    speaker = speakers["ati_netcanoem"]
    frames = speaker.send(N)
    for sample in range(2, N, 5):
        frames = speaker.moved(frames, 3 * sample + 2, 2)  # behind request and first half
    samples, counts = speaker.join(frames)
    assert speaker.found(samples) == list(range(N))
    assert (counts.lost, counts.orphaned, counts.resyncs) == (0, 0, 0)


@pytest.mark.parametrize("name", ["ati_netcanoem", "iit_strain"])
def test_second_halves_up_to_three_samples_late_are_paired(speakers: Any, name: str) -> None:
    speaker = speakers[name]
    frames = speaker.send(N)
    late = [f for f in frames if f.part == 1 and SETTLED <= f.sample <= SETTLED + 2]
    after = next(k for k, f in enumerate(frames) if f.sample == SETTLED + 3 and f.part == 0) + 1
    frames = [*(f for f in frames[:after] if f not in late), *late, *frames[after:]]
    samples, counts = speaker.join(frames, stamps=False)
    assert speaker.found(samples) == list(range(N))
    assert counts.orphaned == 0


def test_polled_no_two_losses_mix_samples(speakers: Any) -> None:
    speaker = speakers["ati_netcanoem"]
    frames = speaker.send(N)
    near = range(3 * SETTLED, 3 * (SETTLED + 3))
    for lost in combinations(near, 2):
        samples, counts = speaker.join(without(frames, *lost), stamps=False)
        found = speaker.found(samples)
        halves = {frames[k].sample for k in lost if frames[k].part >= 0}
        assert not halves & set(found)
        assert counts.lost + len(found) >= N - 1  # a whole sample with its request is not missed
        assert found[-4:] == list(range(N - 4, N))


def test_streamed_only_the_documented_two_losses_mix_samples(speakers: Any) -> None:
    speaker = speakers["iit_strain"]
    frames = speaker.send(N)
    near = range(2 * SETTLED, 2 * (SETTLED + 4))
    for lost in combinations(near, 2):
        # The last part of one sample, and the first of a later one.
        unseen = (frames[lost[0]].part, frames[lost[1]].part) == (1, 0)
        damaged = without(frames, *lost)
        if unseen:
            samples, counts = speaker.join(damaged, stamps=False)
            with pytest.raises(AssertionError, match="parts of different samples"):
                speaker.found(samples)
            assert counts.lost == 0
            samples, counts = speaker.join(damaged, timeout=PERIOD / 2)
            assert counts.lost > 0
        else:
            samples, _ = speaker.join(damaged, stamps=False)
        assert not {frames[k].sample for k in lost} & set(speaker.found(samples))


def test_halves_in_the_wrong_order_are_dropped_where_nobody_asked(speakers: Any) -> None:
    speaker = speakers["iit_strain"]
    frames = speaker.moved(speaker.send(N), 2 * SETTLED, 1)
    samples, counts = speaker.join(frames)
    assert set(range(N)) - set(speaker.found(samples)) >= {SETTLED}
    assert counts.resyncs == 1
    after = samples.flags[speaker.found(samples).index(SETTLED + 1)]
    assert after == LOST | RESYNC


def test_halves_in_the_wrong_order_answer_their_request(speakers: Any) -> None:
    speaker = speakers["ati_netcanoem"]
    frames = speaker.moved(speaker.send(N), 3 * SETTLED + 1, 1)
    samples, _ = speaker.join(frames)
    assert speaker.found(samples) == list(range(N))


def test_a_group_with_a_pause_inside_is_dropped(speakers: Any) -> None:
    speaker = speakers["iit_strain"]
    frames = speaker.send(N)
    later = [type(f)(f.id, f.data, f.t + 1.0, f.sample, f.part) for f in frames[2 * SETTLED + 1 :]]
    samples, counts = speaker.join([*frames[: 2 * SETTLED + 1], *later])
    assert SETTLED not in speaker.found(samples)
    assert counts.resyncs == 1


def test_a_step_of_the_clock_back_costs_at_most_the_sample_it_falls_into(speakers: Any) -> None:
    speaker = speakers["iit_strain"]
    frames = speaker.send(N)
    for at in (2 * SETTLED, 2 * SETTLED + 1):
        later = [type(f)(f.id, f.data, f.t - 100.0, f.sample, f.part) for f in frames[at:]]
        samples, _ = speaker.join([*frames[:at], *later])
        assert set(range(N)) - set(speaker.found(samples)) <= {SETTLED}


def test_a_stream_joined_in_the_middle_of_a_sample_begins_with_the_next(speakers: Any) -> None:
    speaker = speakers["iit_strain"]
    samples, counts = speaker.join(speaker.send(N)[1:])
    assert speaker.found(samples) == list(range(1, N))
    assert (counts.orphaned, counts.lost, counts.resyncs) == (1, 0, 0)
    assert not samples.flags.any()


def test_a_short_stream_without_requests_is_joined_at_its_end(speakers: Any) -> None:
    speaker = speakers["iit_strain"]
    samples, _ = speaker.join(speaker.send(2))
    assert speaker.found(samples) == [0, 1]


def test_requests_may_begin_and_cease_to_be_seen(speakers: Any) -> None:
    speaker = speakers["ati_netcanoem"]
    unseen, seen = speaker.send(N, requests=False), speaker.send(N, first=N)
    again = speaker.send(N, first=2 * N, requests=False)
    samples, counts = speaker.join([*unseen, *seen, *again])
    found = speaker.found(samples)
    assert found[: 2 * N - 1] == list(range(2 * N - 1))
    assert found[-4:] == list(range(3 * N - 4, 3 * N))
    assert counts.resyncs == 1
    assert counts.other == N


def test_nothing_is_kept_but_what_waits(speakers: Any) -> None:
    """First halves without any second one must not pile up."""
    speaker = speakers["iit_strain"]
    frames = [f for f in speaker.send(500) if f.part == 0]
    samples, counts = speaker.join(frames, range(0, 500, 7))
    assert not len(samples)
    assert counts.orphaned == 500


def test_the_extra_byte_becomes_the_status_of_its_part(speakers: Any) -> None:
    speaker = speakers["iit_strain"]
    frames = speaker.send(6)
    for at, byte in ((4, b"\x09"), (7, b"\x01")):
        f = frames[at]
        frames[at] = type(f)(f.id, f.data + byte, f.t, f.sample, f.part)
    samples, counts = speaker.join(frames)
    np.testing.assert_array_equal(samples.status, [0, 0, 0x09, 0x0100, 0, 0])
    assert counts.short == 0


def test_another_command_of_the_host_is_not_taken_for_a_request(speakers: Any) -> None:
    """Polls and the tare of the Net F/T box differ in one byte."""
    speaker = speakers["ati_netbox_short"]
    frames = speaker.send(N)
    poll = frames[3 * SETTLED]
    tare = type(poll)(poll.id, b"\4", poll.t, -1, -1)
    samples, counts = speaker.join(frames)
    with_tare, other = speaker.join([*frames[: 3 * SETTLED], tare, *frames[3 * SETTLED :]])
    assert speaker.found(with_tare) == speaker.found(samples) == list(range(N))
    assert other == counts


@pytest.mark.parametrize("ahead", [1.7e9, -1.7e9, 0.3])
def test_polls_may_be_stamped_by_another_clock(speakers: Any, ahead: float) -> None:
    """The host stamps what it sends; many adapters stamp by a clock that began with them."""
    speaker = speakers["ati_netcanoem"]
    frames = [
        type(f)(f.id, f.data, f.t + ahead * (f.part < 0), f.sample, f.part) for f in speaker.send(N)
    ]
    for cuts in ((), range(0, len(frames))):
        samples, counts = speaker.join(frames, cuts)
        assert speaker.found(samples) == list(range(N))
        assert (counts.lost, counts.resyncs) == (0, 0)


def test_answers_apart_are_dropped_whatever_clock_stamped_the_polls(speakers: Any) -> None:
    speaker = speakers["ati_netcanoem"]
    late = speaker.send(N)[3 * SETTLED + 2 :]
    frames = speaker.send(N)[: 3 * SETTLED + 2]
    frames += [type(f)(f.id, f.data, f.t + 1.0, f.sample, f.part) for f in late]
    frames = [type(f)(f.id, f.data, f.t + 1e9 * (f.part < 0), f.sample, f.part) for f in frames]
    for cuts in ((), range(0, len(frames))):
        samples, counts = speaker.join(frames, cuts)
        assert SETTLED not in speaker.found(samples)
        assert counts.resyncs == 1


def test_a_poll_alone_holds_nothing_back(speakers: Any) -> None:
    """Nothing was measured yet: what is measured by others does not wait for the answer."""
    speaker = speakers["ati_netcanoem"]
    joiner, frames = speaker.joiner(), speaker.send(2)
    oldest = []
    for k, frame in enumerate(frames[:5]):
        batch = speaker.packed([frame])
        joiner.feed(speaker.decoded(batch), batch, k)
        oldest.append(joiner.oldest)
    assert [None if each is None else each[0] for each in oldest] == [None, 1, 1, None, 4]
    assert oldest[1] == (1, pytest.approx(frames[1].t, abs=1e-9))
