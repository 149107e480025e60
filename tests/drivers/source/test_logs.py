# SPDX-License-Identifier: Apache-2.0
"""The logs of a session, written by the readers while the recorder begins the next one."""

from __future__ import annotations

import sys
import threading
from pathlib import Path

import numpy as np

from comcal_drivers.frames.batch import FrameBatch
from comcal_drivers.frames.batches import concatenate
from comcal_drivers.frames.logs import read_log
from comcal_drivers.source.logs import SessionLog

POSES, FRAMES = 40, 12_000


def frame(k: int) -> FrameBatch:
    one, data = np.ones(1, np.uint8), np.array([[k]], "<u8").view(np.uint8)
    return FrameBatch(np.array([1e-3 * k]), np.array([0x123], np.uint32), 8 * one, data, 0 * one)


def test_no_frame_is_lost_between_the_logs_of_two_poses(tmp_path: Path) -> None:
    log = SessionLog(tmp_path)
    log.begin("start")
    errors: list[Exception] = []
    is_over = threading.Event()

    def read_a_bus() -> None:
        try:
            for k in range(FRAMES):
                log.write(frame(k), "can0")
        except Exception as error:  # noqa: BLE001
            errors.append(error)
        finally:
            is_over.set()

    patience = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)  # threads take turns in the middle of everything
    reader = threading.Thread(target=read_a_bus)
    try:
        reader.start()
        begun = 0
        while not is_over.is_set() and begun < POSES:
            log.begin(f"pose_{begun:03d}")
            begun += 1
    finally:
        sys.setswitchinterval(patience)
        reader.join(30.0)
        log.close()
    assert not errors
    names = ["start", *(f"pose_{pose:03d}" for pose in range(begun))]
    parts = [concatenate(read_log(tmp_path / "can" / f"{name}.log")) for name in names]
    assert sum(len(part) > 0 for part in parts) > 1, "the reader did not write meanwhile"
    whole = concatenate(parts)
    assert whole.data.view("<u8").ravel().tolist() == list(range(FRAMES))
