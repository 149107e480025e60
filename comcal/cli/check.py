# SPDX-License-Identifier: Apache-2.0
"""``comcal check``: print what was understood of a robot, ending in one verdict."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from rich.console import Console

    from comcal.robot.findings import Finding
    from comcal.robot.model import Foot, Robot
    from comcal.workflow.check import CheckResult, Cut

EXIT_UNUSABLE = 3


@click.command("check")
@click.argument("robot", metavar="ROBOT.yaml", type=click.Path(path_type=Path))
@click.option("--live", is_flag=True, help="Open a source, read, and judge what it sends.")
@click.option(
    "--source",
    default="",
    metavar="NAME[:ARG]",
    help="With --live: which source [default: the one that ROBOT.yaml describes].",
)
@click.option(
    "--seconds",
    type=click.FloatRange(min=1, max=3600),
    default=5.0,
    show_default=True,
    metavar="S",
    help="With --live: how long to read.",
)
@click.option(
    "--support",
    default="double",
    show_default=True,
    metavar="FOOT",
    help="With --live: what the robot stands on: double, none or a foot.",
)
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON, and nothing else.")
def check_command(
    robot: Path, live: bool, source: str, seconds: float, support: str, as_json: bool
) -> int:
    """Say what comcal understands of ROBOT.yaml and its URDF, and what is wrong with them.

    Sensors with what hangs below their cuts, feet, motors, mass, sources, findings, and the physics
    engines that are installed. Nothing is opened or written. Exit code 0: usable, perhaps with
    warnings; 2: a file is missing or wrong; 3: the description cannot be right.

    With --live it says what a source sends instead: rate, losses, mean and scatter of every channel
    against what ROBOT.yaml states, channels that are dead or frozen, the load on the feet against
    the weight, units and signs, and whether the IMU reads gravity. Exit code 3: the readings cannot
    be right; 4: a device does not answer.

    \b
    Examples:
      comcal check robot.yaml
      comcal check robot.yaml --live --source can
    """
    if live:
        from comcal.cli.check_live import run_live_check
        from comcal.workflow.live_check import LiveOrder

        return run_live_check(LiveOrder(robot, source, seconds, support), as_json=as_json)
    if source:
        raise click.UsageError("--source needs --live")
    import json

    from comcal.report.console import make_console
    from comcal.workflow.check import Verdict, check_as_json, check_robot

    result = check_robot(robot)
    if as_json:
        click.echo(json.dumps(check_as_json(result), indent=2, allow_nan=False))
    else:
        _print(result, make_console())
    return EXIT_UNUSABLE if result.verdict is Verdict.NOT_USABLE else 0


def _print(result: CheckResult, console: Console) -> None:
    """Print the whole result."""
    from comcal.report.console import print_table

    robot = result.robot
    _print_facts(result, console)
    if result.cuts:
        console.print()
        header = ("sensor", "at joint", "its wrench is", "below its cut", "kg", "above the sole")
        print_table(console, [_cut_row(cut) for cut in result.cuts], header)
    if robot.feet:
        console.print()
        header = ("foot", "link", "measured by", "sole", "ankle")
        print_table(console, [_foot_row(robot, foot) for foot in robot.feet.values()], header)
    if result.sources:
        console.print()
        rows = [(name, line) for name, lines in result.sources.items() for line in lines]
        print_table(console, rows, ("source", "understood"))
    console.print()
    for finding in result.findings:
        print_finding(finding, console)
    _print_verdict(result, console)


def _print_facts(result: CheckResult, console: Console) -> None:
    """Print what is one line each: files, bodies, motors, IMU, limits, engines."""
    robot, tree = result.robot, result.robot.tree
    files = [path.name for path in (robot.yaml_path, robot.urdf_path) if path is not None]
    mass = "unknown mass" if result.total_mass is None else f"{result.total_mass:.3f} kg"
    facts = {
        "robot": f"{robot.name} ({', '.join(files)})",
        "body": f"{mass}, {len(tree.links)} links, {robot.base.value} base, "
        f"gravity {robot.gravity:g} m/s^2",
        "joints": f"{len(tree.joint_names)}: {', '.join(tree.joint_names)}",
        "motors": _motors(robot),
        "imu": f"on {robot.imu_link}" if robot.imu_link else "none",
        "limits": _limits(robot),
        "engines": "; ".join(
            f"{e.name} {e.version}" if e.version else f"{e.name} not installed ({e.remedy})"
            for e in result.engines
        ),
    }
    from comcal.report.console import print_table

    print_table(console, list(facts.items()))


def _motors(robot: Robot) -> str:
    """Return the torque per ampere of every motor, and the joints that have none."""
    if not robot.motors:
        return "none described, so currents cannot be used"
    per_ampere = ", ".join(
        f"{m.joint}={m.torque_constant * m.gear * m.sign:.4g}" for m in robot.motors.values()
    )
    without = [name for name in robot.tree.joint_names if name not in robot.motors]
    return f"{per_ampere} N m/A" + (f"; none for {', '.join(without)}" if without else "")


def _limits(robot: Robot) -> str:
    """Return the gate of the verdict of ``comcal solve``."""
    limits = robot.limits
    texts = [
        *([f"CoM error {limits.com_error * 1e3:g} mm"] if limits.com_error is not None else []),
        *([f"mass error {limits.mass_error:g} kg"] if limits.mass_error is not None else []),
    ]
    return ", ".join(texts) or "none set, so nothing can pass or fail"


def _cut_row(cut: Cut) -> tuple[str, ...]:
    """Return the row of one sensor."""
    mass = "unknown" if cut.mass is None else f"{cut.mass:.3f}"
    if cut.sensor.below is not None:
        mass += " (given)"
    height = "-" if cut.height is None else f"{cut.height * 1e3:.1f} mm"
    sense = cut.sensor.sense.value
    return cut.sensor.name, cut.sensor.joint, sense, ", ".join(cut.links), mass, height


def _foot_row(robot: Robot, foot: Foot) -> tuple[str, ...]:
    """Return the row of one foot."""
    plates = [f"plate {plate.name}" for plate in robot.plates.values() if foot.name in plate.feet]
    measured = ", ".join([*([foot.sensor] if foot.sensor else []), *plates]) or "nothing"
    if foot.sole is None:
        sole = "unknown"
    else:
        length, width = (foot.sole.max(axis=0) - foot.sole.min(axis=0)) * 1e3
        sole = f"{length:.0f} x {width:.0f} mm"
    return foot.name, foot.link, measured, sole, foot.ankle or "none"


def print_finding(finding: Finding, console: Console) -> None:
    """Print one finding on a line: level, where, what, measured against limit, what to do."""
    from rich.text import Text

    from comcal.robot.findings import Level

    word, style = {
        Level.ERROR: ("error", "bold red"),
        Level.WARNING: ("warning", "yellow"),
        Level.INFO: ("note", "dim"),
    }[finding.level]
    text = f"{finding.where}: {finding.what}" if finding.where else finding.what
    if finding.measured:
        limit = f", limit {finding.limit}" if finding.limit else ""
        text += f" ({finding.measured}{limit})"
    if finding.next_step:
        text += f"; {finding.next_step}"
    console.print(Text.assemble((f"{word}: ", style), text), soft_wrap=not console.is_terminal)


def _print_verdict(result: CheckResult, console: Console) -> None:
    """Print the last line."""
    from rich.text import Text

    from comcal.robot.findings import Level
    from comcal.workflow.check import Verdict

    errors, warnings = result.count(Level.ERROR), result.count(Level.WARNING)
    counts = f"{_plural(errors, 'error')}, {_plural(warnings, 'warning')}"
    usable = result.verdict is not Verdict.NOT_USABLE
    line = f"usable: {counts}" if usable else f"not usable: {counts}; mend the errors first"
    console.print(Text(line, style="bold green" if usable else "bold red"))


def _plural(n: int, word: str) -> str:
    return f"{n} {word}" if n == 1 else f"{n} {word}s"
