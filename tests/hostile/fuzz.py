"""Coverage-guided fuzzing of the reader with atheris: python -m tests.hostile.fuzz [libFuzzer's arguments]

Any file is read to its end or refused by a TrunkError; anything else is a finding.
"""

import sys
import tempfile
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any

from trunk_core import PACKAGES
from trunk_core.errors import TrunkError

ROOT = Path(__file__).resolve().parents[2]


def readers() -> Callable[[bytes, Path], None]:
    """Return the function that reads some bytes as every verb does, at a path to write them to."""
    from trunk_evidence.doctor import findings
    from trunk_evidence.explanation import explain
    from trunk_evidence.judgement import verify
    from trunk_evidence.recorded_run import RecordedRun
    from trunk_evidence.run_table import RunTable
    from trunk_recording.reader import Recording
    from trunk_recording.repair import recover

    def read(data: bytes, path: Path) -> None:
        path.write_bytes(data)
        with suppress(TrunkError):
            recording = Recording.open(path)
            for use in (
                verify,
                lambda recording: RunTable.from_run(RecordedRun(recording)),
                lambda recording: explain(RecordedRun(recording), 0.001),
                lambda recording: RecordedRun(recording).plan(),
            ):
                with suppress(TrunkError):
                    use(recording)
        with suppress(TrunkError):
            findings(RecordedRun.open(path))
        with suppress(TrunkError):
            recover(path, path.with_suffix(".recovered"), overwrite=True)

    return read


def main() -> None:
    """Fuzz until libFuzzer's arguments say that it is enough."""
    atheris: Any = import_module("atheris")
    with atheris.instrument_imports(include=[*PACKAGES]):
        read = readers()
    folder = Path(
        tempfile.mkdtemp(prefix="fuzz", dir="/dev/shm" if Path("/dev/shm").is_dir() else None)
    )
    atheris.Setup(sys.argv, lambda data: read(data, folder / "a.mcap"))
    atheris.Fuzz()


if __name__ == "__main__":
    main()
