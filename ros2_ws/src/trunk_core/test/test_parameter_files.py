import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from trunk_core.parameters.parameter_files import (
    ParameterFileError,
    Section,
    check_names,
    parse,
    read,
    resolve,
    write,
)

MATCHES = [
    ("/**", "/simulator", True),
    ("/**", "/a/b/simulator", True),
    ("simulator", "/simulator", True),
    ("simulator", "/robot/simulator", False),
    ("/robot/simulator", "/robot/simulator", True),
    ("/**/simulator", "/simulator", True),
    ("/**/simulator", "/a/b/simulator", True),
    ("/*/simulator", "/robot/simulator", True),
    ("/*/simulator", "/simulator", False),
    ("/*/simulator", "/a/b/simulator", False),
    ("simulator", "/simulator2", False),
]


@pytest.mark.parametrize(("pattern", "node", "expected"), MATCHES)
def test_patterns_mean_the_same_as_in_rcl(pattern, node, expected):
    assert Section(pattern, {}).matches(node) is expected


def by_rcl(path, node):
    """Return the values that rcl reads in a file for a node, by name."""
    rclpy = pytest.importorskip("rclpy")
    context = rclpy.Context()
    rclpy.init(args=["--ros-args", "--params-file", str(path)], context=context)
    namespace, _, name = node.rpartition("/")
    try:
        made = rclpy.create_node(
            name,
            namespace=namespace or "/",
            context=context,
            automatically_declare_parameters_from_overrides=True,
        )
        values = {name: found.value for name, found in made.get_parameters_by_prefix("").items()}
        made.destroy_node()
    finally:
        context.try_shutdown()
    return values


@pytest.mark.parametrize(("pattern", "node", "expected"), MATCHES)
def test_rcl_agrees(pattern, node, expected, tmp_path):
    path = tmp_path / "p.yaml"
    path.write_text(f"{pattern}:\n  ros__parameters:\n    x: 1.5\n")
    assert (by_rcl(path, node).get("x") == 1.5) is expected


TEXT = (
    "y Y n N yes Yes YES yEs no No NO true True TRUE tRue false FALSE on On ON oN off Off OFF t f "
    "0 -0 +1 010 08 019 0o7 0x1F 0X1F -0x1f 0x 0xG 0b11 1_0 1_0.5 1_ 0x_1 1e5_ 1__0 9223372036854775807 "
    "-9223372036854775808 9223372036854775808 0x8000000000000000 1777777777777777777777 "
    "1. .5 +.5 -.5 1e5 1E5 1.e5 1e-5 1e 1e+ e5 . + -- 1e400 -1e400 0e-400 1d5 0x1p3 0x.8 0x1.8P1 "
    ".inf -.inf +.INF .iNf inf -Inf +INF infinity -Infinity .infinity nan NAN -nan .nan .Nan -.nan "
    "2026-13-45 2001-01-01 1:30 1:30.5 -12:30:45 = << 1,000 5Hz \u0661 \uff11e5"
)
WORDS = TEXT.split()


def test_a_word_is_read_as_rcl_reads_it(tmp_path):
    path = tmp_path / "p.yaml"
    lines = [f"      w{k}: {word}\n" for k, word in enumerate(WORDS)]
    path.write_text("n:\n  ros__parameters:\n" + "".join(lines))
    (section,) = read(path).sections
    values = by_rcl(path, "/n")
    for k, word in enumerate(WORDS):
        assert repr(section.values[f"w{k}"]) == repr(values[f"w{k}"]), word


def test_a_text_that_is_written_is_a_text_to_rcl_and_to_others(tmp_path):
    path = tmp_path / "p.yaml"
    write(path, {"n": {f"w{k}": word for k, word in enumerate(WORDS)} | {"all": tuple(WORDS)}})
    for values in (by_rcl(path, "/n"), yaml.safe_load(path.read_text())["n"]["ros__parameters"]):
        assert list(values["all"]) == WORDS
        assert [values[f"w{k}"] for k in range(len(WORDS))] == WORDS
    assert "'y'" in path.read_text()
    assert "- yEs\n" in path.read_text()  # what nobody takes for anything else has no quotes


def test_a_name_is_a_text_whatever_it_looks_like():
    assert parse("y: {ros__parameters: {on: {1e5: 1}}}", "f").sections == (
        Section("y", {"on.1e5": 1}),
    )


def test_names_nest_and_later_layers_win():
    first = parse("/**:\n  ros__parameters:\n    a: {b: 1, c: 2}\n    d: 3\n", "one")
    second = parse("robot:\n  node:\n    ros__parameters:\n      a.b: 5\n", "two")
    assert resolve("/robot/node", [first, second], ["a.b", "a.c"]) == {"a.b": 5, "a.c": 2}
    assert resolve("/other", [first, second], ["a.b", "d"]) == {"a.b": 1, "d": 3}


BROKEN = {
    "not YAML": ("a: [", "line"),
    "a key twice": ("n:\n  ros__parameters:\n    x: 1\n    x: 2\n", "line 4: 'x' appears twice"),
    "a list": ("- a\n", "not a mapping"),
    "nothing for a node": ("a: 3\n", "not a mapping"),
    "no parameters": ("{}\n", "no ros__parameters"),
    "a list for a key": (
        "n:\n  ros__parameters:\n    ? [a]\n    : 1\n",
        "line 3: a list or mapping",
    ),
    "a mapping for a key": ("? {a: 1}\n: 2\n", "line 1: a list or mapping"),
    "an endless list": ("n:\n  ros__parameters: &a [*a]\n", "line 2: an alias, '*a'"),
    "an alias": ("n:\n  ros__parameters: &a {x: 1}\nm: *a\n", "line 3: an alias, '*a'"),
    "an alias for a key": ("n: &a b\n*a : 1\n", "line 2: an alias, '*a'"),
    "aliases that grow": (
        "a: &a [x, x]\nb: &b [*a, *a]\nc: &c [*b, *b]\nn: {ros__parameters: {x: *c}}\n",
        "line 2: an alias, '*a'",
    ),
    "deep lists": ("n: " + "[" * 5000 + "]" * 5000, "line 1: nested more than 50 deep"),
    "deep mappings": ("n: " + "{a: " * 5000 + "}" * 5000, "line 1: nested more than 50 deep"),
    "no bool": ("n:\n  ros__parameters:\n    x: !!bool q\n", "line 3: 'q' is not a valid bool"),
    "nothing for a number": (
        "n:\n  ros__parameters:\n    x: !!int ''\n",
        "line 3: '' is not a valid int",
    ),
    "no timestamp": ("n:\n  ros__parameters:\n    x: !!timestamp q\n", "line 3: 'q' is no"),
    "a control character": ("n: \x01\n", "not YAML"),
    "a tag": ("n:\n  ros__parameters:\n    x: !!python/name:os.system\n", "line 3"),
}


@pytest.mark.parametrize(("text", "says"), BROKEN.values(), ids=BROKEN.keys())
def test_a_broken_file_gives_one_line_with_its_place(text, says, tmp_path):
    path = tmp_path / "broken.yaml"
    path.write_text(text)
    with pytest.raises(ParameterFileError) as caught:
        read(path)
    assert str(path) in str(caught.value)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 300


def test_a_missing_or_non_text_file(tmp_path):
    with pytest.raises(ParameterFileError, match="cannot be read"):
        read(tmp_path / "none.yaml")
    (tmp_path / "bytes").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ParameterFileError, match="not a text file"):
        read(tmp_path / "bytes")


NODES = {"simulator": ["plant.length", "update_rate"], "pid": ["gains.p", "update_rate"]}


@pytest.mark.parametrize(
    ("section", "name"),
    [("simulator", "plant.lenght"), ("pid", "plant.length"), ("/**", "gains.q"), ("/*/pid", "x")],
)
def test_a_misspelt_parameter_is_refused_with_file_and_section(section, name):
    layer = parse(f"{section}:\n  ros__parameters:\n    {name}: 1.0\n", "mine.yaml")
    with pytest.raises(ParameterFileError) as caught:
        check_names([layer], NODES)
    assert "mine.yaml" in str(caught.value)
    assert section in str(caught.value)
    assert name in str(caught.value)


def test_parameters_of_any_of_the_nodes_and_other_nodes_pass():
    text = "/**:\n  ros__parameters: {gains.p: 1.0, plant.length: 2.0}\n"
    check_names([parse(text, "f"), parse("rviz:\n  ros__parameters: {x: 1}\n", "g")], NODES)


def test_what_every_ros_node_has_passes_but_not_its_misspelling():
    """`ros2 param dump` writes these with a node's own."""
    text = (
        "/pid:\n  ros__parameters:\n    gains: {p: 1.0}\n    use_sim_time: false\n"
        "    start_type_description_service: true\n"
        "    qos_overrides: {/parameter_events: {publisher: {depth: 1000}}}\n"
    )
    layer = parse(text, "dump.yaml")
    check_names([layer], NODES)
    assert resolve("/pid", [layer], NODES["pid"]) == {"gains.p": 1.0}
    for name in ("use_sim_times", "qos_overridesx"):
        with pytest.raises(ParameterFileError, match=f"'{name}': no such parameter"):
            check_names([parse(f"pid: {{ros__parameters: {{{name}: true}}}}", "f")], NODES)


values = st.one_of(
    st.booleans(),
    st.integers(-(2**53), 2**53),
    st.floats(allow_nan=False),
    st.text("abc NB=:#'\"é", max_size=8),
    st.lists(st.floats(allow_nan=False), max_size=4).map(tuple),
    st.lists(st.text("SMB ", min_size=1, max_size=6), max_size=4).map(tuple),
)


@pytest.mark.slow
@given(st.dictionaries(st.sampled_from(["a", "b.c", "d.e.f"]), values, min_size=1))
def test_what_is_written_is_read_back_to_the_bit(tmp_path_factory, written):
    path = tmp_path_factory.mktemp("params") / "p.yaml"
    write(path, {"node": written})
    found = resolve("/node", [read(path)], written)
    for name, value in written.items():
        again = tuple(found[name]) if isinstance(found[name], list) else found[name]
        assert repr(again) == repr(value)


@pytest.mark.parametrize(
    "lines", ["gains.p: 1.0\n    gains: {p: 2.0}", "gains: {p: 2.0}\n    gains.p: 1.0"]
)
def test_a_parameter_that_is_there_twice_is_refused(lines):
    with pytest.raises(
        ParameterFileError, match=r"x\.yaml: pid: parameter 'gains\.p' appears twice, dotted"
    ):
        parse(f"pid:\n  ros__parameters:\n    {lines}\n", "x.yaml")
