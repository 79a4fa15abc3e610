"""The files that a run in the graph leaves, in a folder of its own."""

from __future__ import annotations

import os
import time
from contextlib import suppress
from dataclasses import dataclass
from dataclasses import replace as with_values
from pathlib import Path

from trunk_msgs_util.recording.bag_folder import METADATA
from trunk_msgs_util.recording.reader import Recording, RecordingError
from trunk_msgs_util.recording.rosbag2 import RECORD, metadata_yaml
from trunk_msgs_util.yaml_text import YamlTextError

from ..errors import PlanError
from ..plans.plan import RunPlan


@dataclass(frozen=True)
class RunFiles:
    """Where a run leaves what it makes."""

    folder: Path

    @classmethod
    def for_run(cls, plan: RunPlan, folder: Path | None = None) -> RunFiles:
        """Make the run's folder, by default a new one below ``runs``.

        Raises PlanError where there is a file that the run would write.
        """
        given = folder
        if folder is None:
            stamp = time.strftime("%Y%m%dT%H%M%SZ", time.gmtime())
            place = plan.namespace.replace("/", "_")
            folder = Path("runs") / f"{stamp}_{plan.scenario}_{plan.controller_name}{place}"
        files = cls(folder)
        for file in (files.recording, files.parameters, files.description, files.logs):
            if os.path.lexists(file):
                raise PlanError(
                    f"output {folder}: there is a {file.name} in it; give another folder"
                )
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            if given is not None:
                raise  # the error names it
            raise PlanError(f"{folder}: {error.strerror}: give a folder with --output") from None
        return files

    @property
    def recording(self) -> Path:
        """The MCAP file."""
        return self.folder / "run.mcap"

    @property
    def parameters(self) -> Path:
        """Every node's full parameters, ready for ``--params-file``."""
        return self.folder / "params.yaml"

    @property
    def description(self) -> Path:
        """What ROS 2's tools know the folder by as a bag."""
        return self.folder / METADATA

    def record(self, plan: RunPlan) -> RunPlan:
        """Return the plan that records into this folder, and write it as the parameter file."""
        plan = with_values(
            plan, recorder=with_values(plan.recorder, output=str(self.recording.absolute()))
        )
        plan.write_parameters(self.parameters)
        return plan

    def describe(self) -> None:
        """Make the folder a bag to ROS 2's tools: write ``metadata.yaml``, if the recording was finished."""
        with suppress(RecordingError, YamlTextError, ValueError, OSError):  # the run says why
            (file,) = Recording.glance(self.recording).opened
            text = metadata_yaml(dict(file.metadata_records).get(RECORD, {}), self.recording.name)
            self.description.write_text(text, "utf-8")

    @property
    def logs(self) -> Path:
        """The folder of the nodes' console output."""
        return self.folder / "logs"

    def log(self, node: str) -> Path:
        """Return where a node's console output goes."""
        return self.logs / f"{node}.log"
