# SPDX-License-Identifier: Apache-2.0
"""The table of subcommands, and the click group that imports one when it is asked for.

A subcommand ends by returning its exit code (``None`` is 0) or by raising; it parses, calls one
workflow and prints.
"""

from __future__ import annotations

import difflib
import importlib
from dataclasses import dataclass

import click

VERBOSITY = "comcal.verbosity"
"""Key in ``click.Context.meta`` of how often ``-v`` was given."""


@dataclass(frozen=True)
class Subcommand:
    """Where a subcommand is found.

    Parameters
    ----------
    target : str
        ``module:attribute`` of the click command.
    summary : str
        The line about it in ``comcal --help``.
    saved : str
        What an interrupted run can truthfully add to ``interrupted``.
    """

    target: str
    summary: str
    saved: str = ""


SUBCOMMANDS: dict[str, Subcommand] = {
    "demo": Subcommand(
        "comcal.cli.demo:demo_command", "Calibrate a simulated biped from end to end."
    ),
    "generate": Subcommand(
        "comcal.cli.generate:generate_command", "Write a generated robot with its pose plan."
    ),
    "init": Subcommand("comcal.cli.init:init_command", "Write a commented robot.yaml from a URDF."),
    "check": Subcommand(
        "comcal.cli.check:check_command", "Say what comcal understands of a robot.yaml."
    ),
    "plan": Subcommand(
        "comcal.cli.plan:plan_command",
        "Choose balanced poses that tell most, and predict the accuracy they give.",
        saved="nothing was left behind",
    ),
    "record": Subcommand(
        "comcal.cli.record:record_command",
        "Measure the poses of a plan into a session folder.",
        saved="session saved; the same command goes on where it stopped",
    ),
    "tare": Subcommand(
        "comcal.cli.tare:tare_command",
        "Measure what unloaded force/torque sensors read.",
        saved="nothing was changed",
    ),
    "import": Subcommand(
        "comcal.cli.import_:import_command",
        "Make a session of a logger's CSV.",
        saved="nothing was left behind",
    ),
    "solve": Subcommand(
        "comcal.cli.solve:solve_command",
        "Total CoM and CoM of each link from a session, with intervals and a verdict.",
    ),
    "diagnose": Subcommand(
        "comcal.cli.diagnose:diagnose_command",
        "Say what the model gets wrong, name the cause, extend the model, measure the gain.",
    ),
    "report": Subcommand(
        "comcal.cli.report:report_command",
        "One page of a session's newest diagnosis and result; of several, side by side.",
    ),
    "verify": Subcommand(
        "comcal.cli.verify:verify_command",
        "Predict measured poses with a given URDF, nothing fitted: mm and a verdict.",
    ),
    "export": Subcommand(
        "comcal.cli.export:export_command",
        "Hand the calibrated robot back as URDF, YAML and C.",
    ),
    "compare": Subcommand(
        "comcal.cli.compare:compare_command", "Say what changed between two calibrations."
    ),
    "derive": Subcommand(
        "comcal.cli.derive:derive_command",
        "Formulas as text, LaTeX, Python and C, for the paper's chain or your own robot.",
    ),
    "study": Subcommand(
        "comcal.cli.study:study_command",
        "Calibrate simulated robots by the thousand and compare with the truth.",
        saved="finished calibrations are saved; the same command goes on where it stopped",
    ),
}
"""Every subcommand by name, in the order in which somebody meets them."""


class LazyGroup(click.Group):
    """A click group that imports a subcommand's module only when that subcommand is asked for."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of all subcommands, in the order of the table."""
        return list(SUBCOMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import the subcommand *cmd_name*; None when there is none."""
        if cmd_name not in SUBCOMMANDS:
            return None
        module, attribute = SUBCOMMANDS[cmd_name].target.split(":")
        command: click.Command = getattr(importlib.import_module(module), attribute)
        command.name = cmd_name
        if not any(option.name == "verbose" for option in command.params):
            command.params.append(_verbose_option())
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the subcommand, or name those that would have worked."""
        name = args[0]
        if name not in SUBCOMMANDS and not name.startswith("-") and not ctx.resilient_parsing:
            near = difflib.get_close_matches(name, SUBCOMMANDS, n=1)
            hint = f"did you mean '{near[0]}'?" if near else f"there are: {', '.join(SUBCOMMANDS)}"
            ctx.fail(f"no command '{name}'; {hint}")
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the table of subcommands without importing any of them."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, sub.summary) for name, sub in SUBCOMMANDS.items()])


def _verbose_option() -> click.Option:
    """Make the ``-v`` that is understood both before and after the subcommand's name."""

    def remember(ctx: click.Context, _: click.Parameter, value: int) -> None:
        # click shares `meta` between a context and its children.
        ctx.meta[VERBOSITY] = max(value, ctx.meta.get(VERBOSITY, 0))

    return click.Option(
        ["-v", "--verbose"],
        count=True,
        is_eager=True,
        expose_value=False,
        callback=remember,
        help="Say what caused an error; -vv: with the trace.",
    )


def _print_version(ctx: click.Context, _: click.Parameter, value: bool) -> None:
    if value and not ctx.resilient_parsing:
        import comcal

        click.echo(f"comcal {comcal.__version__}")
        ctx.exit()


cli = LazyGroup(
    name="comcal",
    help="""Calibrate the centre of mass of every link of a biped from force/torque data.

    \b
    Example:
      comcal demo
    """,
    epilog="Exit codes: 0 done, 1 a bug of comcal, 2 usage or configuration, 3 data unusable, "
    "4 hardware, 5 a limit is not met or a cause not decided, 6 an extra is missing, "
    "130 interrupted.",
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    params=[
        _verbose_option(),
        click.Option(
            ["--version"],
            is_flag=True,
            is_eager=True,
            expose_value=False,
            callback=_print_version,
            help="Print the version and leave.",
        ),
    ],
)
