# SPDX-License-Identifier: Apache-2.0
"""``comcal check --live``: print what a source sends, ending in one verdict."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from rich.console import Console

    from comcal.measure.channel_check import Channel
    from comcal.workflow.live_check import LiveCheck, LiveOrder

EXIT_UNUSABLE = 3
ROUNDING = 1e-12


def run_live_check(order: LiveOrder, *, as_json: bool) -> int:
    """Look at a source, print what it sends, and return the exit code.

    Parameters
    ----------
    order : LiveOrder
    as_json : bool
        Print JSON, and nothing else.
    """
    import json

    from comcal.report.console import make_console
    from comcal.workflow.live_check import check_live, live_as_json

    result = check_live(order)
    if as_json:
        click.echo(json.dumps(live_as_json(result), indent=2, allow_nan=False))
    else:
        _print(result, make_console())
    return 0 if result.is_usable else EXIT_UNUSABLE


def _print(result: LiveCheck, console: Console) -> None:
    import numpy as np

    from comcal.cli.check import print_finding
    from comcal.cli.grouped import losses_text, rates_text
    from comcal.cli.live_table import picture
    from comcal.report.console import print_table

    seen, status = result.observation, result.status
    facts = {
        "robot": result.robot.name,
        "source": f"{result.source} ({result.engine})",
        "read": f"{result.seconds:.1f} s at {result.rate:.0f} samples/s",
    }
    if status is not None:
        facts["rates"] = rates_text(status) or "none told"
        facts["lost"] = losses_text(status) or "nothing"
    if np.isfinite(seen.weight):
        part = 100.0 * (seen.force / seen.weight - 1.0)
        facts["load"] = f"{seen.force:.1f} N of {seen.weight:.1f} N ({part:+.1f} %), before tare"
    if seen.motions:
        m = seen.motions[0]
        facts["motion"] = f"{m.name}: sd {m.sd:.2g} {m.unit}, drift {m.drift:.2g} {m.unit}"
    print_table(console, list(facts.items()))
    console.print()
    header = ("channel", "mean", "sd", "per pose", "stated", "")
    print_table(console, [_row(channel) for channel in result.channels], header)
    if seen.footprint is not None:
        console.print()
        console.print(picture(seen.footprint))
    console.print()
    for finding in result.findings:
        print_finding(finding, console)
    usable = result.is_usable
    text = "the readings make sense" if usable else "not usable: mend the errors first"
    console.print(text, style="bold green" if usable else "bold red")


def _row(channel: Channel) -> tuple[str, ...]:
    from comcal.measure.channel_check import State

    if channel.state is State.SILENT:
        return channel.name, "-", "-", "-", "-", channel.state.value
    stated = f"{channel.stated:.2g}" if channel.stated > 0.0 else "-"
    return (
        channel.name,
        f"{channel.mean:.5g} {channel.unit}",
        _scatter(channel.sd),
        _scatter(channel.standard_error),
        stated,
        "" if channel.state is State.OK else channel.state.value,
    )


def _scatter(value: float) -> str:
    """Return a scatter; that of rounding is none."""
    return f"{value:.2g}" if value > ROUNDING else "0"
