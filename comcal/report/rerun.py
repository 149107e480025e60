# SPDX-License-Identifier: Apache-2.0
"""What a repeated simulation says: errors of the model as given and as extended, and the gain."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from comcal.report.json_numbers import number

MM = 1e3
NO_PROOF = (
    "a smaller error alone does not prove the cause: a wrong one that is fitted to the same "
    "readings often gains as well"
)


@dataclass(frozen=True)
class RerunMeasure:
    """Error of one quantity over the poses, root mean square, with 95 % intervals over poses.

    Parameters
    ----------
    what, unit : str
        SI, or ``times noise``.
    given, extended : float
        Of the model as it was given, and as extended.
    given_interval, extended_interval : tuple of float
    noise : float
        What the errors of the readings alone make, tares and healthy tolerances left out.
    gain : float
        Share of the mean squared error that the extension removes; negative: it adds.
    interval : tuple of float
        Of the gain.
    poses : int
    """

    what: str
    unit: str
    given: float
    given_interval: tuple[float, float]
    extended: float
    extended_interval: tuple[float, float]
    noise: float
    gain: float
    interval: tuple[float, float]
    poses: int

    @property
    def is_real(self) -> bool:
        """Whether the interval of the gain lies above zero."""
        return self.interval[0] > 0.0


@dataclass(frozen=True)
class RerunGain:
    """A simulation at measured poses, with a model as given and as extended.

    Parameters
    ----------
    engine : str
        Name and version.
    poses : tuple of int
        Ids of the poses compared.
    whole : RerunMeasure
        All measures of a pose together, each in units of its noise.
    measures : tuple of RerunMeasure
        Total foot force, total foot moment, total CoM (line of gravity at its height), torques of
        joints that do not depend on how the feet share the load; those that were measured.
    angle_gap : float
        Largest difference between simulated and measured encoder readings [rad] or [m]: what it
        takes for two feet to stand flat.
    notes : tuple of str
    """

    engine: str
    poses: tuple[int, ...]
    whole: RerunMeasure
    measures: tuple[RerunMeasure, ...]
    angle_gap: float
    notes: tuple[str, ...] = ()

    @property
    def is_real(self) -> bool:
        """Whether the extension gains more than poses differ from one another."""
        return self.whole.is_real


def rerun_lines(gain: RerunGain) -> list[str]:
    """Return what a repeated simulation says, one sentence each, the verdict last but one.

    Parameters
    ----------
    gain : RerunGain
    """
    lines = [
        f"simulated again by {gain.engine} at {len(gain.poses)} measured poses, as the model was "
        f"given and as extended (encoders agree within {gain.angle_gap:.1e} rad)"
    ]
    lines += [_line(measure) for measure in gain.measures]
    low, high = gain.whole.interval
    percent = f"{100 * gain.whole.gain:.0f} % (95 %: {100 * low:.0f} to {100 * high:.0f} %)"
    if gain.is_real:
        lines.append(f"the simulation gains: {percent} of the mean squared error, all measures")
    else:
        lines.append(
            f"nothing is gained beyond what poses differ: {percent} of the mean squared error"
        )
    lines += [f"note: {note}" for note in gain.notes]
    return [*lines, NO_PROOF]


def rerun_json(gain: RerunGain) -> dict[str, Any]:
    """Return a repeated simulation as JSON-able data, in SI.

    Parameters
    ----------
    gain : RerunGain
    """
    return {
        "engine": gain.engine,
        "poses": list(gain.poses),
        "angle_gap": gain.angle_gap,
        "gain": _json(gain.whole),
        "measures": [_json(measure) for measure in gain.measures],
        "is_real": gain.is_real,
        "notes": list(gain.notes),
    }


def _line(measure: RerunMeasure) -> str:
    factor, unit = (MM, "mm") if measure.unit == "m" else (1.0, measure.unit)
    a, b = (f"{value * factor:.3g}" for value in (measure.given, measure.extended))
    (a0, a1), (b0, b1) = (
        (low * factor, high * factor)
        for low, high in (measure.given_interval, measure.extended_interval)
    )
    return (
        f"{measure.what} off by {a} {unit} rms ({a0:.3g} to {a1:.3g}) as given, {b} {unit} "
        f"({b0:.3g} to {b1:.3g}) as extended; noise alone {measure.noise * factor:.2g} {unit}"
    )


def _json(measure: RerunMeasure) -> dict[str, Any]:
    return {
        "what": measure.what,
        "unit": measure.unit,
        "given": {"rms": number(measure.given), "interval": list(measure.given_interval)},
        "extended": {"rms": number(measure.extended), "interval": list(measure.extended_interval)},
        "noise": number(measure.noise),
        "fraction": number(measure.gain),
        "interval": list(measure.interval),
        "poses": measure.poses,
    }
