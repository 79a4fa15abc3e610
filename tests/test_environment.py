"""Variables of the environment that a shell's start file may set: each is used, overridden or refused.

A row is a variable with a value that is bad, or changes what a library does. Those of ROS 2 that cannot be
used are in `test_middleware.py`.
"""

import json
import os
import sys

import pytest
from tests.finished import finished

STUDY = """
scenario: demo
controllers: [pid]
duration: 0.1
runs: 2
seed: 1
vary:
  mass: {parameter: simulator.plant.trunk_mass, distribution: uniform, low: 0.3, high: 0.8}
"""
SETTINGS_FILE = "text.usetex: True\nbackend: Qt4Agg\nlines.linewidth: 9\nno.such: \xe4"
PLOT, EXPORT, SWEEP = (
    ("plot", "a.mcap", "-o", "out.svg"),
    ("export-c", "pid", "-o", "out"),
    ("sweep", "study.yaml", "-o", "out.parquet", "--jobs", "1"),
)


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("inputs")
    (folder / "study.yaml").write_text(STUDY)
    (folder / "latin1").write_text(SETTINGS_FILE, encoding="latin-1")
    (folder / "utf8").write_text(SETTINGS_FILE, encoding="utf-8")
    run("simulate", "demo", "--duration", "0.1", "-o", "a.mcap", folder=folder)
    return folder


def run(*words, folder, **variables):
    program = "from trunk_experiments.executables import trunk; trunk()"
    command = [sys.executable, "-c", program, *words]
    return finished(command, cwd=folder, env={**os.environ, **variables})


@pytest.fixture(scope="module")
def output(inputs):
    """Return a function that runs a verb and returns what it wrote, by the file's name."""
    known = {}

    def written(words, folder=inputs, **variables):
        key = (words, folder, *variables.items())
        if key not in known:
            done = run(*words, folder=folder, **variables)
            assert done.returncode == 0, done.stderr
            out = folder / words[words.index("-o") + 1]
            files = [out] if out.is_file() else sorted(out.iterdir())
            known[key] = {file.name: file.read_bytes() for file in files}
            for file in files:
                file.unlink()
            if out.is_dir():
                out.rmdir()
        return known[key]

    return written


@pytest.mark.slow
@pytest.mark.one_in(4)
@pytest.mark.parametrize(
    ("words", "name", "value"),
    [
        (PLOT, "MPLBACKEND", "Qt4Agg"),
        (SWEEP, "NUMBA_DISABLE_JIT", "1"),
        (EXPORT, "PYTHONOPTIMIZE", "2"),
        (PLOT, "MATPLOTLIBRC", "utf8"),
        (PLOT, "MATPLOTLIBRC", "latin1"),
        (PLOT, "SOURCE_DATE_EPOCH", "x"),
        (PLOT, "PYTHONOPTIMIZE", "2"),
        (PLOT, "PYTHONWARNINGS", "error"),
        (PLOT, "PYTHONIOENCODING", "utf-16"),
        (EXPORT, "PYTHONHASHSEED", "1"),
        (PLOT, "NPY_ENABLE_CPU_FEATURES", "none_such"),
        (PLOT, "NUMPY_EXPERIMENTAL_DTYPE_API", "x"),
        (PLOT, "OPENBLAS_NUM_THREADS", "x"),
        (PLOT, "OMP_NUM_THREADS", "x"),
        (PLOT, "LC_ALL", "none_such"),
        (PLOT, "TZ", "none/such"),
        (PLOT, "TERM", "none_such"),
        (PLOT, "COLUMNS", "x"),
        (SWEEP, "NUMBA_NUM_THREADS", "100000"),
        (SWEEP, "NUMBA_CACHE_DIR", "/proc/none"),
        (SWEEP, "NUMBA_BOUNDSCHECK", "1"),
        (SWEEP, "NUMBA_CPU_NAME", "generic"),
    ],
)
def test_what_is_written_does_not_depend_on_it(output, words, name, value):
    assert output(words, **{name: value}) == output(words)


def test_nor_on_a_settings_file_in_the_folder(output, inputs, tmp_path):
    (tmp_path / "a.mcap").symlink_to(inputs / "a.mcap")
    (tmp_path / "matplotlibrc").write_text("text.usetex: True\nlines.linewidth: 9\n")
    assert output(PLOT, folder=tmp_path) == output(PLOT)


@pytest.mark.slow
@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    ("words", "name", "value"),
    [
        (SWEEP, "NUMBA_NUM_THREADS", "0"),
        (PLOT, "NPY_DISABLE_CPU_FEATURES", "SSE"),
        (SWEEP, "NUMBA_CPU_FEATURES", "none_such"),
        (SWEEP, "NUMBA_DISABLE_JIT", "yes"),
        (SWEEP, "NUMBA_OPT", "9"),
        (PLOT, "NUMPY_MADVISE_HUGEPAGE", "x"),
    ],
)
def test_it_is_refused_in_one_line(inputs, words, name, value):
    more = ("--json",) if words is SWEEP else ()
    done = run(*words, *more, folder=inputs, **{name: value})
    (line,) = done.stderr.splitlines()
    assert (done.returncode, line[:14]) == (2, "trunk: error: ")
    assert f"{name}={value}" in line
    if more:
        assert json.loads(done.stdout)["error"] == line[14:]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "name", "value"),
    [
        (("run", "demo"), "RMW_IMPLEMENTATION", "rmw_none"),
        (("params", "set", "pid", "gains.p=70"), "RMW_IMPLEMENTATION", "rmw_none"),
        (("live", "demo"), "RCL_ASSERT_RMW_ID_MATCHES", "rmw_none"),
        (("run", "demo"), "ROS_STATIC_PEERS", "robot.invalid"),
    ],
)
def test_one_of_ros_is_refused_before_anything_begins(tmp_path, words, name, value):
    done = run(*words, "--json", folder=tmp_path, **{name: value})
    (line,) = done.stderr.splitlines()
    assert (done.returncode, line[:14]) == (2, "trunk: error: ")
    assert name in line
    assert json.loads(done.stdout)["error"] == line[14:]
    assert not list(tmp_path.iterdir())


def test_a_file_whose_name_is_no_text(trunk, inputs, tmp_path):
    """Files by any name, except where a library takes text alone."""
    folder = tmp_path / os.fsdecode(b"L\xe4ufe")
    folder.mkdir()
    scenario = folder / os.fsdecode(b"L\xe4.yaml")
    scenario.write_text("simulator: {ros__parameters: {duration: 0.1}}")
    code, _, err = trunk("simulate", scenario, "-o", folder / "a.mcap")
    assert (code, err) == (0, "")
    code, _, err = trunk("sweep", inputs / "study.yaml", "-o", folder / "a.parquet", "--jobs", "1")
    assert code == 2
    assert err.endswith("parquet: this name is not UTF-8, but a library needs that: give another\n")
