"""What a careless user gives a verb: typos, swapped files, wrong units, and outputs in the wrong place.

A case is a word for what is wrong and arguments. ``{input}`` stands for the verb's input, ``{kept}`` for a
file that exists, with the suffix that the verb writes, ``{new}`` for one that does not.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple


class Case(NamedTuple):
    """Arguments with something wrong in them."""

    what: str
    arguments: tuple[str, ...]
    replaces_input: bool = False  # in place of the verb's inputs, else after them


def _typos() -> Iterator[Case]:
    for option in (
        *("--hepl", "--jsno", "--forse", "--otput", "--ouput=x", "--contoller=pid", "--parms=x"),
        *("--lock-step", "--lockstp", "--durations=1", "--duraton=1", "--setting=a=b", "--seeds=1"),
        *(
            "--verson",
            "-j",
            "-f",
            "-O",
            "-v",
            "-x",
            "--",
            "---",
            "--=",
            "--no-such",
            "-oo",
            "-ojson",
        ),
    ):
        if option != "--":
            yield Case("option", (option,))


_MISSING = (
    *("nosuch.mcap", "nosuch", "no/such/run.mcap", "run.mcpa", "a.mcap.gz", "a.mcap "),
    *("", " ", ".", "..", "/", "~", "~/a.mcap", "*.mcap", "a.mcap,b.mcap", "-", "/dev/null"),
    *("/dev/full", "/proc/self/mem", "/usr/../nosuch", "file:///a.mcap", "https://a.b/c.mcap"),
    *("a\nb.mcap", "\x1b[31m.mcap", "\u202e.mcap", "x" * 300, "fig10", "fig 6", "fig66", "Fig6"),
    *("demo.yaml", "delay", "robust", "pid", "fuzzypid", "fuzzy-pid", "simulator", "42", "nan"),
)
_SWAPPED = (
    *("page.html", "picture.png", "table.csv", "study.parquet", "params.yaml", "study.yaml"),
    *("empty.mcap", "text.mcap", "short.mcap", "picture.mcap", "yaml.mcap", "parquet.mcap"),
    *("folder", "hollow", "two", "loop", "dangling", "pipe.json", "key.pem", "bad.yaml"),
)


def _inputs() -> Iterator[Case]:
    for name in _MISSING:
        yield Case("missing input", (name,), True)
    for name in _SWAPPED:
        yield Case("another kind of input", (name,), True)
    for name in ("a.mcap", "fig6", "params.yaml", "surplus"):
        yield Case("one too many", (name, "surplus", "surplus"))


def _outputs() -> Iterator[Case]:
    for option in ("-o", "--output"):
        for place in (
            *("{input}", "{kept}", "a.mcap", "b.mcap", "params.yaml", "study.yaml", "folder", "."),
            *(
                "..",
                "/",
                "",
                " ",
                "no/such/folder/x",
                "/proc/x",
                "/dev/full",
                "x",
                "x.",
                ".x",
                "x.txt",
            ),
            *("x.mcap.bak", "x.MCAP2", "a.mcap/x", "dangling", "loop", "x" * 300 + ".mcap"),
        ):
            yield Case("output", (option, place))
        yield Case("output", (option,))
        yield Case("output", (option, "x.txt", "--force"))
        yield Case("output", (option, "{input}", "--force"))
        yield Case("output", (option, "folder", "--force"))


def _values() -> Iterator[Case]:
    for setting in (
        *("", "=", "a", "a=b", "pid", "pid.", "pid=", "pid.gains", "pid.gains.p", "pid.gains.p="),
        *("pid.gains.p=abc", "pid.gains.p=nan", "pid.gains.p=-1", "pid.gains.p=1e999"),
        *("pid.gains.p=4kg", "pid.gains.p=4 5", "pid.gains.p=[4]", "pid.gain.p=4", "pdi.gains.p=4"),
        *("lqr.gains.p=4", "simulator.initial.position=[0,30]", "simulator.initial.position=0.1"),
        *("simulator.initial.position=[0,45m]", "simulator.duration=-1", "simulator.duration=10kg"),
        *("simulator.update_rate=0", "simulator.update_rate=1e9", "simulator.nosuch=1"),
        *("simulator.hip.mode=flying", "fuzzy_pid.rules.kp=[B]", "fuzzy_pid.rules.kp=B S"),
        *("disturbance.pulse.channel=knee", "recorder.output=a.mcap", "fuzzy_pid.update_rate=1ms"),
    ):
        yield Case("setting", ("--set", setting))
    for option, value in (
        *(("--at", v) for v in ("", "now", "nan", "-1", "1e9", "1kg")),
        *(("--duration", v) for v in ("", "abc", "nan", "-1", "1e99", "inf", "5kg")),
        *(("--rate", v) for v in ("", "abc", "0", "-5", "nan", "1e99", "7m")),
        *(("--controller", v) for v in ("", "pdi", "PID", "fuzzypid", "fuzzy-pid", "a,b")),
        *(("--params", v) for v in ("", "nosuch.yaml", "a.mcap", "pid_as_printd", "bad.yaml")),
        *(("--swap-at", v) for v in ("", "3", "3:", ":pid", "3:pdi", "-1:pid", "nan:pid", "pid:3")),
        *(("--seed", v) for v in ("", "-1", "abc", "1.5")),
        *(("--workers", v) for v in ("", "-1", "many")),
        *(("--metric", v) for v in ("", "overshot", "IAE")),
        *(("--run", v) for v in ("", "-1", "abc")),
    ):
        yield Case("value", (option, value))


def cases() -> list[Case]:
    """Return all cases, each once."""
    found = [*_typos(), *_inputs(), *_outputs(), *_values()]
    return list(dict.fromkeys(found))
