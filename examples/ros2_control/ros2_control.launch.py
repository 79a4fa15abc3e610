"""The plant under ros2_controllers' pid_controller: see README.md."""

from __future__ import annotations

from pathlib import Path

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription


def generate_launch_description() -> LaunchDescription:
    files = Path(__file__).parent
    description = {"robot_description": (files / "trunk.urdf").read_text(encoding="utf-8")}
    # Everything uses the plant's clock: a command's stamp is then that of the latest state.
    plant_time = {"use_sim_time": True}
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "params",
                default_value=str(files / "simulator.yaml"),
                description="The simulator's parameter file",
            ),
            Node(
                package="robot_state_publisher",
                executable="robot_state_publisher",
                parameters=[description, plant_time],
                output="screen",
            ),
            Node(
                package="controller_manager",
                executable="ros2_control_node",
                parameters=[str(files / "controllers.yaml"), plant_time],
                remappings=[("~/robot_description", "/robot_description")],
                output="screen",
            ),
            Node(
                package="controller_manager",
                executable="spawner",
                arguments=["pid_controller", "--param-file", str(files / "controllers.yaml")],
                output="screen",
            ),
            # Last: if one of the others is not installed, nothing has been started yet.
            Node(
                package="trunk_sim",
                executable="simulator",
                parameters=[LaunchConfiguration("params")],
                output="screen",
            ),
        ]
    )
