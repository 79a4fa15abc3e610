"""The ``trunk`` command: loads, computes a pure result, renders it; problems set the exit code."""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from signal import SIGINT
from typing import TextIO, cast

import click

from trunk_core.errors import (
    EXIT_UNREAD,
    EXIT_USAGE,
    TrunkError,
    did_you_mean,
    show_warnings_plainly,
    unusable_setting,
)
from trunk_core.text import PrintableStream, shortened

from .console.document import ErrorResult, documents_alone, json_asked, write_json
from .console.terminal import (
    line_of,
    print_error,
    report_error,
    show_warnings,
)
from .console.verbs import LazyVerbs

# The verbs by family, each with one line for the overview (which thus imports nothing).
_FAMILIES = {
    "run": {
        "run": "Run a scenario in the ROS 2 graph and record it.",
        "simulate": "Run a scenario without ROS, with the same functions.",
        "live": "Run in a browser: push the trunk, tune, swap controllers.",
        "branch": "Branch a recorded run: what if something changed?",
        "plan": "Write a run's parameters, to start its nodes elsewhere.",
    },
    "look": {
        "list": "List runs, scenarios, studies, controllers, plants.",
        "info": "Show what is in a recording, and what is wrong with it.",
        "metrics": "Print a recorded run's metrics.",
        "compare": "Compare recorded runs side by side.",
        "explain": "Explain why a run had this torque at this instant.",
        "plot": "Draw recorded runs as PNG, SVG or PDF.",
        "report": "Write recorded runs as one HTML page; open it.",
        "export": "Write a run as CSV, Parquet, npz, MCAP, GIF, MP4.",
    },
    "trust": {
        "verify": "Recompute a recorded run from its own data.",
        "diff": "Find where two recorded runs diverge, bit by bit.",
        "recover": "Write a valid file from a broken one.",
    },
    "many runs": {
        "limit": "Find the greatest push or delay a controller withstands.",
        "sweep": "Run a study: grids and draws over any parameter.",
        "study": "Read a sweep: map, compare, report, repeat a run.",
        "paper": "Reproduce the paper's figures and judge its claims.",
    },
    "tools": {
        "params": "List the nodes' parameters; change a running node's.",
        "margins": "How far gains are from instability; Bode, Nyquist.",
        "tune": "Compute gains and their margins, as a parameter file.",
        "rules": "Read rules of MATLAB, Octave, fuzzylite; write them.",
        "controller": "Make a controller of your own, and check it.",
        "plant": "Make a plant of your own, and check it.",
        "export-c": "Write a controller as C, equal to the last bit.",
        "lab": "Write a scenario as a lab in one HTML file.",
    },
}
OVERVIEW = {verb: line for verbs in _FAMILIES.values() for verb, line in verbs.items()}
# Verbs of earlier versions, and what does their work now.
_GONE = {
    "bench": "python -m benchmarks, in a checkout",
    "doctor": "trunk info --check RUN",
    "export-web": "trunk lab SCENARIO",
    "fit": "python examples/fit_hip_path.py",
    "help": "trunk VERB --help",
    "import": "trunk rules read FILE",
    "sign": "ssh-keygen -Y sign -n trunk -f KEY RUN.mcap",
    "watch": "trunk report RUN --open",
}

_EXAMPLES = (
    "trunk simulate demo --controller fuzzy_pid -o run.mcap",
    "trunk verify run.mcap",
    "trunk report run.mcap",
)

# Prefixes and suffixes of ROS 2's module names.
_ROS = ("rcl", "rosidl", "ament_", "launch"), ("_msgs", "_interfaces", "_srvs")


class _Trunk(LazyVerbs):
    """All verbs, by family."""

    def unknown(self, ctx: click.Context, name: str) -> str:
        if name in self.gone:
            return super().unknown(ctx, name)
        meant = did_you_mean(name, self.list_commands(ctx))
        return f"no verb {name!r}: trunk lists them all{meant}"

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the families side by side with their verbs: an overview of one screen."""
        formatter.write("\n")
        for family, verbs in _FAMILIES.items():
            for verb, line in verbs.items():
                formatter.write(f"{family:9}  {verb:10}  {line}\n")
                family = ""
        formatter.write("\nFor a verb's options: trunk VERB --help. To begin with:\n")
        formatter.write("".join(f"  {example}\n" for example in _EXAMPLES))


def _warn_of_unusable() -> None:
    """Say which controllers of other packages cannot be used, if the verb knows controllers at all."""
    nodes = sys.modules.get("trunk_runs.nodes")
    unusable = nodes.UNUSABLE.values() if nodes else ()
    show_warnings(f"{reason}; the other controllers can be used" for reason in unusable)


def _print_version(context: click.Context, _: click.Parameter, wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version  # as slow as all other imports of --help together

        click.echo(f"trunk {version('trunk_experiments')}")
        context.exit()


@click.group(
    cls=_Trunk,
    package=f"{__package__}.commands",
    modules={"export-c": "export_c"},
    overview=OVERVIEW,
    gone=_GONE,
    options_metavar="[--version]",
    subcommand_metavar="VERB [ARGS]...",
    context_settings={"help_option_names": ["-h", "--help"]},
)
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
    show_warnings_plainly()
    # Figures are the same for every user, and are shown in no window.
    os.environ.update(MPLBACKEND="agg", MATPLOTLIBRC=os.devnull)
    os.environ.pop("SOURCE_DATE_EPOCH", None)  # they have no date
    try:
        with documents_alone():
            sys.exit(_code())
    finally:
        _warn_of_unusable()
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
        return _failed(print_error(_usage_text(error)), error.exit_code)
    except (click.Abort, KeyboardInterrupt):
        print("interrupted", file=sys.stderr)
        return 128 + SIGINT
    except (
        BrokenPipeError
    ):  # of a result that is written to a pipe; files.py has the standard streams
        return EXIT_UNREAD
    except (TrunkError, OSError) as error:
        return _failed(line_of(error), report_error(error))
    except Exception as error:
        line = (
            _fault_of_a_law(error)
            or _without_ros(error)
            or unusable_setting(error)
            or _no_text(error)
        )
        if not line:
            raise
        return _failed(print_error(line), EXIT_USAGE)


def _without_ros(error: Exception) -> str:
    """Return advice if a module of ROS 2 is missing, as when only the wheels are installed."""
    missing = (error.name or "").partition(".")[0] if isinstance(error, ModuleNotFoundError) else ""
    if not missing.startswith(_ROS[0]) and not missing.endswith(_ROS[1]):
        return ""
    return (
        f"this needs ROS 2 Jazzy ({missing} is not installed): in the project's sources, run "
        "scripts/bootstrap.sh, which gets ROS 2, then 'source scripts/env.sh'"
    )


def _fault_of_a_law(error: Exception) -> str:
    """Return the fault of another package's law that raised the error; empty if none did or is loaded."""
    if "trunk_runs.nodes" not in sys.modules:
        return ""
    from trunk_runs.nodes import fault_of_a_law

    return fault_of_a_law(error)


def _no_text(error: Exception) -> str:
    """Return advice if a library takes a file's name as text, and it is none."""
    if not isinstance(error, UnicodeEncodeError) or "surrogates" not in error.reason:
        return ""
    name = shortened(error.object, 200)
    return f"{name}: this name is not UTF-8, but a library needs that: give another"


def _failed(why: str, code: int) -> int:
    """Tell a program that asked for JSON why there is no result; return the exit code."""
    if json_asked():
        with suppress(OSError):  # stdout is closed, or the disk is full: the line is on stderr
            write_json(ErrorResult(why, code))
    return code


def _usage_text(error: click.ClickException) -> str:
    """Return click's message and where the verb's options are explained."""
    text = error.format_message().rstrip(".")
    if not isinstance(error, click.UsageError):
        return text
    # The program may have been started by any name.
    words = error.ctx.command_path.split()[1:] if error.ctx else ()
    return f"{text} (see {' '.join(['trunk', *words, '--help'])})"
