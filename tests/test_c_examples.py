"""The examples around an exported controller compile, and the sketch commands."""

import shutil
import subprocess
from pathlib import Path

import pytest
from click.testing import CliRunner

from trunk_experiments.cli import trunk

EXAMPLES = Path(__file__).parents[1] / "examples"
STUBS = {
    "controller_interface/chainable_controller_interface.hpp": """
#pragma once
#include <memory>
#include <string>
#include <vector>
namespace rclcpp { class Time { public: long nanoseconds() const { return 0; } }; class Duration {}; }
namespace rclcpp_lifecycle {
class State {};
struct Parameter {
    std::string as_string() const { return ""; }
    double as_double() const { return 0.0; }
};
class LifecycleNode {
  public:
    const char * get_name() const { return "x"; }
    Parameter get_parameter(const std::string &) const { return {}; }
};
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
    template <typename T> T auto_declare(const std::string &, const T & value) { return value; }
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
    void begin(long) {}
    void println(int n) { printf("fault %d\\n", n); }
};
static Port Serial;
enum { A0, A1 };
static unsigned long micros() { return 5; }
static void delay(int) {}
static int analogRead(int pin) { return pin == A0 ? 612 : 512; }
static void analogWrite(int, int value) { printf("%d\\n", value); }
#include "arduino.ino"
int main() { setup(); loop(); }
"""
needs_compiler = pytest.mark.skipif(shutil.which("g++") is None, reason="apt-get install g++")


def exported(example, tmp_path, *settings):
    """Return a copy of an example's folder with an exported PID in it."""
    folder = shutil.copytree(EXAMPLES / example, tmp_path / Path(example).name)
    words = ["export-c", "pid", "--name", "controller", "-o", str(tmp_path / "c")]
    words += [word for setting in settings for word in ("--set", setting)]
    done = CliRunner().invoke(trunk, words)
    assert done.exit_code == 0, done.output
    for name in ("controller.h", "controller.c"):
        shutil.copy(tmp_path / "c" / name, folder)
    return folder


def compiled(words, folder):
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@needs_compiler
def test_the_plug_in_compiles_against_stub_headers(tmp_path):
    folder = exported("ros2_control/plugin", tmp_path)
    for path, text in STUBS.items():
        (folder / path).parent.mkdir(exist_ok=True)
        (folder / path).write_text(text)
    compiled(
        ["g++", "-std=c++17", "-Wall", "-Wextra", "-Werror", "-I.", "-c", "plugin.cpp"], folder
    )


@needs_compiler
@pytest.mark.parametrize("flags", [(), ("-fsingle-precision-constant",)], ids=["plain", "Teensy"])
def test_the_sketch_answers_a_state(flags, tmp_path):
    folder = exported("arduino", tmp_path, "pid.gains.p=10.0", "pid.gains.i=0.0")
    (folder / "main.cpp").write_text(ARDUINO)
    compiled(["gcc", "-std=c99", "-O2", *flags, "-c", "controller.c"], folder)
    words = [*flags, "-std=gnu++17", "-Wall", "-Wextra", "main.cpp", "controller.o"]
    compiled(["g++", *words, "-o", "sketch"], folder)
    done = subprocess.run([folder / "sketch"], capture_output=True, text=True, check=True)
    assert done.stdout == "124\n", "128 - 1.27 * 10 N m/rad * 0.3 rad"
