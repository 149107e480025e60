# SPDX-License-Identifier: Apache-2.0
"""Samples longer than a frame: split values, headers, checksums."""

from __future__ import annotations

from itertools import combinations
from typing import Any

from comcal_drivers.join.sample import LOST

N = 9


def test_no_two_losses_mix_packets_with_a_checksum(speakers: Any) -> None:
    speaker = speakers["optoforce"]
    frames = speaker.send(N)
    for lost in combinations(range(2 * N), 2):
        rest = [f for k, f in enumerate(frames) if k not in lost]
        samples, counts = speaker.join(rest, stamps=False)
        found = speaker.found(samples)
        assert found == [s for s in range(N) if not {2 * s, 2 * s + 1} & set(lost)]
        for before, after, flags in zip(found[:-1], found[1:], samples.flags[1:], strict=True):
            gone = {2 * s + k for s in range(before + 1, after) for k in (0, 1)}
            seen = not gone <= set(lost)  # of a packet that is lost whole nothing is left to see
            assert bool(flags & LOST) == (bool(gone) and seen)
        assert counts.orphaned + counts.short == 2 * (N - len(found)) - 2


def test_a_wrong_checksum_is_counted_as_damage(speakers: Any) -> None:
    speaker = speakers["optoforce"]
    frames = speaker.send(N)
    f = frames[9]
    frames[9] = type(f)(f.id, f.data[:2] + b"\x55" + f.data[3:], f.t, f.sample, f.part)
    samples, counts = speaker.join(frames)
    assert speaker.found(samples) == [k for k in range(N) if k != 4]
    assert (counts.short, counts.lost) == (2, 1)
    assert samples.flags[4] == LOST


def test_an_answer_to_a_command_is_not_a_sample_and_not_a_loss(speakers: Any) -> None:
    """The RFT answers with the identifiers of its data; the first byte repeats the command."""
    speaker = speakers["robotous_rft"]
    frames = speaker.send(N)
    answer = [
        type(f)(f.id, (b"\x11" if f.part == 0 else b"\0") + f.data[1:], f.t, f.sample, f.part)
        for f in frames[8:10]
    ]
    samples, counts = speaker.join([*frames[:10], *answer, *frames[10:]])
    assert speaker.found(samples) == list(range(N))
    assert (counts.other, counts.lost, counts.orphaned) == (2, 0, 0)
    assert not samples.flags.any()
