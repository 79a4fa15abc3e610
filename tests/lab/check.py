"""Random experiments of labs in Node, Chromium and Firefox against the project's own runs, and saved files.

python -m tests.lab.check [EXPERIMENTS] [FILES]: how many of each; exit code 1 if a bit differs.
"""

import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from trunk_experiments.lab.data import write

from .experiments import (
    LAWS,
    Setup,
    equal_bits,
    in_node,
    in_page,
    lab_for,
    plan_with,
    plans_of,
    random_setup,
    refused,
    table_of,
)
from .firefox import PROGRAM, Firefox
from .test_runs import CASES
from .test_saved_files import compare

Evaluate = Callable[[str], Any]


@contextmanager
def chromium(page: Path) -> Iterator[Evaluate]:
    """Yield what evaluates an expression in a page in Chromium."""
    from playwright.sync_api import sync_playwright

    script = Path(__file__).parents[2] / "scripts" / "browser.sh"
    program = subprocess.run(["bash", script], capture_output=True, text=True, check=True).stdout
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program.strip())
        tab = browser.new_context(bypass_csp=True).new_page()
        tab.set_default_timeout(0)
        tab.goto(page.as_uri())
        yield tab.evaluate
        browser.close()


@contextmanager
def firefox(page: Path) -> Iterator[Evaluate]:
    """Yield what evaluates an expression in a page in Firefox."""
    with tempfile.TemporaryDirectory() as folder, Firefox(Path(folder)) as browser:
        browser.open(page.as_uri())
        yield browser.evaluate


def compared(
    scenario: str, settings: Sequence[str], experiments_wanted: range, files: range, folder: Path
) -> int:
    """Print a scenario's comparison; return how many experiments and files differ."""
    plans = plans_of(scenario, settings)
    lab = lab_for(plans)
    page = folder / f"{scenario}.html"
    write(lab, page)
    experiments = [
        (LAWS[i % len(LAWS)], random_setup(lab, LAWS[i % len(LAWS)], i)) for i in experiments_wanted
    ]
    results = in_node(lab, experiments)
    different = sum(
        not _same(plans, law, setup, result)
        for (law, setup), result in zip(experiments, results, strict=True)
    )
    print(f"{scenario}: Node: {different} of {len(experiments)} differ", flush=True)
    texts = [result.get("bits") or result["error"] for result in results]
    browsers = [("Chromium", chromium), *([("Firefox", firefox)] if PROGRAM else [])]
    for name, opened in browsers:
        with opened(page) as evaluate:
            others = in_page(evaluate, experiments)
        count = sum(a != b for a, b in zip(texts, others, strict=True))
        print(f"{scenario}: {name}: {count} of {len(experiments)} differ from Node", flush=True)
        different += count
    for law in LAWS:
        setups = [
            setup
            for i in files
            if LAWS[i % len(LAWS)] == law
            for setup in [random_setup(lab, law, 100_000 + i)]
            if not refused(plans[law], law, setup)
        ]
        place = folder / f"{scenario}_{law}"
        place.mkdir()
        if setups:
            diverging = compare(plans, law, setups, place)
            print(
                f"{scenario}: {law}: {len(setups)} files identical, {len(setups) - diverging} verified",
                flush=True,
            )
    return different


def _same(plans: Any, law: str, setup: Setup, result: dict[str, Any]) -> bool:
    if refused(plans[law], law, setup) or "error" in result:
        return refused(plans[law], law, setup) and "error" in result
    table, diverged = table_of(plan_with(plans[law], law, setup))
    return equal_bits(result["table"], table) and (result["ended"] == "diverged") == diverged


def main() -> int:
    """Compare; return the exit code."""
    counts = [int(word) for word in sys.argv[1:3]]
    experiments, files = (*counts, *(500, 50)[len(counts) :])
    different = 0
    for k, (scenario, settings) in enumerate(CASES.items()):
        with tempfile.TemporaryDirectory(prefix="trunk-lab-") as folder:
            different += compared(
                scenario,
                settings,
                range(k * experiments // len(CASES), (k + 1) * experiments // len(CASES)),
                range(k * files // len(CASES), (k + 1) * files // len(CASES)),
                Path(folder),
            )
    print(f"{different} differ")
    return int(different > 0)


if __name__ == "__main__":
    raise SystemExit(main())
