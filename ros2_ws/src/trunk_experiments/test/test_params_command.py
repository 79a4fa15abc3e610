"""``trunk params``: the listing, and what a file sets."""

import json

import pytest

from trunk_core.parameters.declarations import declarations
from trunk_experiments.console import tables
from trunk_runs.nodes import NODES
from trunk_runs.scenario import parse_setting, shipped_files


@pytest.fixture
def told(monkeypatch, trunk):
    def run(*words, width=None):
        if width is not None:
            monkeypatch.setattr(tables, "screen_width", lambda: width)
        return trunk("params", *words)

    return run


@pytest.mark.parametrize("width", [None, 80, 40])
@pytest.mark.parametrize("node", NODES)
def test_every_name_is_whole_and_valid_for_set(told, node, width):
    code, out, _ = told(node, width=width)
    assert code == 0
    words = {line.split()[0] for line in out.splitlines() if line.split()}
    for name in declarations(NODES[node].config):
        assert f"{node}.{name}" in words
        assert parse_setting(f"{node}.{name}=1").sections[0].values == {name: 1}


def test_a_line_has_default_unit_range_and_description(told):
    (line,) = (li for li in told("pid")[1].splitlines() if li.split()[:1] == ["pid.gains.p"])
    default, unit, rest = "60.0", "N m/rad", ">= 0 and <= 1e+09"
    assert line.index(default) < line.index(unit) < line.index(rest)
    assert line.endswith(declarations(NODES["pid"].config)["gains.p"].description)


def test_at_80_columns_no_line_is_longer_and_sentences_are_indented(told):
    lines = told(width=80)[1].splitlines()
    assert max(map(len, lines)) <= 80
    at = next(i for i, line in enumerate(lines) if line.startswith("  pid.gains.p "))
    assert lines[at].split() == [
        "pid.gains.p",
        "60.0",
        "N",
        "m/rad",
        *[">=", "0", "and", "<=", "1e+09"],
    ]
    assert lines[at + 1].startswith("      ")


def test_a_law_of_another_plant_is_not_listed(told):
    code, out, _ = told("--plant", "cart_pole")
    assert code == 0
    assert "pid (*" in out
    assert "computed_torque" not in out
    assert "computed_torque (*" in told()[1]
    words = ("computed_torque", "--plant")
    assert "it contains a model of the plant trunk" in told(*words, "cart_pole")[2]
    assert "an installed plant (trunk, cart_pole" in told(*words, "cartpole")[2]


def test_a_file_is_shown_with_its_path_and_rule_tables(told):
    code, out, err = told("show", "fuzzy_zhao_1993")
    assert (code, err) == (0, "")
    assert out.splitlines()[0] == str(shipped_files()["fuzzy_zhao_1993"])
    rows = out[out.index("rules.kd") :].splitlines()
    assert rows[1].split()[-7:] == ["NB", "NM", "NS", "ZO", "PS", "PM", "PB"]
    assert rows[3].split() == ["NM", *["B", "B", "S", "S", "S", "B", "B"]]


def test_a_scenario_is_shown_resolved(told):
    found = json.loads(told("show", "fig8", "--json")[1])
    names = [path.rpartition("/")[2] for path in found["files"]]
    assert names == ["profile_paper.yaml", "fig8.yaml"]
    values = {(one["nodes"], one["name"]): one for one in found["values"]}
    assert values["/**", "duration"]["value"] == 10.0
    assert values["/**/disturbance", "pulse.duration"]["unit"] == "s"
    assert "1000.0    Hz" in told("show", "fig8")[1]


def test_a_mistake_in_a_file_gets_a_warning(told, tmp_path):
    mine = tmp_path / "mine.yaml"
    mine.write_text("pid:\n  ros__parameters: {gains.p: -1.0}\n")
    code, out, err = told("show", mine)
    assert (code, "gains.p" in out) == (0, True)
    assert err == (
        f"trunk: warning: {mine}: pid: parameter 'gains.p': -1.0 is not allowed: "
        "double, >= 0 and <= 1e+09\n"
    )
    mine.write_text(
        "disturbance:\n  ros__parameters:\n"
        "    pulse: {channel: hip_effort, magnitude: 3 N, duration: 100ms}\n"
    )
    assert told("show", mine)[2] == ""
    mine.write_text("disturbance:\n  ros__parameters: {pulse.duration: 100 kg}\n")
    assert "it is a mass" in told("show", mine)[2]
    mine.write_text("pid:\n  ros__parameters: {gain.p: 1.0}\n")
    assert "did you mean 'gains.p'?" in told("show", mine)[2]


@pytest.mark.parametrize(
    ("words", "meant"),
    [(("show", "fuzzy_zhao"), "fuzzy_zhao_1993"), (("pdi",), "pid"), (("sho",), "show")],
)
def test_an_unknown_name_gives_one_line(told, words, meant):
    code, out, err = told(*words)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert err.endswith(f"; did you mean {meant!r}?\n")
