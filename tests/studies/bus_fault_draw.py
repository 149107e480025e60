# SPDX-License-Identifier: Apache-2.0
"""What goes wrong in a scenario, drawn from its seed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from zlib import crc32

import numpy as np
from bus_fault_robot import DRIVES, ORDER_ONLY, POSES, SENSORS

PATHS = ("slcan", "socketcand", "virtual", "replay")
FRAMES = ("drop", "duplicate", "reorder", "swap_halves", "dlc")
"""Kinds that strike single frames."""
SAMPLES = ("saturate", "status", "counter_wrap", "counter_jump")
"""Kinds that strike what the device says."""
OUTAGES = ("silence", "disconnect", "bus_off")
"""Kinds after which nothing comes for a while."""
FULL_DISK, KILL = "full_disk", "kill"
KINDS = (*FRAMES, *SAMPLES, "clock_step", *OUTAGES, FULL_DISK, KILL)

SAMPLES_OF_A_POSE = 60
"""At least so many samples of a pose are read before it is accepted."""
DEVICE_OF: Mapping[str, str] = {
    "jr3": "jr3_uc3m",
    "iit": "iit_strain",
    "ati": "ati_netcanoem",
    "rft": "robotous_rft",
    "maxon": "maxon_epos",
    "odrive": "odrive_cansimple",
}
_ABLE: Mapping[str, tuple[str, ...]] = {
    "swap_halves": ("jr3", "iit", "ati", "rft", "odrive"),
    "status": ("iit", "ati", "rft", "maxon"),
    "counter_wrap": ("jr3",),
    "counter_jump": ("jr3",),
    "saturate": ("jr3", "iit", "ati", "rft"),
}
"""Devices that can have a kind of fault; where it is not named, all can."""


@dataclass(frozen=True)
class Scenario:
    """One recording in which something goes wrong.

    Parameters
    ----------
    kind, path : str
    index : int
        Its number among those of this kind and path.
    seed : int
        Of everything else that is drawn while it runs.
    variant : str
        Key of ``SENSORS``.
    asked : bool
        Whether the host starts and polls the devices.
    faults : tuple of str
        As ``--fault`` of the emulator.
    device, device_kind : str
        Who is struck, and what it is; empty where all are.
    rate : float
        Of the emulator.
    number : float
        What the kind needs besides: bytes that the disk takes, share of the recording after which
        the program is killed, seconds by which the clock jumps.
    """

    kind: str
    path: str
    index: int
    seed: int
    variant: str
    asked: bool = False
    faults: tuple[str, ...] = ()
    device: str = ""
    device_kind: str = ""
    rate: float = 0.0
    number: float = 0.0


def draw(kind: str, path: str, index: int, master: int) -> Scenario:
    """Return a scenario.

    Parameters
    ----------
    kind : str
        One of :data:`KINDS`.
    path : str
        One of :data:`PATHS`.
    index, master : int
    """
    key = [master, crc32(kind.encode()), crc32(path.encode()), index]
    rng = np.random.default_rng(np.random.SeedSequence(key))
    seed = int(rng.integers(1 << 31))
    able = _ABLE.get(kind, tuple(DEVICE_OF))
    of_a_sensor = {name: feet(name) for name in SENSORS}
    wanted = str(rng.choice(able))
    is_of_the_bus = kind not in (*FRAMES, *SAMPLES, "silence")
    if is_of_the_bus or (kind == "silence" and rng.random() < 0.5):
        wanted = ""
    fits = [
        name for name, on in of_a_sensor.items() if not wanted or wanted in (*on, "maxon", "odrive")
    ]
    variant = str(rng.choice(fits))
    device = _device(wanted, of_a_sensor[variant], rng) if wanted else ""
    # What answers the host is not struck; and answers are no clock where time is not paced.
    polls = of_a_sensor[variant] == ("jr3", "ati") and wanted not in ("ati", "maxon")
    asked = path != "replay" and polls and rng.random() < 0.5
    faults: tuple[str, ...] = ()
    number = 0.0
    if kind == FULL_DISK:
        number = float(np.exp(rng.uniform(np.log(300), np.log(1.5e5 if path != "replay" else 3e4))))
    elif kind == KILL:
        number = float(rng.random())
    elif kind == "clock_step" and path == "slcan":
        number = float(rng.choice([-1, 1]) * 10 ** rng.uniform(-1.3, 3))
    else:
        faults = (_fault(kind, device, wanted, seed, rng),)
    # A serial line has the host's stamps only. Where these tell how long a sample took, or are all
    # that betrays a loss, they have to be those of real time.
    is_blind = DEVICE_OF.get(wanted) in ORDER_ONLY and kind in FRAMES
    has_counted_time = feet(variant)[0] == "jr3"
    rate = 1.0 if path == "slcan" and (is_blind or not has_counted_time) else 0.0
    return Scenario(
        kind, path, index, seed, variant, asked, faults, device, DEVICE_OF.get(wanted, ""),
        rate, number,
    )  # fmt: skip


def feet(variant: str) -> tuple[str, str]:
    """Return the short names of the devices in the left and the right foot."""
    left, _, right = variant.partition("+")
    return left, right


def _device(wanted: str, on: tuple[str, str], rng: np.random.Generator) -> str:
    if wanted in on:
        return ("l_foot", "r_foot")[on.index(wanted)]
    return str(rng.choice([joint for joint, kind in DRIVES.items() if kind == wanted]))


def _fault(kind: str, device: str, wanted: str, seed: int, rng: np.random.Generator) -> str:
    """Return the words that tell the emulator what to do."""
    words = [f"device={device}"] if device else []
    words += [f"seed={seed}", f"pose={int(rng.integers(1, POSES))}"]
    at = f"at={int(rng.integers(2, SAMPLES_OF_A_POSE))}"
    if kind in (*OUTAGES, "clock_step", "counter_wrap", "counter_jump") or rng.random() < 0.4:
        words += [at, "times=1"]
    else:
        words += [f"probability={10 ** rng.uniform(-1.7, -0.5):.4f}"]
        words += [f"times={int(rng.integers(1, 40))}"]
    if kind == "reorder":
        words.append(f"by={int(rng.integers(1, 40))}")
    elif kind == "dlc" and rng.random() < 0.7:
        words.append(f"length={int(rng.integers(0, 6))}")
    elif kind == "saturate":
        words.append(f"low={int(rng.integers(2))}")
    elif kind == "status" and wanted == "maxon":
        words.append("bit=3")
    elif kind == "counter_jump":
        far = rng.random() < 0.5
        by = int(rng.integers(20000, 60000)) if far else int(rng.integers(2, 3000))
        words.append(f"by={by}")
    elif kind == "counter_wrap":
        words.append(f"before={int(rng.integers(0, 40))}")
    elif kind == "clock_step":
        # The robot's clock starts at zero, and no clock goes below that.
        back = rng.random() < 0.5
        words[-3:-2] = ["pose=2"] if back else words[-3:-2]
        words.append(f"by={-rng.uniform(0.04, 0.45) if back else 10 ** rng.uniform(-1.3, 3):.4f}")
    elif kind in OUTAGES:
        words.append(f"duration={rng.uniform(0.05, 1.2):.3f}")
    return f"{kind}:{','.join(words)}"
