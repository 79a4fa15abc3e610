from pathlib import Path

import pytest

from trunk_core import topics
from trunk_core.samples import JointSample
from trunk_recording import schemas
from trunk_recording.cdr import layout_of
from trunk_recording.writer import PROVENANCE, RecordingWriter

PERIOD_NS = 1_000_000

STATE_NAMES = (  # of a record of PID's terms
    *("reference", "measurement", "error", "error_rate", "p_term", "i_term", "d_term"),
    *("kp", "ki", "kd", "alpha", "unsaturated", "effort"),
)


def state_values(k: int) -> tuple[float, ...]:
    return tuple(100.0 * i + k for i in range(len(STATE_NAMES)))


class RunFile:
    """Writes a small run of ``steps`` steps; the controller updates at every second state."""

    def __init__(self, directory: Path) -> None:
        self.path = directory / "run.mcap"
        self.state_values = state_values
        self.period_ns = PERIOD_NS

    def write(
        self,
        steps: int = 20,
        *,
        namespace: str = "",
        joints: tuple[str, str] = ("hip", "trunk"),
        parameters: dict[str, object] | None = None,
        drop: tuple[str, ...] = (),
        flush_every: int = 0,
        compression: str = "zstd",
    ) -> Path:
        with RecordingWriter(self.path, compression, overwrite=True) as writer:
            writer.add_metadata(PROVENANCE, {"scenario": "fig6", "host": "größe"})
            channels = {
                topic: writer.channel(f"{namespace}/{topic}", type_name)
                for topic, type_name in topics.evidence_types(("pid", "fuzzy_pid")).items()
            }

            def put(topic: str, stamp_ns: int, data: bytes) -> None:
                if topic not in drop:
                    writer.write(channels[topic], stamp_ns + 5, stamp_ns + 5, data)

            def joint(topic: str, sample: JointSample) -> None:
                put(topic, sample.stamp_ns, layout_of(sample).pack(sample))

            if parameters is not None:
                node = f"{namespace}/simulator"
                put(topics.RUN_PARAMETERS, 0, schemas.parameter_event(0, node, parameters, {}))
            put(topics.RUN_EVENTS, 0, schemas.event(0, f"{namespace}/simulator", "started"))
            for k in range(steps + 1):
                t = k * PERIOD_NS
                torque = float(k - 1) if k else 0.0
                truth = JointSample(t, joints, (k, k + 0.25), (-k, -k - 0.5), (0.0, torque))
                joint(topics.GROUND_TRUTH, truth)
                joint(topics.JOINT_STATES, truth._replace(position=(k, k + 0.125)))
                joint(topics.EFFORT_COMMAND, JointSample(t, joints[1:], effort=(float(k),)))
                if k % 2 == 0:
                    sample = JointSample(t, STATE_NAMES, position=state_values(k))
                    joint(topics.controller_state("pid"), sample)
                if flush_every and k % flush_every == 0:
                    writer.flush()
        return self.path


@pytest.fixture
def run_file(tmp_path: Path) -> RunFile:
    return RunFile(tmp_path)
