"""The exported CMakeLists.txt, built: alone, with its test, and two controllers in another project."""

import shutil
import subprocess

import pytest

from ...trunk_core.test.c_programs import needs_compiler

pytestmark = [
    needs_compiler,
    pytest.mark.slow,
    pytest.mark.skipif(shutil.which("cmake") is None, reason="no cmake: apt-get install cmake"),
]
# CMakeLists of a project: two of one law, one of another.
EXPORTS = {"lqr": "lqr", "pid": "pid", "left_hip": "pid"}
PROJECT = """cmake_minimum_required(VERSION 3.13)
project(robot C)
add_subdirectory(lqr)
add_subdirectory(pid)
add_subdirectory(left_hip)
add_executable(robot main.c)
target_link_libraries(robot PRIVATE lqr pid left_hip)
"""
MAIN = """#include "lqr.h"
#include "pid.h"
#include "left_hip.h"
int main(void) { return lqr_self_test() + pid_self_test() + left_hip_self_test() == LEFT_HIP_SOUND ? 0 : 1; }
"""


def run(*words):
    done = subprocess.run(list(map(str, words)), capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.parametrize("kind", ["Debug", "Release"])
def test_the_library_and_its_replay(kind, command_says, tmp_path):
    code, _, err = command_says("export-c", "fuzzy_pid", "-o", tmp_path / "c")
    assert code == 0, err
    built = tmp_path / "built"
    run("cmake", "-S", tmp_path / "c", "-B", built, f"-DCMAKE_BUILD_TYPE={kind}")
    run("cmake", "--build", built)
    said = run("cmake", "-E", "chdir", built, "ctest", "--verbose")
    assert "2000 of 2000 commands equal" in said
    assert "100% tests passed" in said


def test_three_controllers_in_another_project(command_says, tmp_path):
    for name, law in EXPORTS.items():
        words = ("export-c", law, "--name", name, "-o", tmp_path / name)
        assert command_says(*words)[0] == 0
    (tmp_path / "CMakeLists.txt").write_text(PROJECT)
    (tmp_path / "main.c").write_text(MAIN)
    run("cmake", "-S", tmp_path, "-B", tmp_path / "built")
    run("cmake", "--build", tmp_path / "built")
    run(tmp_path / "built" / "robot")
