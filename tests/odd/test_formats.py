"""Recordings as strangers make them: each verb says what is odd about one, and shows no nonsense."""

import pytest
from mcap.opcode import Opcode
from ros2_ws.src.trunk_recording.test.mcap_files import records_of, write_mcap

from trunk_core import topics
from trunk_core.samples import JointSample
from trunk_recording.cdr import JointStateLayout
from trunk_recording.digests import END

TRUTH = f"/{topics.GROUND_TRUTH}"
MS = 1_000_000
BOTH = ("hip", "trunk")
MARKED = [(END, {"complete": "true", "reason": "finished"})]


def places(path, opcode):
    """Return where the records of a kind begin."""
    return [at for kind, at, _ in records_of(path.read_bytes()) if kind == opcode]


def states(path, stamps, names=BOTH, values=2, order=None, **options):
    """Write true states with these stamps, each logged a period after the one before; return the path."""
    layout = JointStateLayout(names, values, values, values)
    samples = [
        JointSample(ns, names, *((0.1 * k,) * values for _ in range(3)))
        for k, ns in enumerate(stamps)
    ]
    messages = [(TRUTH, k * MS, layout.pack(s)) for k, s in enumerate(samples)]
    return write_mcap(path, [messages[k] for k in order or range(len(messages))], **options)


@pytest.mark.parametrize(
    ("names", "values", "why"),
    [
        ((), 2, "2 values of position for 0 names"),
        (("hip", "hip"), 2, "a name appears twice among hip, hip"),
        (("trunk",), 2, "2 values of position for 1 names"),
        (("hip", "trunk", "hip"), 3, "a name appears twice among hip, trunk, hip"),
    ],
)
@pytest.mark.parametrize(
    "verb",
    [["metrics"], ["plot", "-o", "a.png"], ["report", "-o", "a.html"]],
)
def test_why_no_message_can_be_read_comes_first(
    tmp_path, monkeypatch, trunk, verb, names, values, why
):
    monkeypatch.chdir(tmp_path)
    path = states(tmp_path / "a.mcap", range(0, 20 * MS, MS), names, values)
    code, out, err = trunk(verb[0], path, *verb[1:])
    last = err.splitlines()[-1]
    assert (code, last) == (
        2,
        f"trunk: error: {path}: {TRUTH} is not read: message 0, logged at 0.000000000 s: {why}",
    ), out


@pytest.mark.parametrize(
    ("library", "name"), [("", "a program that gives no name"), ("x 1", "x 1")]
)
def test_a_strangers_file_is_not_said_to_have_ended_badly(tmp_path, trunk, library, name):
    layout = JointStateLayout(BOTH, 2)
    messages = [
        (TRUTH, k * MS, layout.pack(JointSample(k * MS, BOTH, (0.0, 0.0)))) for k in range(9)
    ]
    path = write_mcap(tmp_path / "a.mcap", messages, library=library)
    says = f"recorded by {name}: no trunk_end record says whether the run is complete"
    for verb in ("info", "verify", "info --check", "metrics"):
        _, out, err = trunk(*verb.split(), path)
        assert says in out + err
        assert "shut down" not in out + err
        assert "did not finish" not in out + err


CONVERT = "to convert another kind of bag: rosbags-convert --src BAG --dst NEW --dst-storage mcap"


@pytest.mark.parametrize(
    "verb", [["info"], ["verify"], ["info", "--check"], ["metrics"], ["recover", "-o", "b.mcap"]]
)
def test_another_format_is_refused_with_the_command_for_bags(tmp_path, monkeypatch, trunk, verb):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "a bag"
    path.write_bytes(b"SQLite format 3\0\x10\0" + bytes(100))
    why = "it does not begin as one: if it is compressed, unpack it"
    says = f"trunk: error: {path} is not an MCAP recording: {why}; {CONVERT}\n"
    assert trunk(verb[0], path, *verb[1:]) == (2, "", says)


@pytest.mark.parametrize(
    ("about", "says"),
    [
        ("", "it has no metadata.yaml and no .mcap files"),
        ("storage_identifier: sqlite3", "its storage is 'sqlite3'"),
        ("storage_identifier: mcap\n  compression_mode: MESSAGE", "it is compressed by message"),
        ("storage_identifier: mcap\n  compression_mode: FILE", "it is compressed by file"),
    ],
)
def test_a_bag_of_another_kind_is_refused_with_the_command(tmp_path, trunk, about, says):
    bag = tmp_path / "a bag"
    bag.mkdir()
    if about:
        (bag / "metadata.yaml").write_text(f"rosbag2_bagfile_information:\n  {about}\n")
    code, _, err = trunk("info", bag)
    assert (code, says in err, err.endswith(f"; {CONVERT}\n")) == (2, True, True), err


@pytest.mark.parametrize("count", [1, 2])
def test_a_bags_only_file_is_recovered(tmp_path, trunk, count):
    bag = tmp_path / "bag"
    bag.mkdir()
    for part in range(count):
        states(bag / f"bag_{part}.mcap", range(0, 9 * MS, MS))
    code, out, err = trunk("recover", bag, "-o", tmp_path / "b.mcap")
    if count == 1:
        assert (code, out) == (0, f"{tmp_path / 'b.mcap'}: 9 messages of 1 topics\n")
    else:
        says = f"{bag} has 2 files: recover each of them: bag_0.mcap, bag_1.mcap"
        assert (code, err) == (2, f"trunk: error: {says}\n")


def test_a_bag_whose_index_was_made_anew_has_no_storage_named(tmp_path, trunk):
    bag = tmp_path / "bag"
    bag.mkdir()
    states(bag / "bag_0.mcap", range(0, 9 * MS, MS))
    (bag / "metadata.yaml").write_text(
        'rosbag2_bagfile_information:\n  storage_identifier: ""\n  message_count: 9\n'
        "  relative_file_paths: [bag_0.mcap]\n"
    )
    code, out, err = trunk("info", bag)
    assert code == 0, err
    assert TRUTH in out


@pytest.mark.parametrize("verb", ["info", "metrics"])
def test_damage_after_the_mark_of_completeness_stands_first(tmp_path, trunk, verb):
    path = states(tmp_path / "a.mcap", range(0, 400 * MS, MS), compression="none", first=MARKED)
    data = bytearray(path.read_bytes())
    data[places(path, Opcode.CHUNK)[-1] + 60] ^= 0xFF
    path.write_bytes(data)
    _, out, err = trunk(verb, path)
    assert (out + err).lstrip().startswith(("INCOMPLETE: ", "trunk: warning: INCOMPLETE: ")), out


def test_damage_in_the_summary_is_named(tmp_path, trunk):
    path = states(tmp_path / "a.mcap", range(0, 40 * MS, MS))
    data = bytearray(path.read_bytes())
    index = places(path, Opcode.CHUNK_INDEX)[0]
    data[index + 41 : index + 45] = b"\xff\xff\xff\x7f"  # the length of its map
    path.write_bytes(data)
    _, out, _ = trunk("info", "--check", path)
    assert "is damaged (" in out
    assert ": \n" not in out
