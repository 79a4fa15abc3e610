"""How soon SIGINT and SIGTERM end each verb, at instants spread over its work on a long recording.

    python -m tests.hostile.signals [VERB...]

The promised second is for a machine that is otherwise idle.
"""

import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

from ros2_ws.src.trunk_experiments.test.verbs import of_recording

from trunk_runs.offline_recording import record_offline
from trunk_runs.plan import make_plan
from trunk_runs.processes import find_executable

DURATION = 120.0  # s of the recording, at 1 kHz
INSTANTS = 6
PROMISED = 1.0  # s
_SKIPPED = ("info --json", "metrics --json", "diff, second", "compare, second")


def _start(arguments: tuple[object, ...]) -> subprocess.Popen[str]:
    trunk = find_executable("trunk_experiments", "trunk")
    return subprocess.Popen(
        [str(trunk), *map(str, arguments)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )


def main() -> int:
    """Measure; return 1 if a verb took longer than promised or said more than its line."""
    worst, failed = 0.0, 0
    with tempfile.TemporaryDirectory(prefix="signals") as name:
        folder = Path(name)
        plan = make_plan("fig8", "pid")
        plan = replace(plan, simulator=replace(plan.simulator, duration=DURATION))
        path = folder / "long.mcap"
        record_offline(plan, path)
        for verb, arguments in of_recording(path, path, folder).items():
            if verb in _SKIPPED or (sys.argv[1:] and verb not in sys.argv[1:]):
                continue
            began = time.monotonic()
            _start(arguments).communicate()
            whole = time.monotonic() - began
            slowest = 0.0
            for i in range(INSTANTS):
                number = (signal.SIGINT, signal.SIGTERM)[i % 2]
                process = _start(arguments)
                time.sleep(whole * (i + 0.5) / INSTANTS)
                told = time.monotonic()
                process.send_signal(number)
                _, err = process.communicate()
                took = time.monotonic() - told
                slowest = max(slowest, took)
                # -number: the interpreter was not up yet, and died of the signal in silence.
                allowed = (0, 1, 128 + number, *((-number,) if not err else ()))
                if process.returncode not in allowed or "Traceback" in err:
                    failed += 1
                    print(f"FAIL  {verb}: code {process.returncode}: {err[-200:]}")
            late = slowest > PROMISED
            failed += late
            worst = max(worst, slowest)
            print(f"{'LATE' if late else 'ok  '}  {verb}: {whole:.1f} s, ends in {slowest:.2f} s")
    print(f"signals: {failed} failures, the slowest end took {worst:.2f} s")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
