# SPDX-License-Identifier: Apache-2.0
"""``comcal tare``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from comcal.measure.tare import Tare
    from comcal.workflow.tare import TareOutcome


@click.command("tare")
@click.argument("robot", metavar="ROBOT.yaml", type=click.Path(path_type=Path))
@click.option(
    "-s",
    "--session",
    "directory",
    required=True,
    type=click.Path(path_type=Path),
    help="Session folder: a new one, or one to which the tare belongs.",
)
@click.option("--source", required=True, metavar="NAME[:ARG]", help="What measures the robot.")
@click.option(
    "--sensor",
    "sensors",
    multiple=True,
    metavar="NAME",
    help="Tare this one only [default: all that are in the air]. Repeatable.",
)
@click.option(
    "--standing", default="", metavar="FOOT", help="The robot stands on FOOT [default: it hangs]."
)
@click.option(
    "--hanging/--bare",
    default=True,
    show_default="--hanging",
    help="Feet hang from their sensors, and their weight is given back; or nothing hangs there.",
)
@click.option(
    "--seconds",
    type=click.FloatRange(min=0.5, max=600),
    default=5.0,
    show_default=True,
    metavar="S",
    help="How long the readings are averaged.",
)
@click.option(
    "--timeout",
    type=click.FloatRange(min=0, min_open=True),
    default=60.0,
    show_default=True,
    metavar="S",
    help="How long to wait until the robot is still.",
)
@click.option(
    "--limit",
    type=click.FloatRange(min=0, min_open=True),
    metavar="N",
    help="Largest force that is believed to be an offset [default: 15 % of the robot's weight].",
)
@click.option("--again", is_flag=True, help="Replace older tares, which are kept in tare_history.")
@click.option(
    "--poses",
    "plan",
    type=click.Path(path_type=Path),
    help="Plan in which a simulated robot finds its pose [default: plan.csv beside ROBOT].",
)
@click.option("--seed", type=click.IntRange(min=0), help="Master seed of a simulated source.")
@click.option("--no-noise", is_flag=True, help="Simulated sources: the engine's own values.")
@click.option(
    "--effect",
    "effects",
    multiple=True,
    metavar="NAME@TARGET:KEY=VALUE,...",
    help="Effect hidden in a simulated robot, as in comcal record. Repeatable.",
)
@click.option("--json", "as_json", is_flag=True, help="Print the tares as JSON, nothing else.")
def tare_command(
    robot: Path,
    directory: Path,
    source: str,
    sensors: tuple[str, ...],
    standing: str,
    hanging: bool,
    seconds: float,
    timeout: float,
    limit: float | None,
    again: bool,
    plan: Path | None,
    seed: int | None,
    no_noise: bool,
    effects: tuple[str, ...],
    as_json: bool,
) -> None:
    """Measure what the force/torque sensors read while nothing loads them.

    Lift the robot until its feet hang free, let it come to rest, and type this; or lift one foot
    and name the other with --standing. What hangs below each sensor is known from the URDF and the
    direction of gravity (IMU, else the standing sole, else an upright base), and is given back. The
    tares stand in session.yaml; comcal solve subtracts them from every pose of the session.

    \b
    Example:
      comcal tare robot.yaml -s monday --source can
    """
    from comcal.robot.changes_text import parse_change
    from comcal.workflow.session_source import SourceOrder
    from comcal.workflow.tare import TareOrder, tare_session

    outcome = tare_session(
        TareOrder(
            robot_yaml=robot,
            source=SourceOrder(
                directory,
                source,
                seed,
                noise=not no_noise,
                changes=tuple(parse_change(text) for text in effects),
                argv=tuple(sys.argv[1:]),
            ),
            sensors=sensors,
            standing=standing,
            hanging=hanging,
            seconds=seconds,
            timeout=timeout,
            limit=limit,
            again=again,
            plan=plan,
        )
    )
    if as_json:
        _print_json(outcome)
    else:
        _print(outcome)


def _print_json(outcome: TareOutcome) -> None:
    import json

    tares = {
        tare.sensor: {
            "value": tare.value.tolist(),
            "sigma": tare.sigma.tolist(),
            "temperature": tare.temperature,
            "given_back": None if tare.hangs is None else tare.hangs.tolist(),
            "before": outcome.before[tare.sensor][0].tolist()
            if tare.sensor in outcome.before
            else None,
        }
        for tare in outcome.tares
    }
    data = {
        "format": "comcal-tare/1",
        "session": str(outcome.session.directory),
        "engine": outcome.engine,
        "poses": outcome.poses,
        "tares": tares,
    }
    click.echo(json.dumps(data, indent=2, allow_nan=False))


def _print(outcome: TareOutcome) -> None:
    from comcal.report.console import make_console, print_table

    console = make_console()
    header = ("sensor", "fx [N]", "fy", "fz", "tx [N m]", "ty", "tz")
    rows: list[tuple[str, ...]] = []
    for tare in outcome.tares:
        digits = ("{:.2f}",) * 3 + ("{:.3f}",) * 3
        rows.append((tare.sensor, *(d.format(x) for d, x in zip(digits, tare.value, strict=True))))
        rows.append(("  +-", *(d.format(x) for d, x in zip(digits, tare.sigma, strict=True))))
    print_table(console, rows, header)
    for tare in outcome.tares:
        for line in _remarks(tare, outcome):
            click.echo(line)
    if outcome.poses:
        click.echo(f"counts for all {outcome.poses} poses of the session")
    click.echo(f"stands in {outcome.session.session_yaml}")


def _remarks(tare: Tare, outcome: TareOutcome) -> list[str]:
    """Return what else is to be said of one sensor."""
    import numpy as np

    found: list[str] = []
    if tare.hangs is not None:
        weight = float(np.linalg.norm(tare.hangs[:3]))
        found.append(f"{tare.sensor}: {weight:.2f} N hung below the cut; up is by {tare.up}")
    if tare.temperature is not None:
        found.append(f"{tare.sensor}: at {tare.temperature:.1f} deg C")
    if tare.sensor in outcome.before:
        value, sigma = outcome.before[tare.sensor]
        change = tare.value - value
        sigmas = np.abs(change) / np.maximum(np.hypot(sigma, tare.sigma), 1e-12)
        force = float(np.linalg.norm(change[:3]))
        found.append(
            f"{tare.sensor}: changed by {force:.2f} N since the tare before "
            f"(at most {sigmas.max():.1f} sigma in a channel)"
        )
    return found
