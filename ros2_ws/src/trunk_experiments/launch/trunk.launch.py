"""A run of the node set, as ``trunk run`` starts it; ``ros2 launch -s …`` lists its arguments."""

from __future__ import annotations

from pathlib import Path

from launch.actions import DeclareLaunchArgument, EmitEvent, LogInfo, OpaqueFunction
from launch.events import Shutdown
from launch.events.matchers import matches_action
from launch.events.process import ProcessExited, ShutdownProcess
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchContext, LaunchDescription, LaunchDescriptionEntity
from trunk_runs import processes
from trunk_runs.run_files import RunFiles


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
                lacks = processes.what_lacks(self.files.recording)
                if self.failed or lacks:
                    causes = dict.fromkeys([self.first, *self.failed])
                    raise RuntimeError("; ".join(filter(None, [*causes, lacks])))
            if context.is_shutdown:
                return []
            others = processes.next_to_stop(self.running)
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
    given = {name: LaunchConfiguration(name).perform(context) for name in processes.ARGUMENTS}
    plan = processes.launch_plan(given)
    files = RunFiles.for_run(plan, Path(given["output"]) if given["output"] else None)
    nodes = processes.launch_nodes(files.record(plan), files.parameters)

    end = OrderlyEnd([node.executable for node in nodes], files)
    for node in nodes:
        end.actions[node.executable] = Node(
            package=node.package,
            executable=node.executable,
            ros_arguments=list(node.ros_arguments),
            output="screen",
            on_exit=end.on_exit(node.executable),
        )
    lines = [f"warning: {text}" for text in plan.warnings] + [f"recording: {files.recording}"]
    return [*(LogInfo(msg=line) for line in lines), *end.actions.values()]


def generate_launch_description() -> LaunchDescription:
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=default, description=description)
                for name, (default, description) in processes.ARGUMENTS.items()
            ),
            OpaqueFunction(function=start),
        ]
    )
