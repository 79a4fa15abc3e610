"""What the gateway is made of: rows, words, tokens, what is known of a graph."""

import json

import numpy as np
import pytest

from trunk_control.fuzzy import fired_rules
from trunk_control.fuzzy_pid import FuzzyPidConfig
from trunk_control.pid import PidConfig
from trunk_core.errors import GatewayError
from trunk_core.parameters.declarations import values_of
from trunk_core.samples import JointSample
from trunk_sim.config import TrunkSimulator
from trunk_views.live.access import Rate, Site, Tokens, origin_of
from trunk_views.live.feed import (
    PLANT_COLUMNS,
    BadMessageError,
    Board,
    StreamRows,
    asked,
    columns_of,
    frame,
    plain,
    row_of,
    with_rules,
)
from trunk_views.live.graph_state import Graph
from trunk_views.live.process import listening
from trunk_views.live.server import page_files


def test_rows_keep_the_last_ones_and_number_them_all():
    rows = StreamRows(("t", "v"), 3)
    assert rows.last() == {}
    assert rows.since(0, 10)[1].tolist() == []
    for i in range(11):
        rows.add((float(i), 2.0 * i))
        first, values = rows.since(0, 100)
        assert first == rows.oldest == max(0, i - 2)
        assert values[:, 0].tolist() == [float(k) for k in range(max(0, i - 2), i + 1)]
    assert rows.count == 11
    assert rows.last() == {"t": 10.0, "v": 20.0}
    assert rows.since(9, 1)[1].tolist() == [[9.0, 18.0]]
    assert rows.since(11, 5)[1].tolist() == []


def test_a_frame_is_its_head_and_its_rows():
    rows = StreamRows(("t", "v"), 10)
    assert frame(3, rows, 0) == (b"", 0)
    rows.add((0.5, float("nan")))
    rows.add((0.6, 1.0))
    data, after = frame(3, rows, 1)
    assert np.frombuffer(data, "<f8").tolist() == [3.0, 2.0, 1.0, 0.6, 1.0]
    assert after == 2


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "not JSON"),
        ("[" * 100_000, "not JSON"),
        ("[1]", "not a JSON object"),
        ('{"kind": "shutdown"}', "a kind other than"),
        ('{"kind": ["push"]}', "a kind other than"),
        ('{"kind": "pause", "on": 1}', "on is not a finite bool"),
        ('{"kind": "pause"}', "it must carry these fields only: on"),
        ('{"kind": "reset", "also": 1}', "it must carry these fields only: none"),
        ('{"kind": "reset", "number": "1"}', "its number is not an integer"),
        ('{"kind": "reset", "number": true}', "its number is not an integer"),
        ('{"kind": "push", "force": NaN, "torque": 0}', "not JSON"),
        (
            '{"kind": "push", "force": 1e999, "torque": 0}',
            "force is not a finite float",
        ),
        (
            f'{{"kind": "push", "force": 1{"0" * 400}, "torque": 0}}',
            "not a finite float",
        ),
        ('{"kind": "push", "force": true, "torque": 0}', "force is not a finite float"),
        (b"\x00\x01", "binary"),
    ],
)
def test_what_no_page_sends_is_refused_in_words(text, why):
    with pytest.raises(BadMessageError, match=why):
        asked(text)


def test_a_request_carries_its_values():
    found = asked('{"kind": "push", "number": 7, "force": 1, "torque": -2.5}')
    assert found == ("push", 7, {"force": 1.0, "torque": -2.5})
    assert asked('{"kind": "reset"}').number == 0


def test_values_are_plain_for_json():
    assert plain((1.0, float("inf"), ("a",))) == [1.0, "inf", ["a"]]


def test_tokens_open_what_they_are_for():
    tokens = Tokens.new()
    assert tokens.control != tokens.watch
    assert len(tokens.control) >= 43
    assert tokens.may(["trunk.live.1", tokens.control]) == "control"
    assert tokens.may([tokens.watch]) == "watch"
    for wrong in ([], [""], [tokens.control[:-1]], ["trunk.live.1"], ["ä"]):
        assert tokens.may(wrong) == ""


def test_only_our_own_names_and_origins_are_known():
    hosts = Site.at("http://127.0.0.1:8000")
    for known in ("127.0.0.1:8000", "localhost:8000"):
        assert hosts.known(known)
        assert hosts.same(f"http://{known}")
    for unknown in (
        "",
        "127.0.0.1",
        "127.0.0.1:8001",
        "evil.example:8000",
        "localhost:8000.evil.example",
    ):
        assert not hosts.known(unknown)
        assert not hosts.same(f"http://{unknown}")
    assert not hosts.same("https://localhost:8000")
    assert not hosts.same("null")
    assert not hosts.same("http://user@localhost:8000")
    assert hosts.same(None)  # no browser


@pytest.mark.parametrize(
    ("url", "origin"),
    [
        ("http://127.0.0.1:8080", "http://127.0.0.1:8080"),
        ("HTTPS://Robot.Example/", "https://robot.example"),
        ("https://robot.example:443", "https://robot.example"),
        ("http://robot:80", "http://robot"),
        ("http://[0:0::1]:8080", "http://[::1]:8080"),
        ("http://[::1]:8080", "http://[::1]:8080"),
    ],
)
def test_an_origin_is_what_browsers_send(url, origin):
    assert origin_of(url) == origin
    site = Site.at(url)
    assert site.same(origin)
    assert site.known(origin.partition("//")[2])
    assert not site.known("localhost")
    assert not site.same("http://localhost")


@pytest.mark.parametrize(
    "url",
    [
        *("127.0.0.1:8080", "ftp://a", "http://", "http://a:b", "http://a:99999", "http://a:"),
        *(
            "http://u@a",
            "http://a/path",
            "http://a?b",
            "http://a#b",
            "http://a b",
            "http://ä",
            "//a",
        ),
        *("http://a,b", "http://*", "http://[::1", "http://[v1.a]"),
    ],
)
def test_what_is_no_origin_is_refused_with_what_is_allowed(url):
    with pytest.raises(ValueError, match="http://HOST:PORT or https://HOST:PORT is allowed"):
        origin_of(url)


def test_a_rate_allows_a_burst_and_then_a_number_each_second():
    now = [0.0]
    rate = Rate(10.0, lambda: now[0])
    assert [rate.allows() for _ in range(12)] == [True] * 10 + [False] * 2
    now[0] = 0.25
    assert [rate.allows() for _ in range(4)] == [True, True, False, False]
    now[0] = 100.0
    assert sum(rate.allows() for _ in range(20)) == 10


def test_the_board_skips_what_has_been_replaced():
    board = Board()
    assert board.after(0) is None
    board.put("run", a=1)
    board.put("node", "pid", a=1)
    first = board.after(0)
    assert json.loads(first[1]) == {"kind": "run", "a": 1}
    board.put("run", a=2)
    board.put("run", a=2)  # says the same: no new version
    node = board.after(first[0])
    assert json.loads(node[1])["name"] == "pid"
    run = board.after(node[0])
    assert json.loads(run[1])["a"] == 2
    assert board.after(run[0]) is None
    # A late reader reads each piece once.
    late, version = [], 0
    while (piece := board.after(version)) is not None:
        version, text = piece
        late.append(json.loads(text)["kind"])
    assert late == ["node", "run"]


def test_messages_become_rows():
    state = JointSample(1_500_000_000, ("hip", "trunk"), (1.0, 0.1), (2.0, 0.2), (0.0, 5.0))
    assert row_of("plant", state) == (1.5, 1.0, 0.1, 2.0, 0.2, 5.0)
    assert columns_of("plant", (), None) == PLANT_COLUMNS
    assert row_of("plant", state._replace(effort=())) is None
    assert row_of("pushes", JointSample(1, ("a", "b"), effort=(1.0, 2.0))) == (1e-9, 1.0, 2.0)
    assert row_of("pushes", JointSample(1, ("a",), effort=(1.0,))) is None
    terms = JointSample(0, ("error", "error_rate"), (0.4, -0.7))
    assert row_of("pid", terms) == (0.0, 0.4, -0.7)
    assert row_of("pid", terms._replace(position=(1.0,))) is None
    assert row_of("pid", JointSample(-1, ())) is None


def test_a_row_of_fuzzy_pid_says_which_rules_fire():
    config = FuzzyPidConfig()
    said = ("error", "error_rate")
    row = with_rules((0.0, 0.4, -0.7), said, config)
    fired = fired_rules(0.4, -0.7, config.rules)
    assert row[3:5] == (fired[0].row, fired[0].column)
    assert row[5:] == tuple(one.weight for one in fired)
    assert sum(row[5:]) == pytest.approx(1.0)
    assert len(columns_of("fuzzy_pid", said, config)) == len(row)
    assert with_rules((0.0, 1.0), ("other",), config) == (0.0, 1.0)


def pieces(board):
    found, version = {}, 0
    while (piece := board.after(version)) is not None:
        version = piece[0]
        words = json.loads(piece[1])
        found[words["kind"], words.get("name", "")] = words
    return found


def test_a_graph_is_known_by_what_its_nodes_say():
    board = Board()
    graph = Graph(board)
    graph.parameters("simulator", values_of(TrunkSimulator(operator_torque=40.0)))
    graph.parameters("pid", values_of(PidConfig()))
    graph.event("pid", -1, "configured", {"kind": "pid"})
    graph.event("pid", -1, "activated", {})
    graph.event("simulator", 0, "started", {"rate": "200"})
    said = pieces(board)
    assert said["run", ""]["acting"] == ["pid"]
    assert said["run", ""]["started"]
    assert said["world", ""]["operator"] == {"force": 0.0, "torque": 40.0}
    assert said["node", "pid"]["controller"]
    assert not said["node", "simulator"]["controller"]
    kp = said["declared", "pid"]["parameters"]["gains.p"]
    assert kp["unit"] == "N m/rad"
    assert not kp["fixed"]
    assert kp["description"]
    graph.event("simulator", 10**9, "paused", {})
    assert pieces(board)["run", ""]["paused"]
    graph.event("simulator", 10**9, "resumed", {})
    graph.event("pid", 10**9, "deactivated", {})
    assert pieces(board)["run", ""]["acting"] == []
    graph.event("simulator", 2 * 10**9, "finished", {"reason": "stopped"})
    graph.event("simulator", 2 * 10**9, "published", {})
    said = pieces(board)
    assert said["run", ""]["ended"]
    assert not said["run", ""]["paused"]


def test_of_many_events_the_latest_are_kept_and_the_others_counted():
    board = Board()
    graph = Graph(board, kept=3)
    for number in range(5):
        graph.event("pid", number, f"event {number}", {})
    graph.put_events()
    said = pieces(board)["events", ""]
    assert [one["event"] for one in said["events"]] == ["event 2", "event 3", "event 4"]
    assert said["before"] == 2


def test_a_renamed_node_is_known_by_its_kind():
    graph = Graph(Board())
    graph.parameters("left", values_of(PidConfig()))
    assert graph.controllers == []
    graph.event("left", -1, "configured", {"kind": "pid"})
    assert graph.controllers == ["left"]


@pytest.mark.parametrize("name", ["fuzzy_pid", "left"])
def test_events_before_the_parameters_give_a_node_no_configuration(name):
    """Between two topics there is no order: the page would look for rules that it does not have yet."""
    board = Board()
    graph = Graph(board)
    graph.event(name, -1, "configured", {"kind": "fuzzy_pid"})
    graph.event(name, -1, "activated", {})
    node = pieces(board)["node", name]
    assert (node["controller"], node["rules"], node["parameters"]) == (False, None, {})
    graph.parameters(name, values_of(FuzzyPidConfig()))
    node = pieces(board)["node", name]
    assert node["controller"]
    assert {table["name"] for table in node["rules"]["tables"]} <= set(node["parameters"])


def test_a_change_of_one_parameter_is_known():
    board = Board()
    graph = Graph(board)
    graph.parameters("pid", values_of(PidConfig()))
    graph.parameters("pid", {"gains.p": 33.0})
    assert pieces(board)["node", "pid"]["parameters"]["gains.p"] == 33.0
    assert graph.nodes["pid"].config.gains.p == 33.0
    graph.diagnosed("pid", 1, "commands limited 3", {"lifecycle": "active"})
    assert graph.nodes["pid"].state == "active"
    assert pieces(board)["health", "pid"]["level"] == 1


def test_a_plant_that_is_not_installed_is_shown_without_what_it_declares():
    board = Board()
    graph = Graph(board)
    graph.parameters("simulator", {"plant.name": "furuta", "joints": ("arm", "pole")})
    graph.event("simulator", -1, "configured", {"kind": "simulator"})
    said = pieces(board)
    assert said["node", "simulator"]["parameters"]["plant.name"] == "furuta"
    assert said["declared", "simulator"]["parameters"] == {}
    assert graph.nodes["simulator"].config is None


def test_every_file_that_the_page_names_is_served():
    files = page_files()
    page = files["/"].data.decode()
    named = [part.split('"')[0] for part in page.split('src="')[1:] + page.split('href="/')[1:]]
    for name in named:
        if not name.startswith("#"):
            assert f"/{name.lstrip('/')}" in files, name
    assert "http" not in page.replace("http-equiv", "")


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (("--host", "localhost"), "--host localhost: give one address of this machine"),
        (("--host", "0.0.0.0"), "need --url, the address that browsers open"),
        (("--url", "ftp://a"), "--url ftp://a: http://HOST:PORT"),
    ],
)
def test_an_address_that_cannot_be_served_is_refused(trunk, words, line):
    code, _, said = trunk("live", "demo", *words)
    assert code == 2
    assert line in said
    assert said.count("\n") == 1


def test_an_address_of_another_machine_is_named():
    with pytest.raises(GatewayError, match=r"^address 192\.0\.2\.1:0: Cannot assign"):
        listening("192.0.2.1", 0)
