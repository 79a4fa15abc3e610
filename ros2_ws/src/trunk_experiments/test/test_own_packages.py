"""Controllers and plants of other packages, by their entry points: a bad one is one line, the others work."""

import json
import os
import re
import shutil
import subprocess
import sys
from itertools import product
from pathlib import Path

import pytest

from trunk_experiments.console.own_packages import controller_package, plant_package
from trunk_runs.nodes import CONTROLLERS
from trunk_sim.plants import cart_pole


def install(
    site: Path, package: str, *entries: str, module: str = "", group: str = "trunk.controllers"
) -> None:
    """Put a package's metadata and one module into a folder, as pip would."""
    folder = site / f"{package}-0.1.dist-info"
    folder.mkdir(parents=True)
    (folder / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 0.1\n")
    (folder / "entry_points.txt").write_text("\n".join([f"[{group}]", *entries]))
    if module:
        (site / f"{package}.py").write_text(module)


def python(site: Path, code: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    path = os.pathsep.join([str(site), os.environ["PYTHONPATH"]])
    return subprocess.run(
        [sys.executable, "-c", code, *arguments],
        env={**os.environ, "PYTHONPATH": path},
        cwd=site,
        capture_output=True,
        text=True,
        check=False,
    )


def trunk(site: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return python(site, "from trunk_experiments.cli import main; main()", *arguments)


def own_law(folder: Path, old: str = "", new: str = "") -> str:
    """Return the law of a new package, with a text in it replaced."""
    for _ in controller_package("mine", folder / "mine_source"):
        pass
    law = (folder / "mine_source" / "mine" / "law.py").read_text()
    assert old in law
    return law.replace(old, new)


ONE_OF_OURS = "from trunk_control.pid import LAW\n"
BAD = {
    "raises": (
        "mine = raises:LAW",
        "raise ValueError('no\\nlicence')",
        "controller 'mine' of package raises (raises:LAW) cannot be loaded: ValueError: no licence",
    ),
    "ends": ("mine = ends:LAW", "raise SystemExit(3)", "cannot be loaded: SystemExit: 3"),
    "absent": ("mine = absent:LAW", "", "cannot be loaded: ModuleNotFoundError"),
    "other": ("mine = other:LAW", "LAW = 3", "is int: a trunk_control.law.Law is needed"),
    "misnamed": ("mine = misnamed:LAW", ONE_OF_OURS, "calls itself 'pid'"),
    "spelled": ("My-Law = spelled:LAW", ONE_OF_OURS, "a name of lowercase letters"),
    "a_node": ("recorder = a_node:LAW", ONE_OF_OURS, "another node has the name"),
}


@pytest.mark.slow
@pytest.mark.one_in(3)
@pytest.mark.parametrize(("entry", "module", "told"), BAD.values(), ids=BAD)
def test_a_bad_controller_gives_one_line_and_the_others_go_on(
    tmp_path: Path, entry: str, module: str, told: str
) -> None:
    install(tmp_path, entry.split(" = ")[1].split(":")[0], entry, module=module)
    run = trunk(tmp_path, "list", "controllers")
    assert run.returncode == 0, run.stderr
    assert [line.split()[0] for line in run.stdout.splitlines()] == list(CONTROLLERS)
    (line,) = run.stderr.splitlines()
    assert line.startswith("trunk: warning: ")
    assert told in line
    assert line.endswith("; the other controllers can be used")


def test_two_controllers_of_one_name_are_refused_naming_both_packages(tmp_path: Path) -> None:
    install(tmp_path, "first", "mine = first:LAW", module=ONE_OF_OURS)
    install(tmp_path, "second", "mine = second:LAW", module=ONE_OF_OURS)
    run = trunk(tmp_path, "controller", "check", "mine")
    assert run.returncode == 2
    line = run.stderr.splitlines()[-1]
    assert "package first (first:LAW) and package second (second:LAW)" in line
    assert "uninstall or rename the other" in line


REMEMBERS = "effort: float = 0.0  # N m, the last command"


@pytest.mark.one_in(4)
@pytest.mark.slow
@pytest.mark.parametrize("remembered", ["", '\n    past: str = "none"'])
def test_a_law_that_numba_refuses_is_swept_by_cpython_and_mapped(
    tmp_path: Path, remembered: str
) -> None:
    law = own_law(tmp_path, "    wanted = ", "    _ = {str(k): k for k in range(2)}\n    wanted = ")
    law = law.replace(REMEMBERS, REMEMBERS + remembered)
    install(tmp_path, "mine", "mine = mine:LAW", module=law)
    (tmp_path / "study.yaml").write_text(
        "scenario: demo\ncontrollers: [mine]\nset: {simulator.duration: 1.0}\n"
        "vary: {m: {parameter: simulator.plant.trunk_mass, from: 0.4, to: 0.6, steps: 5}}\n"
    )
    swept = trunk(tmp_path, "sweep", "study.yaml", "-o", "study.parquet")
    assert "5 runs: 5 ok, 0 diverged, 0 refused" in swept.stdout, swept.stderr
    assert "not compilable" in swept.stderr
    mapped = trunk(tmp_path, "study", "map", "study.parquet", "-o", "map.png", "--json")
    assert mapped.returncode == 0, mapped.stderr
    (panel,) = json.loads(mapped.stdout)["panels"]
    if remembered:
        line = next(one for one in mapped.stderr.splitlines() if "warning" in one)
        assert line.startswith("trunk: warning: mine: without Floquet multipliers: mine cannot be")
        assert line.endswith("its memory.past is 'none', not a number")
    assert (panel["growth"] is None) == bool(remembered)


@pytest.mark.one_in(4)
@pytest.mark.slow
def test_an_exception_in_a_law_gives_one_line_with_its_place(tmp_path: Path) -> None:
    law = own_law(tmp_path, "    wanted = ", "    unknown, of_two = (1.0,)\n    wanted = ")
    install(tmp_path, "mine", "mine = mine:LAW", module=law)
    line = 1 + law.splitlines().index("    unknown, of_two = (1.0,)")
    said = f"mine.py, line {line}, in update: ValueError: not enough values to unpack"
    short = ("--controller", "mine", "--duration", "0.2", "-o", "a.mcap")
    run = trunk(tmp_path, "simulate", "fig8", *short)
    assert run.returncode == 2
    assert "Traceback" not in run.stderr
    assert said in run.stderr.splitlines()[-1]
    assert run.stderr.splitlines()[-1].endswith("; trunk controller check mine tests it alone")
    assert not (tmp_path / "a.mcap").exists()
    check = trunk(tmp_path, "controller", "check", "mine")
    found = [one for one in check.stdout.splitlines() if "ValueError" in one]
    assert len(found) == 1
    assert f"update, line {line}: raises ValueError" in found[0]


def test_a_node_whose_law_cannot_be_loaded_says_so_in_one_line(tmp_path: Path) -> None:
    install(tmp_path, "mine", "mine = mine:LAW", module="import no_such_module\n")
    node = python(tmp_path, "from trunk_control.executables import of_law; of_law('mine')()")
    assert node.returncode == 2
    (line,) = node.stderr.splitlines()
    assert "cannot be loaded: ModuleNotFoundError: No module named 'no_such_module'" in line


@pytest.mark.slow
def test_a_recording_names_the_package_and_its_sources(tmp_path: Path) -> None:
    law = own_law(tmp_path)
    install(tmp_path, "mine", "mine = mine:LAW", module=law)
    run = ("simulate", "fig8", "--controller", "mine", "--duration", "0.2", "-o", "a.mcap")
    assert trunk(tmp_path, *run).returncode == 0
    assert "package mine" not in trunk(tmp_path, "verify", "a.mcap").stdout
    (tmp_path / "mine.py").write_text(law.replace("limited(wanted", "limited(1.01 * wanted"))
    found = trunk(tmp_path, "verify", "a.mcap")
    assert found.returncode == 1
    (line,) = [line for line in found.stdout.splitlines() if "package mine" in line]
    assert re.search(
        r"package mine: recorded with 0\.1, sources (\w{12}); here 0\.1, sources (?!\1)\w{12}$",
        line,
    )
    # A run with our controllers alone does not need the package.
    ours = ("simulate", "fig8", "--controller", "pid", "--duration", "0.2", "-o", "pid.mcap")
    assert trunk(tmp_path, *ours).returncode == 0
    (tmp_path / "mine.py").write_text(law)
    assert "package mine" not in trunk(tmp_path, "verify", "pid.mcap").stdout


def test_a_module_beside_a_law_is_not_the_law(tmp_path: Path) -> None:
    """A law that is a single module shares its folder with other packages."""
    install(tmp_path, "mine", "mine = mine:LAW", module=own_law(tmp_path))
    (tmp_path / "other.py").write_text("def divide():\n    return 1 / 0\n")
    code = (
        "import other\nfrom trunk_runs.nodes import fault_of_a_law\n"
        "try:\n    other.divide()\nexcept ZeroDivisionError as error:\n"
        "    print(repr(fault_of_a_law(error)))\n"
    )
    run = python(tmp_path, code)
    assert run.stdout == "''\n", run.stderr


@pytest.mark.slow
@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    ("kind", "name"),
    [
        *(("controller", name) for name in ("pid", "simulator", "mine-too", "_mine", "9mine")),
        ("plant", "cart_pole"),
        *product(("controller", "plant"), ("Mine", "m__e", "class", "numpy", "x")),
    ],
)
def test_names_that_a_new_package_cannot_have(tmp_path: Path, kind: str, name: str) -> None:
    run = trunk(tmp_path, kind, "new", name)
    assert run.returncode == 2
    assert len(run.stderr.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_exists_is_left_as_it_is(tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    run = trunk(tmp_path, "controller", "new", "mine")
    assert run.returncode == 2
    assert "exists, and nothing was written: choose another name or --path" in run.stderr
    assert list((tmp_path / "mine").iterdir()) == []


# Plants -----------------------------------------------------------------------------------------------------


def own_plant(folder: Path, old: str = "", new: str = "") -> str:
    """Return the module of a new plant's package, with a text in it replaced."""
    for _ in plant_package("mine", folder / "mine_source"):
        pass
    module = (folder / "mine_source" / "mine" / "plant.py").read_text()
    assert old in module
    return module.replace(old, new)


TWO = '(Coordinate("cart", "m"), Coordinate("pole", "rad"))'
BAD_PLANTS = {
    "absent": ("", "", "mine = no_such:PLANT", "cannot be loaded: ModuleNotFoundError"),
    "a_class": ("", "", "mine = mine:Plant", "is type: a trunk_sim.plant.Plant is needed"),
    "misnamed": ('"mine"', '"yours"', "mine = mine:PLANT", "calls itself 'yours'"),
    "three": (
        TWO,
        TWO.replace("))", '), Coordinate("arm", "rad"))'),
        "mine = mine:PLANT",
        "TypeError: plant 'mine': 3 coordinates: two are needed",
    ),
    "in_metres": (
        'Coordinate("pole", "rad")',
        'Coordinate("pole", "m")',
        "mine = mine:PLANT",
        "coordinates in 'm' and 'm': the first in m or rad, the second, which is held, in rad",
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize(("old", "new", "entry", "told"), BAD_PLANTS.values(), ids=BAD_PLANTS)
def test_a_bad_plant_gives_one_line_and_the_others_go_on(
    tmp_path: Path, old: str, new: str, entry: str, told: str
) -> None:
    install(tmp_path, "mine", entry, module=own_plant(tmp_path, old, new), group="trunk.plants")
    check = trunk(tmp_path, "plant", "check", "mine")
    assert check.returncode == 2
    assert check.stdout == ""
    (line,) = check.stderr.splitlines()
    assert line.startswith("trunk: error: plant 'mine' of package mine (")
    assert told in line
    listed = trunk(tmp_path, "list", "plants")
    assert listed.returncode == 0, listed.stderr
    assert [line.split()[0] for line in listed.stdout.splitlines()] == ["trunk", "cart_pole"]
    (line,) = listed.stderr.splitlines()
    assert line.startswith("trunk: warning: plant 'mine'")
    assert line.endswith("; the other plants can be used")


def test_a_plant_that_is_not_registered_is_told_how(tmp_path: Path) -> None:
    check = trunk(tmp_path, "plant", "check", "mine")
    assert check.returncode == 2
    (line,) = check.stderr.splitlines()
    assert "'mine': give one of trunk, cart_pole; build and source your own package first" in line


def test_two_plants_of_one_name_are_refused_naming_both_packages(tmp_path: Path) -> None:
    for package in ("first", "second"):
        install(
            tmp_path,
            package,
            f"mine = {package}:PLANT",
            module=own_plant(tmp_path / package),
            group="trunk.plants",
        )
    check = trunk(tmp_path, "plant", "check", "mine")
    assert check.returncode == 2
    (line,) = check.stderr.splitlines()
    assert "package first (first:PLANT) and package second (second:PLANT)" in line
    assert "uninstall or rename the other" in line


def test_a_new_plant_is_the_cart_pole_but_for_its_names(tmp_path: Path) -> None:
    shipped = Path(cart_pole.__file__).read_text().splitlines()
    differing = [
        (old, new)
        for old, new in zip(shipped, own_plant(tmp_path).splitlines(), strict=True)
        if old != new
    ]
    assert ('    "cart_pole",', '    "mine",') in differing
    assert ('    "Cart-pole",', '    "Mine",') in differing
    assert all("CartPole" in old for old, _ in differing[:-3])


@pytest.mark.slow
def test_a_new_plants_package_runs_verifies_and_conforms(tmp_path: Path) -> None:
    files = list(plant_package("mine", tmp_path / "mine_source"))
    assert {path.name for path in files} >= {"package.xml", "setup.py", "plant.py", "upright.yaml"}
    setup = (tmp_path / "mine_source" / "setup.py").read_text()
    assert '"trunk.plants": ["mine = mine.plant:PLANT"]' in setup
    shutil.copytree(tmp_path / "mine_source" / "mine", tmp_path / "mine")
    install(tmp_path, "mine", "mine = mine.plant:PLANT", group="trunk.plants")
    scenario = ("mine/config/upright.yaml", "--controller", "pid", "-o", "a.mcap")
    run = trunk(tmp_path, "simulate", *scenario)
    assert run.returncode == 0, run.stderr
    assert "a.mcap: verified" in trunk(tmp_path, "verify", "a.mcap").stdout
    test = (tmp_path / "mine_source" / "test" / "test_conformance.py").read_text()
    assert "from trunk_experiments.conformance.plant import CHECKS, conformance" in test
    check = trunk(tmp_path, "plant", "check", "mine", "--json")
    assert check.returncode == 0, check.stdout
    document = json.loads(check.stdout)
    assert (document["label"], document["package"], document["kept"]) == ("Mine", "mine", True)
