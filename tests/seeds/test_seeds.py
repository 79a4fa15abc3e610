"""Seeds of the virtual world keep the invariants, each plays the same twice, and mutants are found."""

import subprocess
import sys
from pathlib import Path

import pytest

from ..finished import finished
from .mutants import MUTANTS, Mutant, found_after, mutated
from .story import STORIES

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[2]
# Each broke an invariant once.
FOUND = (
    *(2342, 2703, 2894, 3132, 3201, 4221, 4280, 20362, 4170, 4405),
    *(100664, 100742, 100746, 101917, 106103, 106551, 200191),
    *(50649, 50910, 52031, 53447, 54629),
    *(71833, 170292, 174842),
    *(4915, 8233, 9338),
    *(50255, 50662, 65372, 81622, 90746, 91946, 102996, 106307, 106380),
    23868,
)


def seeds(*words: object) -> subprocess.CompletedProcess[str]:
    """Run the check in its own process, since it loads another rclpy."""
    return finished([sys.executable, "-m", "tests.seeds.check", *map(str, words)], cwd=ROOT)


@pytest.mark.one_in(15)
@pytest.mark.parametrize("first", range(0, 300, 20))
def test_whatever_happens_the_invariants_hold(first: int) -> None:
    done = seeds(20, "--seed", first)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.startswith("20 seeds, 0 failed")


def test_seeds_that_once_failed_pass_now() -> None:
    done = seeds(1, *(f"--seed={seed}" for seed in FOUND))
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.startswith(f"{len(FOUND)} seeds, 0 failed")


def test_what_is_told_step_by_step_is_whole_and_verified() -> None:
    done = seeds(*(f"--story={name}" for name in STORIES))
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.startswith(f"{len(STORIES)} seeds, 0 failed")


def test_a_seed_plays_the_same_twice() -> None:
    done = seeds(2, "--seed", 1000, "--twice")
    assert done.returncode == 0, done.stdout + done.stderr
    traces = [seeds("--seed", 7, "--trace").stdout.splitlines()[:-1] for _ in range(2)]
    kept = [[line for line in trace if "/dev/shm" not in line] for trace in traces]
    assert kept[0] == kept[1]
    assert len(kept[0]) > 100


@pytest.mark.parametrize("mutant", MUTANTS[:2], ids=lambda mutant: mutant.name.replace(" ", "_"))
def test_a_mutant_is_found(mutant: Mutant) -> None:
    found, said = found_after(mutant, 20)
    assert found is not None, said


def test_each_mutant_applies() -> None:
    assert all(mutated(mutant) for mutant in MUTANTS)
