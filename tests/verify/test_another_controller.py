"""A run whose commands somebody else gave: the states follow from them, the commands are not judged."""

from dataclasses import replace

import pytest
from ros2_ws.src.trunk_recording.test.mcap_files import ANEW, KEPT, copied

from trunk_evidence import judgement as verify_module
from trunk_evidence.judgement import DIVERGES, UNJUDGED, VERIFIED, verify
from trunk_recording.reader import Recording
from trunk_runs import nodes
from trunk_runs.engine import states_of_run
from trunk_runs.offline_recording import record_offline, record_states
from trunk_runs.plan import make_plan

from .messages import COMMAND, TRUTH, of, without
from .test_verify import flip_last_bit

PLAN = make_plan("fig8", "pid", everywhere={"duration": 0.5})
TERMS = "/stranger/state"


def by_a_stranger():
    for states in states_of_run(PLAN, compiled=False):
        acts = [(row, "stranger") for row, _ in states.acts]
        yield states._replace(acts=acts, term_names={"stranger": states.term_names["pid"]})


@pytest.fixture(scope="module")
def strangers(tmp_path_factory):
    path = tmp_path_factory.mktemp("strangers") / "run.mcap"
    record_states(replace(PLAN, controllers={}), by_a_stranger(), path, ("stranger",))
    return path


def test_the_states_follow_from_the_commands_on_the_record(strangers):
    verdict = verify(Recording.open(strangers))
    assert verdict.exit_code == VERIFIED, verdict.reasons
    assert [(part.name, part.steps) for part in verdict.checks] == [
        ("measured states", 501),
        ("states of the plant", 501),
        ("disturbances", 502),
    ]
    assert verdict.unjudged[0] == (
        "the commands and terms of stranger, another controller: the states follow from the commands"
    )


def test_another_command_leads_to_another_state(strangers, tmp_path):
    def edit(messages):
        flip_last_bit(of(messages, COMMAND)[100])

    verdict = verify(copied(strangers, tmp_path / "a.mcap", edit, digests=ANEW))
    assert verdict.exit_code == DIVERGES
    (difference, *_) = verdict.checks[1].first
    assert difference.stamp_ns == 101_000_000


def test_an_altered_state_diverges_whatever_its_digests(strangers, tmp_path):
    def edit(messages):
        flip_last_bit(of(messages, TRUTH)[100])

    for digests in (ANEW, KEPT):
        found = verify(copied(strangers, tmp_path / f"{digests}.mcap", edit, digests=digests))
        assert found.exit_code == DIVERGES


@pytest.mark.parametrize("topic", [COMMAND, TRUTH])
def test_a_run_that_lacks_a_message_is_never_verified(strangers, tmp_path, topic):
    less = without(slice(100, 101), topic)
    found = verify(copied(strangers, tmp_path / "less.mcap", less, digests=ANEW))
    assert found.exit_code != VERIFIED


def test_a_run_in_which_our_controller_is_known_is_not_a_strangers(tmp_path):
    """A controller whose parameters are on record is judged by them, whatever its terms are called."""
    ours = tmp_path / "ours.mcap"
    record_offline(PLAN, ours)
    record_states(PLAN, by_a_stranger(), tmp_path / "renamed.mcap", ("stranger",))
    verdict = verify(Recording.open(tmp_path / "renamed.mcap"))
    assert verdict.exit_code == UNJUDGED
    assert verdict.obstacles == ["stranger is not known here: install the package that has it"]
    assert verify(Recording.open(ours)).exit_code == VERIFIED


def test_a_law_that_is_not_installed_is_not_a_stranger(tmp_path, monkeypatch):
    """Its parameters are on record: with its package its commands can be judged."""
    record_offline(PLAN, tmp_path / "ours.mcap")
    for module in (nodes, verify_module):
        monkeypatch.setattr(module, "CONTROLLERS", ())
    verdict = verify(Recording.open(tmp_path / "ours.mcap"))
    assert verdict.exit_code == UNJUDGED
    assert not verdict.checks
