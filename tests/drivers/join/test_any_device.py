# SPDX-License-Identifier: Apache-2.0
"""What holds for every way of joining: cuts do not matter, every frame is accounted for."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from comcal_drivers.join.sample import Counts, Samples

DEVICES = (
    "ati_netcanoem", "ati_netbox_short", "ati_netbox_long", "iit_strain", "jr3_uc3m",
    "sunrise_m8123", "robotous_rft", "optoforce",
)  # fmt: skip
FAULT = st.tuples(
    st.sampled_from(["drop", "duplicate", "late", "short"]),
    st.integers(0, 400),
    st.integers(1, 6),
)


def damaged(speaker: Any, frames: list[Any], faults: list[tuple[str, int, int]]) -> list[Any]:
    """Return the frames with faults put in, one after the other."""
    for kind, place, much in faults:
        at = place % len(frames)
        if kind == "drop":
            frames = frames[:at] + frames[at + 1 :]
        elif kind == "duplicate":
            frames = [*frames[: at + 1], frames[at], *frames[at + 1 :]]
        elif kind == "late":
            frames = speaker.moved(frames, at, much)
        elif frames[at].part >= 0:
            frames = speaker.cut_short(frames, at)
    return frames


def same(a: tuple[Samples, Counts], b: tuple[Samples, Counts]) -> bool:
    arrays = all(
        np.array_equal(getattr(a[0], name), getattr(b[0], name), equal_nan=name in ("t", "values"))
        for name in ("t", "counter", "last_row", "values", "status", "flags")
    )
    return arrays and a[1] == b[1]


@pytest.mark.parametrize("name", DEVICES)
def test_a_clean_stream_gives_every_sample_in_order(speakers: Any, name: str) -> None:
    speaker = speakers[name]
    frames = speaker.send(50)
    samples, counts = speaker.join(frames)
    assert speaker.found(samples) == list(range(50))
    assert (counts.lost, counts.orphaned, counts.duplicated, counts.short) == (0, 0, 0, 0)
    assert not samples.flags.any()
    first = [f for f in frames if f.part == 0]
    last = [k for k, f in enumerate(frames) if f.part == speaker.parts - 1]
    np.testing.assert_array_equal(samples.t, [f.t for f in first])
    np.testing.assert_array_equal(samples.last_row, last)


@pytest.mark.parametrize("name", DEVICES)
@settings(max_examples=12, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    faults=st.lists(FAULT, max_size=8),
    cuts=st.lists(st.integers(1, 120), max_size=30),
    stamps=st.booleans(),
)
def test_how_the_stream_is_cut_does_not_matter(
    speakers: Any, name: str, faults: list[tuple[str, int, int]], cuts: list[int], stamps: bool
) -> None:
    speaker = speakers[name]
    frames = damaged(speaker, speaker.send(30), faults)
    whole = speaker.join(frames, stamps=stamps)
    assert same(whole, speaker.join(frames, cuts, stamps=stamps))
    assert same(whole, speaker.join(frames, range(len(frames)), stamps=stamps))


@pytest.mark.parametrize("name", DEVICES)
@pytest.mark.parametrize("kind", ["drop", "duplicate", "short"])
@pytest.mark.parametrize("stamps", [True, False])
def test_one_fault_anywhere_mixes_nothing_and_is_reported(
    speakers: Any, name: str, kind: str, stamps: bool
) -> None:
    """Except where the fault cannot matter: a request that nobody answers twice, for instance."""
    speaker = speakers[name]
    clean = speaker.send(12)
    period = len(clean) // 12
    for at in range(4 * period, 5 * period):
        if kind == "short" and clean[at].part < 0:
            continue
        frames = damaged(speaker, clean, [(kind, at, 1)])
        samples, counts = speaker.join(frames, stamps=stamps)
        found = speaker.found(samples)
        assert found == sorted(set(found))
        told = counts.lost + counts.orphaned + counts.duplicated + counts.short + counts.resyncs
        assert told > 0
        missing = set(range(12)) - set(found)
        assert counts.lost >= len(missing - {11}) or kind == "duplicate"
        # A mark stands on the first sample after every gap that ends.
        for before, (after, flags) in zip(
            found[:-1], zip(found[1:], samples.flags[1:], strict=True), strict=True
        ):
            assert after == before + 1 or flags
