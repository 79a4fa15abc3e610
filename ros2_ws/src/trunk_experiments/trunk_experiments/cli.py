"""The ``trunk`` command: loads, computes a pure result, renders it; problems set the exit code."""

from __future__ import annotations

import sys
from contextlib import suppress
from importlib import import_module
from signal import SIGINT
from typing import TextIO, cast

import click

from trunk_msgs_util.errors import EXIT_UNREAD, EXIT_USAGE, TrunkError
from trunk_msgs_util.text import PrintableStream

from .console.document import ERROR, documents_alone, json_asked, write_json
from .console.mistakes import line_of, say, tell
from .errors import PlanError, tell_warnings_plainly
from .suggestions import did_you_mean

# Verb: its module in `commands`, and one line for the overview (which thus imports nothing).
_VERBS = {
    "run": ("run", "Run a scenario in the ROS 2 graph and record it."),
    "simulate": ("simulate", "Run a scenario without ROS, with the same functions."),
    "live": ("live", "Run in a browser: push the trunk, tune and swap its controller."),
    "watch": ("watch", "Play a recording in a browser."),
    "branch": ("branch", "Branch a recorded run: what if something changed at a given time?"),
    "plan": ("plan", "Write a run's parameter file, to start its nodes elsewhere."),
    "metrics": ("metrics", "Print a recorded run's metrics."),
    "report": ("report", "Write recorded runs as one HTML page."),
    "compare": ("compare", "Compare recorded runs side by side."),
    "explain": ("explain", "Explain why a run had this torque at this instant."),
    "plot": ("plot", "Draw recorded runs as PNG, SVG or PDF."),
    "diff": ("diff", "Find where two recorded runs diverge, bit by bit."),
    "verify": ("verify", "Recompute a recorded run from its own data."),
    "sign": ("sign", "Sign a recording's content with your key; make a key."),
    "info": ("info", "Show what is in a recording."),
    "list": ("list", "List recorded runs, scenarios, files, studies, controllers."),
    "doctor": ("doctor", "Report what is wrong with a recording, and where."),
    "recover": ("recover", "Write a valid file from a broken one."),
    "export": ("export", "Write a recorded run as CSV, Parquet, npz or a smaller MCAP."),
    "params": ("params", "List the nodes' parameters; change those of a running node."),
    "new": ("new", "Make a package for a controller of your own."),
    "check": ("check", "Check that a controller does what every controller must."),
    "sweep": ("sweep", "Run a study: grids and draws over any parameter, compiled."),
    "paper": ("paper", "Reproduce the paper's figures and judge its claims."),
    "limit": ("limit", "Find the greatest push, delay, mass … that a controller stands."),
    "margins": ("margins", "How far gains are from instability, as numbers and a picture."),
    "tune": ("tune", "Compute gains and their margins; write the gains as a parameter file."),
    "fit": ("fit", "Compute parameters from measurements: the hip's path."),
    "study": (
        "study",
        "Read a sweep: report it, repeat one of its runs, find which parameter matters.",
    ),
    "map": ("map", "Draw a study's stability and performance over two parameters."),
    "bench": ("bench", "Measure speed as ratios, both sides in the same run."),
}

# Prefixes and suffixes of ROS 2's module names.
_ROS = ("rcl", "rosidl", "ament_", "launch"), ("_msgs", "_interfaces", "_srvs")


class _Lazy(click.Group):
    """A group that imports a verb's module only when it is called."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(_VERBS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in _VERBS:
            if ctx.resilient_parsing:  # shell completion
                return None
            raise PlanError(
                f"no verb {cmd_name!r}: trunk --help lists them all{did_you_mean(cmd_name, _VERBS)}"
            )
        module = import_module(f".commands.{_VERBS[cmd_name][0]}", __package__)
        command: click.Command = module.command
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl([(name, line) for name, (_, line) in _VERBS.items()])


def _tell_unusable() -> None:
    """Say which controllers of other packages cannot be used, if the verb knows controllers at all."""
    nodes = sys.modules.get(f"{__package__}.plans.nodes")
    for reason in nodes.UNUSABLE.values() if nodes else ():
        print(f"trunk: warning: {reason}; the other controllers can be used", file=sys.stderr)


def _print_version(context: click.Context, _: click.Parameter, wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version  # as slow as all other imports of --help together

        click.echo(f"trunk {version('trunk_experiments')}")
        context.exit()


@click.command(cls=_Lazy, context_settings={"help_option_names": ["-h", "--help"]})
@click.option(
    "--version",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_print_version,
    help="Show the version.",
)
def trunk() -> None:
    """Simulate, control, record and compare a biped's trunk."""


def main() -> None:
    """Run the command; a user's mistake is one line on stderr, never a traceback.

    No text from a file or a message can control the terminal (`printable`).
    """
    out, err = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = (cast(TextIO, PrintableStream(stream)) for stream in (out, err))
    tell_warnings_plainly()
    try:
        with documents_alone():
            sys.exit(_code())
    finally:
        _tell_unusable()
        sys.stdout, sys.stderr = out, err


def _code() -> int:
    """Run the verb; return the exit code. Errors are printed to stderr."""
    try:
        # What a verb passes to ctx.exit comes back as a value.
        code = trunk(prog_name="trunk", standalone_mode=False)
        return code if isinstance(code, int) else 0
    except click.exceptions.Exit as stop:
        return stop.exit_code
    except click.exceptions.NoArgsIsHelpError as error:
        error.show()
        return _failed("a command is missing", error.exit_code)
    except click.ClickException as error:
        return _failed(say(_usage_text(error)), error.exit_code)
    except (click.Abort, KeyboardInterrupt):
        print("interrupted", file=sys.stderr)
        return 128 + SIGINT
    except (
        BrokenPipeError
    ):  # of a result that is written to a pipe; streams.py has the standard streams
        return EXIT_UNREAD
    except (TrunkError, OSError) as error:
        return _failed(line_of(error), tell(error))
    except Exception as error:
        line = _fault_of_a_law(error) or _without_ros(error)
        if not line:
            raise
        return _failed(say(line), EXIT_USAGE)


def _without_ros(error: Exception) -> str:
    """Return what to do if a module of ROS 2 is missing, as when only the wheels are installed."""
    missing = (error.name or "").partition(".")[0] if isinstance(error, ModuleNotFoundError) else ""
    if not missing.startswith(_ROS[0]) and not missing.endswith(_ROS[1]):
        return ""
    return (
        f"this needs ROS 2 Jazzy ({missing} is not installed): in the project's sources, run "
        "scripts/bootstrap.sh, which gets ROS 2, then 'source scripts/env.sh'"
    )


def _fault_of_a_law(error: Exception) -> str:
    """Return what is wrong if another package's law raised the error; empty if none did or none is loaded."""
    if f"{__package__}.plans.nodes" not in sys.modules:
        return ""
    from .plans.law_faults import fault_of_a_law

    return fault_of_a_law(error)


def _failed(why: str, code: int) -> int:
    """Tell a program that asked for JSON why there is no result; return the exit code."""
    if json_asked():
        with suppress(OSError):  # stdout is closed, or the disk is full: the line is on stderr
            write_json(ERROR, {"error": why, "exit_code": code})
    return code


def _usage_text(error: click.ClickException) -> str:
    """Return click's message and where the verb's options are explained."""
    text = error.format_message().rstrip(".")
    if not isinstance(error, click.UsageError):
        return text
    if error.ctx is not None:
        words = error.ctx.command_path.split()[1:]  # the program may have been started by any name
    else:
        words = [word for word in sys.argv[1:2] if word in _VERBS]
    return f"{text} (see {' '.join(['trunk', *words, '--help'])})"
