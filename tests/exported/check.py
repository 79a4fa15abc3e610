"""Exported controllers on every compiler and processor that there is, with random states."""

import platform
import random
import re
import shutil
import sys
import tempfile
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from string import Template
from types import ModuleType
from typing import NamedTuple

from ros2_ws.src.trunk_control.test.exported_laws import CHANGES, readings

from trunk_control.controller import Controller
from trunk_control.law import ControllerConfig, Law
from trunk_control.laws import law_named
from trunk_experiments.export_c.library import (
    ExportedController,
    ExportedStep,
    base_files,
    fill_from_bytes,
)
from trunk_runs.nodes import CONTROLLERS

from ..finished import finished
from .loops import differs, plans_of_one_loop

ROOT = Path(__file__).resolve().parents[2]
BOARD = ROOT / "examples" / "cortex_m"
HERE = Path(__file__).parent


class Environment(NamedTuple):
    """A compiler with its flags, and what runs its programs; ``needs``: the tools besides the compiler."""

    name: str
    compiler: str
    flags: tuple[str, ...]
    runner: tuple[str, ...] = ()
    needs: tuple[str, ...] = ()


def _board(machine: str) -> tuple[str, ...]:
    return ("qemu-system-arm", "-M", machine, "-nographic", "-monitor", "none", "-serial", "none")


def environments() -> Iterator[Environment]:
    """Yield the environments, whether or not their tools are installed."""
    for compiler in ("gcc", "clang"):
        for level in ("-O0", "-O2", "-O3", "-Os"):
            yield Environment(f"{compiler} {level}", compiler, (level,))
        yield Environment(f"{compiler} -O3 -march=native", compiler, ("-O3", "-march=native"))
    if platform.machine() == "x86_64":
        yield Environment("gcc -O2 -mno-fma", "gcc", ("-O2", "-mno-fma"))
    yield Environment(
        "armhf, qemu-arm",
        "arm-linux-gnueabihf-gcc",
        ("-O2", "-static"),
        ("qemu-arm",),
        ("qemu-arm",),
    )
    bare = (
        "-mthumb",
        "--specs=rdimon.specs",
        "-T",
        str(BOARD / "mps2.ld"),
        str(BOARD / "startup.c"),
    )
    m4 = ("-O2", "-mcpu=cortex-m4", "-mfloat-abi=soft", *bare)
    m7 = ("-O2", "-mcpu=cortex-m7", "-mfpu=fpv5-d16", "-mfloat-abi=hard", *bare)
    compiler, needs = "arm-none-eabi-gcc", ("qemu-system-arm",)
    yield Environment("Cortex-M4, soft doubles, qemu", compiler, m4, _board("mps2-an386"), needs)
    yield Environment("Cortex-M7, hard doubles, qemu", compiler, m7, _board("mps2-an500"), needs)
    wasm = (
        "--target=wasm32",
        "-O2",
        "-ffreestanding",
        "-fno-builtin",
        "-nostdlib",
        "-Wl,--no-entry",
    )
    yield Environment("wasm32, Node", "clang", wasm, ("node",), ("wasm-ld", "node"))


def template_law() -> Law:
    """Return the law that `trunk controller new` writes, as somebody else's package would have it."""
    import trunk_experiments

    folder = Path(trunk_experiments.__path__[0]) / "templates" / "controller" / "package"
    text = Template((folder / "law.py.in").read_text()).substitute(
        name="my_controller", label="My controller", package="my_controller"
    )
    place = Path(tempfile.mkdtemp(prefix="trunk-law-")) / "my_law.py"
    place.write_text(text)
    return _law_in(place)


def _law_in(place: Path) -> Law:
    import importlib.util

    spec = importlib.util.spec_from_file_location(place.stem, place)
    assert spec is not None
    assert spec.loader is not None
    module: ModuleType = importlib.util.module_from_spec(spec)
    sys.modules[place.stem] = module
    spec.loader.exec_module(module)
    law: Law = module.LAW
    return law


def laws() -> Iterator[tuple[Law, ControllerConfig]]:
    """Yield the laws to export and their configurations, off the beaten track; the last two are others'."""
    for name in CONTROLLERS:
        law = law_named(name)
        yield law, law.config(**CHANGES.get(name, {}))
    law = template_law()
    yield law, law.config()
    law = _law_in(HERE / "pi_with_damping.py")
    yield law, law.config(active_times=(1.0, 40.0, 41.0))


def rows_of(law: Law, config: ControllerConfig, count: int) -> list[ExportedStep]:
    """Return random states and CPython's answers."""
    controller = Controller(config, law)
    rows = []
    for reading in readings(random.Random(law.name), count):
        output = controller.decide(reading)
        rows.append(ExportedStep(reading, output.effort, output.active))
    return rows


def write(folder: Path, exported: ExportedController, rows: list[ExportedStep]) -> None:
    """Write an exported controller with these rows, and its WebAssembly side."""
    for name, text in base_files(exported, rows).items():
        (folder / name).write_bytes(text)
    text = Template((HERE / "wasm.c.in").read_text()).substitute(
        name=exported.name, bytes=80 * 1000, fill=fill_from_bytes(exported)
    )
    (folder / "wasm.c").write_text(text)


def outcome(environment: Environment, folder: Path, name: str) -> str:
    """Return what a program says of the rows in a folder; why there is none, where it cannot be built."""
    main = "wasm.c" if "wasm32" in environment.name else "replay.c"
    program = folder / "program"
    words = [
        environment.compiler,
        "-std=c99",
        *environment.flags,
        f"{name}.c",
        main,
        "-o",
        str(program),
    ]
    built = finished(words, cwd=folder)
    if built.returncode:
        return f"not built: {' '.join(built.stderr.split())[:300]}"
    states = f"{name}.states"
    if main == "wasm.c":
        command = [*environment.runner, str(HERE / "wasm.mjs"), str(program), states]
    elif environment.runner[:1] == ("qemu-system-arm",):
        arguments = f"enable=on,target=native,arg=replay,arg={states}"
        command = [*environment.runner, "-semihosting-config", arguments, "-kernel", str(program)]
    else:
        command = [*environment.runner, str(program), states]
    done = finished(command, cwd=folder)
    return " ".join(done.stdout.split())


def main() -> int:
    """Run the check; print a table."""
    numbers = [int(text) if text.isdecimal() else 0 for text in sys.argv[1:]]
    if len(numbers) > 2 or 0 in numbers[:1]:
        print("check_export: STATES and PLANS are whole numbers, STATES above 0", file=sys.stderr)
        return 2
    states, plans = [*numbers, *(100_000, 200)[len(numbers) :]]
    wrong = 0
    with tempfile.TemporaryDirectory(prefix="trunk-export-") as place:
        for law, config in laws():
            folder = Path(place) / law.name
            folder.mkdir()
            write(folder, ExportedController(law, config), rows_of(law, config, states))
            for environment in environments():
                tools = (environment.compiler, *environment.needs)
                if missing := [tool for tool in tools if shutil.which(tool) is None]:
                    print(f"{law.name:16} {environment.name:32} skipped: no {', '.join(missing)}")
                    continue
                said = outcome(environment, folder, law.name)
                equal = re.fullmatch(r"(\d+) of \1 commands equal", said) is not None
                wrong += not equal
                print(f"{law.name:16} {environment.name:32} {said}", flush=True)
    wrong += different_plans(plans)
    print("0 bits differ" if not wrong else f"DIFFERENT: {wrong}")
    return 1 if wrong else 0


def different_plans(count: int) -> int:
    """Return how many of the first random plans have other bits in the closed loop in C."""
    different = 0
    for number, plan in enumerate(islice(plans_of_one_loop(), count), 1):
        different += differs(plan)
        if number % 20 == 0 or number == count:
            equal = f"{number - different} of {number} random plans equal"
            print(f"closed loop: {equal}", flush=True)
    return different


if __name__ == "__main__":
    sys.exit(main())
