"""A named pipe in place of a file is refused at once: reading it would wait for a writer for ever."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest
from ros2_ws.src.trunk_experiments.test.verbs import VERBS, Verb

# Of those that read a file; `params apply` wants a running node first.
READERS = [
    Verb(("plan", "demo", "--params"), ("params.yaml",), ".yaml"),
    *(
        verb
        for verb in VERBS
        if verb.inputs and Path(verb.inputs[0]).suffix and verb.words[0] != "params"
    ),
]


@pytest.mark.parametrize("verb", READERS, ids=lambda verb: verb.name)
def test_a_pipe_is_refused(
    trunk: Callable[..., tuple[int, str, str]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    verb: Verb,
) -> None:
    monkeypatch.chdir(tmp_path)
    os.mkfifo("pipe.fis")
    code, _, err = trunk(*("pipe.fis" if word in verb.inputs else word for word in verb.sound))
    assert code == 2
    assert err.startswith("trunk: error: ")
    assert "pipe.fis" in err
    assert err.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["pipe.fis"]
