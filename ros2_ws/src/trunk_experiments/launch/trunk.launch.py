"""A run of the node set, as ``trunk run`` starts it; ``ros2 launch -s …`` lists its arguments."""

from __future__ import annotations

from pathlib import Path

from ament_index_python.packages import get_package_prefix, get_package_share_directory
from launch.actions import DeclareLaunchArgument, EmitEvent, LogInfo, OpaqueFunction
from launch.events import Shutdown
from launch.events.matchers import matches_action
from launch.events.process import ProcessExited, ShutdownProcess
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchContext, LaunchDescription, LaunchDescriptionEntity
from trunk_experiments.runs import launching
from trunk_experiments.runs.run_files import RunFiles


class OrderlyEnd:
    """Stops the set in order once one node has ended; a run that is not whole makes the launch fail."""

    def __init__(self, names: list[str], files: RunFiles) -> None:
        self.files = files
        self.actions: dict[str, Node] = {}
        self.running = list(names)
        self.failed: list[str] = []
        self.first = ""  # to end

    def on_exit(self, name: str):
        def ended(event: ProcessExited, context: LaunchContext) -> list[LaunchDescriptionEntity]:
            self.running.remove(name)
            self.first = self.first or f"{name} ended with exit code {event.returncode}"
            if event.returncode:
                self.failed.append(f"{name} ended with exit code {event.returncode}")
            if not self.running:
                self.files.describe()
                lacks = launching.what_lacks(self.files.recording)
                if self.failed or lacks:
                    causes = dict.fromkeys([self.first, *self.failed])
                    raise RuntimeError("; ".join(filter(None, [*causes, lacks])))
            if context.is_shutdown:
                return []
            others = launching.next_to_stop(self.running)
            if not others:
                reason = f"the run is over: {self.files.recording}"
                return [LogInfo(msg=reason), EmitEvent(event=Shutdown(reason=reason))]
            return [
                EmitEvent(
                    event=ShutdownProcess(process_matcher=matches_action(self.actions[other]))
                )
                for other in others
            ]

        return ended


def start(context: LaunchContext) -> list[LaunchDescriptionEntity]:
    """Make the plan, write its parameter file, start the nodes with it."""
    given = {a.name: LaunchConfiguration(a.name).perform(context) for a in launching.ARGUMENTS}
    plan = launching.launch_plan(given)
    share = Path(get_package_share_directory("trunk_experiments"))
    viewers = launching.launch_viewers(plan, given, share)
    for viewer in viewers:
        get_package_prefix(
            viewer.package
        )  # not installed: the launch ends before it has made a folder
    files = RunFiles.for_run(plan, Path(given["output"]) if given["output"] else None)
    nodes = launching.launch_nodes(files.record(plan), files.parameters)

    end = OrderlyEnd([node.executable for node in nodes], files)
    for node in nodes:
        end.actions[node.executable] = Node(
            package=node.package,
            executable=node.executable,
            ros_arguments=list(node.ros_arguments),
            output="screen",
            on_exit=end.on_exit(node.executable),
        )
    shown = [
        Node(
            package=viewer.package,
            executable=viewer.executable,
            arguments=list(viewer.options),
            ros_arguments=list(viewer.ros_arguments),
        )
        for viewer in viewers
    ]
    said = [LogInfo(msg=f"warning: {text}") for text in plan.warnings]
    if plan.external is not None:
        said += [LogInfo(msg=line) for line in launching.connection_lines(plan)]
    said.append(LogInfo(msg=f"recording: {files.recording}"))
    # Viewers first: if RViz is not installed, nothing has been started yet.
    return [*said, *shown, *end.actions.values()]


def generate_launch_description() -> LaunchDescription:
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(a.name, default_value=a.default, description=a.description)
                for a in launching.ARGUMENTS
            ),
            OpaqueFunction(function=start),
        ]
    )
