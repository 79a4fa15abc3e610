"""Honest recordings of earlier versions, each named after the commit that made it: none is ever accused."""

from pathlib import Path

import pytest
from ros2_ws.src.trunk_recording.test.mcap_files import ANEW, copied

from trunk_evidence.judgement import UNJUDGED, verify
from trunk_recording import provenance
from trunk_recording.schemas import parameter_event, parse_parameter_event

ARCHIVE = {path.stem: path for path in Path(__file__).parent.glob("*.mcap")}
VERDICTS = {
    "70f945cc_external": "verified",
    "70f945cc_lock": "verified",
    "d192e8e1_branch": "verified",
    "d192e8e1_offline": "verified",
    # Its second process gave no command, for three seconds.
    "d192e8e1_restarted": "inconclusive",
    "d192e8e1_rt": "verified",
}


def test_every_recording_has_its_verdict():
    assert ARCHIVE.keys() == VERDICTS.keys()


@pytest.mark.parametrize("name", VERDICTS)
def test_it_ends_as_it_did(name, trunk, monkeypatch):
    monkeypatch.setattr(provenance, "_here", lambda: ("9.9", "abc"))
    code, out, err = trunk("verify", ARCHIVE[name])
    silent, sound = "SILENT: no command from fuzzy_pid was in force", VERDICTS[name] == "verified"
    assert f"{ARCHIVE[name]}: {VERDICTS[name]}\n" in out
    assert out.startswith(str(ARCHIVE[name]) if sound else silent)
    assert (code, err) == (0 if sound else UNJUDGED, "")
    commit = f"(commit {name.partition('_')[0]}"
    assert f"note: recorded by version 0.1.0 {commit}" in out
    assert "judged by version 9.9 (commit abc)\n" in out


@pytest.mark.parametrize("name", VERDICTS)
def test_an_examination_finds_nothing_wrong(name, trunk):
    code, out, _ = trunk("info", "--check", ARCHIVE[name])
    assert (code, "warning" in out or "error" in out) == (0, False), out


@pytest.mark.parametrize("name", VERDICTS)
def test_it_is_shown_without_a_word_on_its_recorder(name, trunk, tmp_path):
    code, out, err = trunk("report", ARCHIVE[name], "-o", tmp_path / "page.html")
    assert code == 0
    assert "recorder" not in out + err
    assert "recorder: recorded parameters" not in (tmp_path / "page.html").read_text()


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (
            lambda new: new.pop("gap.max_periods"),
            "run/parameters: the set of fuzzy_pid lacks gap.max_periods",
        ),
        (
            lambda new: new.update({"gap.was": 1}),
            "recorded parameters cannot be used: parameter 'gap.was'",
        ),
    ],
)
def test_other_parameters_than_this_versions_accuse_nobody(change, says, tmp_path):
    def edit(messages):
        for message in messages:
            if message[0] == "/run/parameters" and b"gap.max_periods" in message[2]:
                event = parse_parameter_event(message[2])
                new = dict(event.new)
                change(new)
                kinds = {name: "double array" for name, value in new.items() if value == ()}
                message[2] = parameter_event(event.stamp_ns, event.node, new, {}, kinds)

    verdict = verify(copied(ARCHIVE["d192e8e1_offline"], tmp_path / "run.mcap", edit, ANEW))
    assert verdict.exit_code == UNJUDGED
    assert verdict.obstacles[0].startswith(says)
