import math
import platform
import random
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from trunk_control.controller import Controller, settings_of
from trunk_control.decide import decide
from trunk_control.law import ControllerConfig
from trunk_control.laws import law_named
from trunk_core.c.program import real_literal
from trunk_experiments.export_c.library import ExportedController, base_files
from trunk_runs.nodes import CONTROLLERS

from ...trunk_control.test.exported_laws import CHANGES, readings
from ...trunk_control.test.faulty_laws import HONEST
from ...trunk_core.test.c_programs import COMPILER, STRICT, Compiled, compiled_once, needs_compiler

LAWS = {**{name: law_named(name) for name in CONTROLLERS}, "honest": HONEST}


def config_of(name) -> ControllerConfig:
    """Return a law's configuration off the beaten track."""
    return LAWS[name].config(**CHANGES.get(name, {"active_times": (0.5, 2.0, 3.0)}))


@needs_compiler
@pytest.mark.parametrize("name", LAWS)
def test_decide_gives_cpythons_bits(name):
    law, config = LAWS[name], config_of(name)
    settings, constants = settings_of(config, law), config.constants
    state, rng = Controller(config, law).state, random.Random(name)
    rows, results = [], []
    for reading in readings(rng, 2000):
        rows.append((state, reading))
        results.append(decide(state, reading, settings, constants, law.update, law.transfer))
        state = results[-1][0]
        if rng.random() < 0.02:
            pace = state.pace._replace(active=False)
            state = state._replace(pace=pace)
        elif rng.random() < 0.02:
            transfer = state.transfer._replace(pending=True, transferring=False)
            state = state._replace(transfer=transfer)
    arguments = (state, rows[0][1], settings, constants, law.update, law.transfer)
    program = Compiled(decide, arguments, fixed=(2, 3), changing=(type(law.memory),))
    assert program.different(rows, results) == []


def written(exported, folder):
    """Write an exported controller's files; return its sources."""
    for name, text in base_files(exported, exported.answers(200)).items():
        (folder / name).write_bytes(text)
    return [folder / f"{exported.name}.c", folder / "replay.c"]


def built(folder, sources, *flags, compiler=COMPILER):
    """Return a program of these sources; a warning is an error."""
    binary = folder / "program"
    strict = STRICT[1:] if "c++" in flags else STRICT  # without -std=c99
    assert compiled_once([compiler, *strict, *flags, *sources], binary) == ""
    return binary


def replayed(binary, folder, name, *prefix):
    words = [*prefix, str(binary), str(folder / f"{name}.states")]
    done = subprocess.run(words, capture_output=True, text=True, check=False, timeout=120)
    return done.returncode, done.stdout + done.stderr


@needs_compiler
@pytest.mark.parametrize("name", LAWS)
def test_the_files_compile_without_warnings_and_replay(name, tmp_path):
    exported = ExportedController(LAWS[name], config_of(name))
    sources = written(exported, tmp_path)
    sanitised = ("-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
    code, out = replayed(built(tmp_path, sources, *sanitised), tmp_path, name)
    assert code == 0
    assert re.fullmatch(r"(\d+) of \1 commands equal\n", out)
    compiler = shutil.which("g++")
    if compiler:
        flags = ["-x", "c++", *STRICT[1:], "-std=c++17", "-O2"]
        assert compiled_once([compiler, *flags, "-c", sources[0]], tmp_path / "x.o") == ""


@needs_compiler
def test_a_changed_command_is_named(tmp_path):
    exported = ExportedController(LAWS["pid"], LAWS["pid"].config())
    sources = written(exported, tmp_path)
    states = bytearray((tmp_path / "pid.states").read_bytes())
    states[16 + 80 * 7 + 64] ^= 1  # the last bit of the eighth command
    (tmp_path / "pid.states").write_bytes(states)
    code, out = replayed(built(tmp_path, sources), tmp_path, "pid")
    assert code == 1
    assert "199 of 200 commands equal" in out
    assert "t = 35000 us" in out


def x86_with(*features):
    """Return whether this is gcc on an x86-64 with these features."""
    cpu = Path("/proc/cpuinfo")
    text = cpu.read_text() if cpu.exists() else ""
    gcc = platform.machine() == "x86_64" and "gcc" in str(COMPILER)
    return gcc and all(f" {feature}" in text for feature in features)


@needs_compiler
@pytest.mark.skipif(not x86_with("fma"), reason="needs gcc on an x86-64 with FMA")
def test_the_self_test_finds_contraction(tmp_path):
    exported = ExportedController(LAWS["pid"], LAWS["pid"].config())
    sources = written(exported, tmp_path)
    flags = ("-O2", "-mfma", "-ffp-contract=fast")
    assert replayed(built(tmp_path, sources, *flags), tmp_path, "pid")[0] == 0  # by the pragma
    without_pragma(sources[0])
    code, out = replayed(built(tmp_path, sources, *flags), tmp_path, "pid")
    assert code == 1
    assert "contracts" in out


def without_pragma(source):
    """Take out what makes GCC keep the bits whatever its flags."""
    text, count = re.subn("#pragma GCC optimize.*\n", "", source.read_text())
    assert count == 1
    source.write_text(text)


@needs_compiler
@pytest.mark.skipif("gcc" not in str(COMPILER), reason="needs gcc")
def test_the_self_test_names_constants_of_single_precision(tmp_path):
    sources = written(ExportedController(LAWS["pid"], LAWS["pid"].config()), tmp_path)
    flags = ("-O2", "-fsingle-precision-constant", "-Wno-overflow")
    assert replayed(built(tmp_path, sources, *flags), tmp_path, "pid")[0] == 0  # by the pragma
    without_pragma(sources[0])
    code, out = replayed(built(tmp_path, sources, *flags), tmp_path, "pid")
    assert (code, "compile without -fsingle-precision-constant" in out) == (1, True)


@needs_compiler
@pytest.mark.skipif(not x86_with(), reason="needs gcc on an x86-64")
@pytest.mark.parametrize(
    ("bits", "fault"), [("0x8040u", "FLUSHED"), ("0x2000u", "ROUNDED")], ids=["flush", "rounding"]
)
def test_the_self_test_finds_a_mode_of_the_processor(bits, fault, tmp_path):
    sources = written(ExportedController(LAWS["pid"], LAWS["pid"].config()), tmp_path)
    main = tmp_path / "main.c"
    mode = f"__builtin_ia32_ldmxcsr(__builtin_ia32_stmxcsr() | {bits});"
    test = f"return pid_self_test() == PID_{fault} ? 0 : 1;"
    main.write_text(f'#include "pid.h"\nint main(void) {{ {mode} {test} }}\n')
    binary = built(tmp_path, [sources[0], main], "-O2")
    assert subprocess.run([str(binary)], check=False).returncode == 0


@needs_compiler
@pytest.mark.parametrize(
    "flag", ["-ffast-math", "-Ofast", "-funsafe-math-optimizations", "-mfpmath=387"]
)
def test_flags_that_change_bits_are_refused_or_found(flag, tmp_path):
    exported = ExportedController(LAWS["pid"], LAWS["pid"].config())
    sources = written(exported, tmp_path)
    words = [str(COMPILER), "-std=c99", flag, *map(str, sources), "-o", str(tmp_path / "program")]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    if done.returncode:
        assert "#error" in done.stderr or "not recognized" in done.stderr
        return
    code, out = replayed(tmp_path / "program", tmp_path, "pid")
    assert (code, out[:9]) == (1, "self-test")


def retuned_program(exported, folder, parameters, samples):
    """Return a program that answers some readings, takes new parameters, and answers others."""
    n = exported.name
    lines = [
        f'#include "{n}.h"',
        "#include <stdio.h>",
        '#define NOT_A_NUMBER __builtin_nan("")',
        "int main(void) {",
    ]
    lines += [f"static {n}_Controller c; {n}_Reading r; {n}_Output o; {n}_Parameters p;"]
    lines += [f"{n}_reset(&c);"]
    for reading, change in samples:
        if change:
            lines += [f"{n}_parameters(&c, &p);"]
            lines += [f"p.{name} = {real_literal(value)};" for name, value in parameters.items()]
            lines += [f'printf("%d\\n", {n}_retune(&c, &p));']
        cells = (reading.position, reading.velocity, *reading.hip, reading.effort)
        names = ("position", "velocity", "hip.position", "hip.velocity", "effort")
        lines += [
            f"r.stamp_ns = INT64_C({reading.stamp_ns}); r.has_reference = false; r.reference = 0.0;"
        ]
        lines += [f"r.{name} = {value.hex()};" for name, value in zip(names, cells, strict=True)]
        lines += [f'{n}_update(&c, &r, &o); printf("%a\\n", o.effort);']
    (folder / "main.c").write_text("\n".join([*lines, "return 0; }"]))
    binary = built(folder, [folder / f"{n}.c", folder / "main.c"])
    return subprocess.run([str(binary)], capture_output=True, text=True, check=True).stdout.split()


@needs_compiler
@pytest.mark.parametrize("name", CONTROLLERS)
def test_new_parameters_on_the_target_as_in_the_node(name, tmp_path):
    law, config = LAWS[name], LAWS[name].config()
    exported = ExportedController(law, config)
    written(exported, tmp_path)
    leaf = exported.leaves[-1]
    assert exported.leaves
    value = 1.25 * float(exported.values[leaf.declaration.name])
    samples = [(row.reading, k == 5) for k, row in enumerate(exported.answers(10))]
    controller = Controller(config, law)
    field = next(
        f for f in config.__dataclass_fields__.values() if leaf.declaration in f.metadata.values()
    )
    expected = []
    for reading, change in samples:
        if change:
            controller.reconfigure(replace(config, **{field.name: value}))
            expected.append("1")
        expected.append(controller.decide(reading).effort.hex())
    out = retuned_program(exported, tmp_path, {leaf.name: value}, samples)
    assert [float.fromhex(x) for x in out] == [float.fromhex(x) for x in expected]
    out = retuned_program(exported, tmp_path, {leaf.name: math.nan}, samples[5:6])
    assert out[0] == "0"


@needs_compiler
def test_parameters_that_do_not_fit_together_are_refused_on_the_target(tmp_path):
    exported = ExportedController(LAWS["fuzzy_pid"], LAWS["fuzzy_pid"].config())
    written(exported, tmp_path)
    samples = [(row.reading, True) for row in exported.answers(1)]
    for values, taken in (
        ({"gains_p_min": 61.0}, "0"),
        ({"gains_p_max": 31.0}, "0"),
        ({"gains_d_min": 18.5, "gains_d_max": 18.25}, "0"),
        ({"gains_p_min": 61.0, "gains_p_max": 61.0}, "1"),
    ):
        assert retuned_program(exported, tmp_path, values, samples)[0] == taken, values


WRAP = """
#include "pid.h"
#include <stdio.h>
int main(void) {
    static pid_Controller c;
    pid_Output o = {0};
    int64_t wide = 0, steps = 0, restarts = 0;
    for (int counted = 0; counted < 2; counted++) {
        uint32_t us = 4294967295u - 60000000u;
        pid_reset(&c);
        for (long k = 0; k < 12010; k++, us += 5000u) {
            const int64_t before = wide;
            const pid_Reading r = {.stamp_ns = 1000 * (counted ? (int64_t)us : pid_widened(&wide, us)),
                                   .position = 0.005};
            pid_update(&c, &r, &o);
            steps += k > 0 && wide - before == 5000;
            restarts += o.restarted;
        }
        printf("%d %.1f\\n", (int)restarts, o.effort);
    }
    return steps == 12009 ? 0 : 1;
}
"""


@needs_compiler
def test_a_counter_that_wraps_is_widened_and_time_that_goes_back_is_told(tmp_path):
    source, _ = written(ExportedController(LAWS["pid"], LAWS["pid"].config()), tmp_path)
    (tmp_path / "wrap.c").write_text(WRAP)
    binary = built(tmp_path, [source, tmp_path / "wrap.c"])
    done = subprocess.run([str(binary)], capture_output=True, text=True, check=True)
    assert done.stdout == "0 -30.3\n1 -0.3\n"


def two_exports(tmp_path, *names):
    """Write two exports of pid with other gains into folders `a` and `b`."""
    for folder, p, name in zip("ab", (60.0, 70.0), names, strict=True):
        (tmp_path / folder).mkdir()
        written(
            ExportedController(LAWS["pid"], LAWS["pid"].config(p=p), name=name), tmp_path / folder
        )


def using(folder, name):
    return f"""#include "{folder}/{name}.h"
#include <stdio.h>
void use_{folder}(void);
void use_{folder}(void) {{
    static {name}_Controller c;
    {name}_Parameters p;
    {name}_reset(&c);
    {name}_parameters(&c, &p);
    printf("%g %d\\n", p.gains_p, {name}_self_test());
}}
"""


@needs_compiler
@pytest.mark.parametrize("flags", [(), ("-x", "c++", "-std=c++17")], ids=["C", "C++"])
def test_two_exports_of_a_law_with_names_of_their_own_are_in_one_program(flags, tmp_path):
    compiler = shutil.which("g++") if flags else COMPILER
    if compiler is None:
        pytest.skip("no C++ compiler: apt-get install g++")
    two_exports(tmp_path, "pid", "left_hip")
    main = tmp_path / "main.c"
    text = using("a", "pid") + using("b", "left_hip") + '#include "a/pid.h"\n'
    main.write_text(text + "int main(void) { use_a(); use_b(); return 0; }\n")
    sources = [tmp_path / "a" / "pid.c", tmp_path / "b" / "left_hip.c", main]
    binary = built(tmp_path, sources, *flags, compiler=compiler)
    done = subprocess.run([str(binary)], capture_output=True, text=True, check=True)
    assert done.stdout == "60 0\n70 0\n"


@needs_compiler
def test_of_two_exports_with_one_name_none_is_silently_the_other(tmp_path):
    two_exports(tmp_path, "pid", "pid")

    def compiled(*words):
        command = [str(COMPILER), "-std=c99", *words]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        return done.returncode, done.stderr

    (tmp_path / "both.c").write_text('#include "a/pid.h"\n#include "b/pid.h"\n')
    code, err = compiled("-c", "both.c")
    assert code != 0
    assert "two exports with the name pid and other contents" in err
    for folder in "ab":
        (tmp_path / f"{folder}.c").write_text(using(folder, "pid"))
        assert compiled("-c", f"{folder}/pid.c", "-o", f"pid_{folder}.o")[0] == 0
        subprocess.run(["ar", "rcs", f"{folder}.a", f"pid_{folder}.o"], cwd=tmp_path, check=True)
    (tmp_path / "main.c").write_text(
        "void use_a(void); void use_b(void); int main(void) { use_a(); use_b(); return 0; }\n"
    )
    code, err = compiled("main.c", "a.c", "b.c", "a.a", "b.a", "-o", "program")
    assert code != 0  # a linker would take the first of each name from the archives
    assert "pid_update" in err


def test_parameters_that_may_change_are_numbers_of_the_constants():
    exported = ExportedController(LAWS["fuzzy_pid"], LAWS["fuzzy_pid"].config())
    names = [leaf.declaration.name for leaf in exported.leaves]
    assert names == ["gains.p_min", "gains.p_max", "gains.d_min", "gains.d_max"]


def test_the_text_says_where_it_comes_from():
    config = LAWS["fuzzy_pid"].config()
    exported = ExportedController(LAWS["fuzzy_pid"], config)
    text = base_files(exported, exported.answers(2))["fuzzy_pid.c"].decode()
    for piece in (
        f"parameters  {exported.digest}",
        f"sources     {exported.fingerprint}",
        "arithmetic  portable-1",
        "licence     Apache-2.0",
        "static const double alpha",
        "static const double elementary_2_PI = 0x1.921fb54442d18p+2 /* 6.283185307179586 */;",
        "/* trunk_control.fuzzy.infer: Return (Kp', Kd', alpha) by product inference",
    ):
        assert piece in text
    assert not re.search(r"malloc|\bsqrt\b|printf", text)
    other = ExportedController(LAWS["fuzzy_pid"], replace(config, p_min=31.0))
    assert (other.digest != exported.digest, other.fingerprint) == (True, exported.fingerprint)


def test_random_inputs_are_the_same_each_time():
    exported = ExportedController(LAWS["pid"], LAWS["pid"].config())
    assert exported.answers(20) == exported.answers(20)
    assert np.isfinite([row.effort for row in exported.answers(20)]).all()
