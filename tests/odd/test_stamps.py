"""Stamps that cannot be right, and messages in any order: what each verb says and measures."""

import json
import random
import struct
from pathlib import Path

import pytest
from ros2_ws.src.trunk_recording.test.mcap_files import NONE, content, write

from trunk_core import topics
from trunk_runs.offline_recording import record_offline
from trunk_runs.plan import make_plan

TRUTH = f"/{topics.GROUND_TRUTH}"
MS = 1_000_000


def restamped(source, path, stamp_of, order=None, log_of=lambda k, log: log):
    """Copy a run with other stamps of its true states, messages in another order, or other log times."""
    found = content(source)
    if order is not None:
        order(found.messages)
    for k, message in enumerate(found.of(TRUTH)):
        stamp = struct.unpack_from("<iI", message[2], 4)
        message[2] = message[2][:4] + struct.pack("<iI", *stamp_of(k, *stamp)) + message[2][12:]
        message[1] = log_of(k, message[1])
    write(found, path, NONE)
    return path


def at(ns):
    return divmod(ns, 1_000_000_000)


# Which stamp (s, ns) state k gets for the one that it has, and what is said of all of them.
FAR = "of 61: 1 far (up to"
STAMPS = {
    "doubled": (lambda k, s, ns: at((k - (k % 7 == 3)) * 5 * MS), "of 61: 9 doubled"),
    "backward": (lambda k, s, ns: at((k + (k == 20) * 9) * 5 * MS), "of 61: 1 doubled, 1 backward"),
    "far": (lambda k, s, ns: (s + 10**8 * (k == 60), ns), f"{FAR} 1e+08 s after"),
    "far amid": (
        lambda k, s, ns: (s + 10**6 * (k == 30), ns),
        "of 61: 1 backward, 1 far (up to 1e+06 s after the one before)",
    ),
    "a wide gap": (lambda k, s, ns: (s + 3 * (k > 30), ns), f"{FAR} 3 s after the one before)"),
    "the first at 0": (lambda k, s, ns: (s + 1_700_000_000 * (k > 0), ns), f"{FAR} 1.7e+09"),
    "too many nanoseconds": (
        lambda k, s, ns: (s - 1, ns + 1_000_000_000),
        "of 61: 61 with 1e9 nanoseconds or more",
    ),
    "one of too many": (
        lambda k, s, ns: (s - (k == 9), ns + 1_000_000_000 * (k == 9)),
        "of 61: 1 with 1e9 nanoseconds or more",
    ),
}
EQUAL = {"zero": (0, 0), "the wall clock": (1_700_000_000, 5)}
SHOWN = [
    ["info"],
    ["metrics"],
    ["verify"],
    ["explain", "--at", "0.1"],
    ["compare"],
    ["plot", "-o", "a.png"],
    ["report", "-o", "a.html"],
]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A run of 61 states, 5 ms apart."""
    path = tmp_path_factory.mktemp("odd") / "run.mcap"
    record_offline(make_plan("demo", "pid", everywhere={"duration": 0.3}), path)
    return path


def shown(trunk, verb, path, whole):
    words = [whole, path] if verb[0] == "compare" else [path]
    code, out, err = trunk(verb[0], *words, *verb[1:])
    page = Path("a.html")
    return code, out + err + (page.read_text() if page.exists() else "")


@pytest.mark.one_in(4)
@pytest.mark.parametrize("kind", STAMPS)
@pytest.mark.parametrize("verb", SHOWN, ids=lambda verb: verb[0])
def test_every_verb_says_which_stamps_cannot_be_right(
    tmp_path, monkeypatch, trunk, whole, verb, kind
):
    monkeypatch.chdir(tmp_path)
    stamp_of, says = STAMPS[kind]
    path = restamped(whole, tmp_path / "a.mcap", stamp_of)
    assert f"STAMPS: {TRUTH}: {says}" in shown(trunk, verb, path, whole)[1]


@pytest.mark.parametrize("stamp", EQUAL.values(), ids=EQUAL)
@pytest.mark.parametrize("verb", SHOWN, ids=lambda verb: verb[0])
def test_where_no_time_passes_nothing_is_measured(tmp_path, monkeypatch, trunk, whole, verb, stamp):
    monkeypatch.chdir(tmp_path)
    path = restamped(whole, tmp_path / "a.mcap", lambda *_: stamp)
    code, said = shown(trunk, verb, path, whole)
    if verb[0] in ("info", "verify", "metrics", "explain"):
        assert f"STAMPS: {TRUTH}: all 61 have t = " in said
    if verb[0] not in ("info", "verify"):
        assert code == 2
        assert said.splitlines()[-1].startswith(
            f"trunk: error: {path}: {TRUTH}: all 61 states have the stamp t = "
        )


def test_the_list_says_it_too(tmp_path, trunk, whole):
    restamped(whole, tmp_path / "a.mcap", STAMPS["far"][0])
    restamped(whole, tmp_path / "b.mcap", lambda *_: (0, 0))
    _, out, _ = trunk("list", "runs", tmp_path, "--json")
    runs = json.loads(out)["runs"]
    assert all(run["doubts"]["unsound"][0].startswith(f"STAMPS: {TRUTH}: ") for run in runs)
    assert [bool(run["metrics"]) for run in runs] == [True, False]


def measured(trunk, path):
    code, out, err = trunk("metrics", "--json", path)
    assert code == 0, err
    found = json.loads(out)
    assert not found["doubts"]["refused"]
    _, out, _ = trunk("info", "--json", path)
    about = json.loads(out)
    rows = {
        name: (topic["rate_hz"], topic["longest_gap_s"]) for name, topic in about["topics"].items()
    }
    return found["metrics"], about["duration_s"], rows


def test_on_the_wall_clock_t_counts_from_the_first_state(tmp_path, trunk, whole):
    expected, duration, _ = measured(trunk, restamped(whole, tmp_path / "a.mcap", lambda k, *s: s))
    later = restamped(whole, tmp_path / "b.mcap", lambda k, s, ns: (s + 1_700_000_000, ns))
    found, span, _ = measured(trunk, later)
    assert span == pytest.approx(duration)
    same = ("itae", "overshoot_deg", "theta_max_deg", "settling_time_6deg_s")
    assert [found[name] for name in same] == [pytest.approx(expected[name]) for name in same]


@pytest.mark.parametrize("seed", range(3))
def test_what_is_measured_does_not_depend_on_the_order_of_messages(tmp_path, trunk, whole, seed):
    kept = lambda k, *stamp: stamp  # noqa: E731
    expected = measured(trunk, restamped(whole, tmp_path / "a.mcap", kept))
    mixed = restamped(whole, tmp_path / "b.mcap", kept, random.Random(seed).shuffle)
    assert measured(trunk, mixed) == expected


def test_a_gap_of_minutes_is_written_in_full(tmp_path, trunk, whole):
    kept = lambda k, *stamp: stamp  # noqa: E731
    later = lambda k, log: log + 1_234_567 * MS * (k > 30)  # noqa: E731
    path = restamped(whole, tmp_path / "a.mcap", kept, log_of=later)
    (row,) = [
        line.split() for line in trunk("info", path)[1].splitlines() if line.startswith(TRUTH)
    ]
    assert "1234572" in row
