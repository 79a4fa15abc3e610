"""The files that a run in the graph leaves, in a folder of its own."""

from __future__ import annotations

import os
import time
from contextlib import suppress
from dataclasses import dataclass
from dataclasses import replace as with_values
from itertools import count
from pathlib import Path

from trunk_core.errors import PlanError
from trunk_core.files import atomic_write
from trunk_core.topics import GROUND_TRUTH
from trunk_core.yaml_text import YamlTextError
from trunk_recording.bag_folder import METADATA
from trunk_recording.reader import Recording, RecordingError
from trunk_recording.writer import RECORD, is_being_written, metadata_yaml

from .plan import RunPlan

GATEWAY_LOG = "gateway.log"  # written beside the nodes, and before them


def _earlier(file: Path) -> Path:
    """Return the name of an earlier run's file until the new run has begun."""
    return file.with_name(f"{file.name}.earlier")


@dataclass(frozen=True)
class RunFiles:
    """Where a run writes its files; ``replaces``: in place of those that an earlier run left there."""

    folder: Path
    replaces: bool = False

    @property
    def all(self) -> tuple[Path, ...]:
        """All that a run writes."""
        return self.recording, self.parameters, self.description, self.logs

    @classmethod
    def for_run(
        cls, plan: RunPlan, folder: Path | None = None, force: bool | None = None
    ) -> RunFiles:
        """Make the run's folder, by default a new one below ``runs``.

        Raises PlanError if a file that the run would write exists: with ``force``, only if it is not from a
        run, or is still being written. None: the user has no such option.
        """
        whole = (folder or Path()).absolute()
        try:
            str(whole).encode()
        except UnicodeEncodeError:
            raise PlanError(
                f"output {whole}: ROS 2 takes names in UTF-8 only: give another folder"
            ) from None
        if folder is None:
            stamp = time.strftime("%Y%m%dT%H%M%SZ", time.gmtime())
            place = plan.namespace.replace("/", "_")
            folder = first = Path("runs") / f"{stamp}_{plan.scenario}_{plan.controller_name}{place}"
            try:
                for number in count(2):
                    with suppress(FileExistsError):  # of another run, begun in the same second
                        folder.mkdir(parents=True)
                        break
                    folder = Path(f"{first}_{number}")
            except OSError as error:
                raise PlanError(
                    f"{folder}: {error.strerror}: give a folder with --output"
                ) from None
        files = cls(folder, replaces=bool(force))
        if os.path.lexists(folder) and not folder.is_dir():
            raise PlanError(f"output {folder}: it is not a folder: give another")
        if folder.absolute() == Path(folder.absolute().anchor):
            raise PlanError(f"output {folder}: it is the root folder: give a folder below it")
        for file in files.all:
            if os.path.lexists(file):
                files._check_replaceable(file, "" if force is None else ", or --force")
        folder.mkdir(parents=True, exist_ok=True)
        return files

    def _check_replaceable(self, file: Path, way_out: str) -> None:
        conflict = f"output {self.folder}: there is a {file.name} in it"
        if not self.replaces:
            raise PlanError(f"{conflict}: give another folder{way_out}")
        if file.is_dir() != (file == self.logs):
            raise PlanError(f"{conflict} that does not belong to a run: give another folder")
        if file == self.recording and is_being_written(file):
            raise PlanError(
                f"{conflict} that is being written: give another folder, or stop that run"
            )

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
        """The file by which ROS 2's tools recognise the folder as a bag."""
        return self.folder / METADATA

    def record(self, plan: RunPlan) -> RunPlan:
        """Return the plan that records into this folder, and write it as the parameter file.

        The logs of an earlier run are then deleted; its recording is set aside until `settle`.
        """
        plan = with_values(
            plan, recorder=with_values(plan.recorder, output=str(self.recording.absolute()))
        )
        if self.replaces:
            for log in self.logs.glob("*.log"):
                if log.name != GATEWAY_LOG:
                    log.unlink(missing_ok=True)
            if self.recording.exists():
                for file in self._recorded:
                    if file.exists():
                        file.replace(_earlier(file))
        plan.write_parameters(self.parameters)
        return plan

    def settle(self) -> None:
        """Delete what `record` set aside if this run has recorded a state, else put it back."""
        if not self.replaces or not _earlier(self.recording).exists():
            return
        began = False
        with suppress(RecordingError):  # none, or not to be read
            recording = Recording.open_by_summary(self.recording)
            of_truth = (
                t for name, t in recording.topics.items() if name.endswith(f"/{GROUND_TRUTH}")
            )
            began = any(topic.count for topic in of_truth)
        for file in self._recorded:
            (_earlier(file) if began else file).unlink(missing_ok=True)
            if not began and _earlier(file).exists():
                _earlier(file).replace(file)

    @property
    def _recorded(self) -> tuple[Path, ...]:
        return self.recording, self.parameters, self.description

    def describe(self) -> str:
        """Make the folder a bag to ROS 2's tools: write ``metadata.yaml``, if the recording was finished.

        Return why it could not be written; empty if it was, or if the run says why there is none.
        """
        with suppress(RecordingError, YamlTextError, ValueError):
            (file,) = Recording.open_by_summary(self.recording).opened
            text = metadata_yaml(dict(file.metadata_records).get(RECORD, {}), self.recording.name)
            try:
                with atomic_write(self.description) as part:
                    part.write_text(text, "utf-8")
            except OSError as error:
                folder = (
                    f"ROS 2's tools do not know the folder as a bag: ros2 bag reindex {self.folder}"
                )
                return f"{self.description}: {error.strerror}; {folder}"
        return ""

    @property
    def logs(self) -> Path:
        """The folder of the nodes' console output."""
        return self.folder / "logs"

    def log(self, node: str) -> Path:
        """Return the file of a node's console output."""
        return self.logs / f"{node}.log"
