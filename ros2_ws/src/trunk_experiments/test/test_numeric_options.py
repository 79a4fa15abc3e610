"""Impossible numbers on the command line: refused when parsed, never a traceback."""

import click
import pytest
from click.testing import CliRunner

from trunk_core.errors import TrunkError
from trunk_experiments.cli import trunk
from trunk_experiments.console.options import FiniteRange, Number


def numeric_options(group, path):
    """Yield the words of each verb below a command, with its options that take a number."""
    context = click.Context(group)
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        if isinstance(command, click.Group):
            yield from numeric_options(command, (*path, name))
        for option in getattr(command, "params", ()):
            if isinstance(
                option.type, click.types.IntParamType | click.types.FloatParamType | Number
            ):
                yield (*path, name), option


ALL = list(numeric_options(trunk, ()))
BOUNDED = {"bench", "tune", "sweep", "map", "paper"}
OPTIONS = [(words, option) for words, option in ALL if BOUNDED & {*words}]


def test_there_are_such_options():
    assert len(OPTIONS) > 15


@pytest.mark.parametrize(
    ("words", "option"), OPTIONS, ids=[f"{' '.join(w)} {o.opts[0]}" for w, o in OPTIONS]
)
def test_a_number_has_both_ends_and_no_traceback(words, option):
    kind = option.type
    assert isinstance(kind, click.IntRange | FiniteRange)
    assert kind.min is not None
    assert kind.max is not None
    bad = ["nan", "inf", "-inf", "1e999", str(kind.min - 1), str(2 * kind.max + 1), "x", ""]
    for value in bad:
        done = CliRunner().invoke(trunk, [*words, f"{option.opts[0]}={value}"])
        assert done.exit_code == 2, (value, done.exception)
        assert f"Invalid value for '{option.opts[0]}'" in done.output


@pytest.mark.parametrize("text", ["1_0", "\u0661", "\uff11"])
def test_a_number_has_ascii_digits_alone(text):
    assert len(ALL) > 40
    for words, option in ALL:
        with pytest.raises(click.BadParameter):
            print(words, option.name, option.type.convert(text, option, None))


@pytest.mark.one_in(4)
@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "says"),
    [
        ("poles --pole=-1e6 --pole=-1", None),
        ("poles --rate=200 --pole=-1e-300 --pole=-1", None),
        ("poles --rate=200 --pole=-1 --pole=-1.0000000000001", None),
        ("poles --rate=200 --pole=-1 --pole=-2", None),
        ("poles --rate=0.001", "UNSTABLE"),
        ("lqr --rate=200 --torque=1e-6", None),
        ("lqr --torque=1e6", None),
        ("lqr --angle=1e-6 --integral=1e6 --speed=1e-6 --torque=1e6", None),
        ("lqr --angle=1e6 --integral=1e6 --speed=1e6 --torque=1e-6", None),
        ("relay --lag=1e-12 --damping=1", None),
        ("relay --lag=0.01 --damping=1e9", None),
        ("relay --lag=0.1 --damping=0.490500001", None),
        ("relay --lag=1000 --damping=1e9", None),
        ("relay --lag=0.01 --damping=1 --amplitude=1e6", None),
        ("relay --lag=0 --damping=1", "no ultimate gain"),
    ],
)
def test_extreme_gains_are_reported_or_refused(words, says):
    done = CliRunner().invoke(trunk, ["tune", *words.split()])
    told = f"{done.exception} {done.output}"
    assert done.exit_code == 0 or isinstance(done.exception, TrunkError), done.exception
    if done.exit_code:
        assert type(done.exception).__name__ in ("TuningError", "ParameterError", "PlanError")
    assert says is None or says in told
