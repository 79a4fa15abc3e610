from __future__ import annotations

import shutil
import subprocess

import pytest
import yaml

from .c_programs import needs_compiler

STUBS = {
    "controller_interface/chainable_controller_interface.hpp": """
#pragma once
#include <memory>
#include <string>
#include <vector>
namespace rclcpp { class Time { public: long nanoseconds() const { return 0; } }; class Duration {}; }
namespace rclcpp_lifecycle {
class State {};
class LifecycleNode { public: const char * get_name() const { return "x"; } };
}
namespace hardware_interface {
struct CommandInterface {
    CommandInterface(const std::string &, const std::string &, double *) {}
    bool set_value(double) { return true; }
    double get_value() const { return 0.0; }
};
}
namespace controller_interface {
enum class CallbackReturn { SUCCESS, FAILURE, ERROR };
enum class return_type { OK, ERROR };
enum class interface_configuration_type { ALL, INDIVIDUAL, NONE };
struct InterfaceConfiguration { interface_configuration_type type; std::vector<std::string> names; };
class ChainableControllerInterface {
  public:
    virtual ~ChainableControllerInterface() = default;
    virtual CallbackReturn on_init() = 0;
    virtual InterfaceConfiguration command_interface_configuration() const = 0;
    virtual InterfaceConfiguration state_interface_configuration() const = 0;
    virtual CallbackReturn on_configure(const rclcpp_lifecycle::State &) = 0;
    virtual CallbackReturn on_activate(const rclcpp_lifecycle::State &) = 0;
    virtual CallbackReturn on_deactivate(const rclcpp_lifecycle::State &) = 0;
    virtual return_type update_and_write_commands(const rclcpp::Time &, const rclcpp::Duration &) = 0;
    std::shared_ptr<rclcpp_lifecycle::LifecycleNode> get_node() const { return {}; }

  protected:
    virtual std::vector<hardware_interface::CommandInterface> on_export_reference_interfaces() = 0;
    virtual bool on_set_chained_mode(bool) = 0;
    virtual return_type update_reference_from_subscribers(
        const rclcpp::Time &, const rclcpp::Duration &) = 0;
    std::vector<hardware_interface::CommandInterface> command_interfaces_, state_interfaces_;
    std::vector<double> reference_interfaces_;
};
}
""",
    "pluginlib/class_list_macros.hpp": "#define PLUGINLIB_EXPORT_CLASS(a, b)\n",
}
ARDUINO = """
#include <stdio.h>
struct Port {
    explicit operator bool() const { return true; }
    void begin(long) {}
    void print(const char *s) { fputs(s, stdout); }
    void print(long n) { printf("%ld", n); }
    void println(const char *s) { puts(s); }
};
static Port Serial;
static unsigned long micros() { return 5; }
#include "equal.ino"
int main() { setup(); loop(); return now_ns() == 5000 ? 0 : 1; }
"""


def struct_of(tree):
    """Return a C++ struct like generate_parameter_library's."""
    lines = []
    for name, value in tree.items():
        if "type" in value and isinstance(value["type"], str):
            kind = {"string": "std::string", "double": "double"}[value["type"]]
            lines.append(f"{kind} {name};")
        else:
            lines.append(f"struct {{ {struct_of(value)} }} {name};")
    return " ".join(lines)


def compiled(words, folder):
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@needs_compiler
@pytest.mark.skipif(shutil.which("g++") is None, reason="no C++ compiler: apt-get install g++")
@pytest.mark.parametrize(
    ("law", "name"),
    [("fuzzy_pid", "fuzzy_pid"), ("computed_torque", "computed_torque"), ("fuzzy_pid", "left_hip")],
)
def test_the_plug_in_compiles_against_stub_headers(law, name, command_says, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, _, err = command_says("export-c", law, "--name", name, "-o", "c", "--ros2-control")
    assert code == 0, err
    folder = tmp_path / "c" / f"{name}_controller"
    tree = yaml.safe_load((folder / f"{name}_controller_parameters.yaml").read_text())
    parameters = tree[f"{name}_controller"]
    for path, text in STUBS.items():
        (folder / path).parent.mkdir(exist_ok=True)
        (folder / path).write_text(text)
    (folder / f"{name}_controller_parameters.hpp").write_text(
        f"""#pragma once
#include <memory>
#include <string>
namespace {name}_controller {{
struct Params {{ {struct_of(parameters)} }};
class ParamListener {{
  public:
    explicit ParamListener(std::shared_ptr<rclcpp_lifecycle::LifecycleNode>) {{}}
    Params get_params() {{ return {{}}; }}
    bool is_old(const Params &) {{ return false; }}
}};
}}
"""
    )
    words = [
        "g++",
        "-std=c++17",
        "-Wall",
        "-Wextra",
        "-Werror",
        "-I.",
        "-c",
        f"{name}_controller.cpp",
    ]
    compiled(words, folder)
    default = parameters["gains"]["p_max" if law == "fuzzy_pid" else "p"]["default_value"]
    assert default == {"fuzzy_pid": 60.0, "computed_torque": 100.0}[law]


@needs_compiler
@pytest.mark.skipif(shutil.which("g++") is None, reason="no C++ compiler: apt-get install g++")
@pytest.mark.parametrize("flags", [(), ("-fsingle-precision-constant",)], ids=["plain", "Teensy"])
def test_the_sketch_says_equal(flags, command_says, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, _, err = command_says("export-c", "pid", "--name", "hip", "-o", "c", "--arduino")
    assert code == 0, err
    library = tmp_path / "c" / "arduino" / "hip"
    sketch = library / "examples" / "equal"
    (sketch / "main.cpp").write_text(ARDUINO)
    source = str(library / "src" / "hip.c")
    compiled(["gcc", "-std=c99", "-O2", *flags, "-c", source, "-o", "hip.o"], sketch)
    flags = [*flags, "-std=gnu++17", "-Wall", "-Wextra", f"-I{library / 'src'}"]
    compiled(["g++", *flags, "main.cpp", "hip.o", "-o", "sketch"], sketch)
    done = subprocess.run([str(sketch / "sketch")], capture_output=True, text=True, check=True)
    assert done.stdout == "200 of 200 commands equal\n"


@pytest.mark.parametrize(
    ("words", "line"),
    [
        ("export-c fuzy -o c", "did you mean 'fuzzy'"),
        ("export-c pid", "--output"),
        ("export-c pid -o a.mcap", "it is not a folder"),
        ("export-c pid -o c --like missing.mcap", "missing.mcap"),
        ("export-c lqr -o c --like a.mcap", "give a recording with lqr"),
        ("export-c pid -o c --like a.mcap --set pid.gains.p=61", "gains.p = 60.0, not 61.0"),
        ("export-c pid -o c --params missing.yaml", "missing.yaml"),
        ("export-c pid -o c --set pid.gains.q=1", "gains.q"),
        ("export-c pid -o c --set lqr.u_clamp_max=3", "nothing in it is for pid: it is for lqr"),
        ("export-c pid -o c --params fuzzy_log", "give parameters of pid"),
        ("export-c pid -o c --law --ros2-control", "leave out --law"),
        *(
            (f"export-c pid -o c --name={name}", f"--name {name}: allowed are up to 64 letters")
            for name in (
                "3rd",
                "int",
                "left-hip",
                "left__hip",
                "_left",
                "String",
                "replay",
                "näme",
                "",
            )
        ),
    ],
)
def test_a_mistake_is_one_line(words, line, recordings_here, command_says):
    code, out, err = command_says(*words.split())
    assert code != 0
    assert out == ""
    assert line in err
    assert err.count("\n") == 1
    assert not (recordings_here / "c").exists()


def test_nothing_is_overwritten_unless_asked(command_says, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "c"
    folder.mkdir()
    (folder / "pid.c").write_text("mine")
    (folder / "other.c").write_text("mine")
    code, _, err = command_says("export-c", "pid", "-o", "c")
    assert code != 0
    assert "the folder is not empty: give another, or --force" in err
    assert (folder / "pid.c").read_text() == "mine"
    assert command_says("export-c", "pid", "-o", "c", "--force")[0] == 0
    assert (folder / "pid.c").read_text() != "mine"
    assert (folder / "other.c").read_text() == "mine"


def test_what_is_read_is_not_written_over_even_when_asked(command_says, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = "pid:\n  ros__parameters:\n    gains.p: 61.0\n"
    (tmp_path / "pid.h").write_text(text)
    code, _, err = command_says("export-c", "pid", "--params", "pid.h", "-o", ".", "--force")
    assert (code, "pid.h: it is read by this command" in err) == (2, True)
    assert [path.name for path in tmp_path.iterdir()] == ["pid.h"]
    assert (tmp_path / "pid.h").read_text() == text
