#!/usr/bin/env python3
"""The same PD without ROS: pip install cyclonedds; python3 pd_cyclonedds.py, beside trunk run --external."""

import os
import signal
from dataclasses import dataclass

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import float64, int32, sequence, uint32
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

KP, KD, LIMIT = 60.0, 9.0, 100.0  # N m/rad, N m s/rad, N m


@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):  # noqa: D101
    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):  # noqa: D101
    stamp: Time
    frame_id: str


@dataclass
class JointState(IdlStruct, typename="sensor_msgs::msg::dds_::JointState_"):  # noqa: D101
    header: Header
    name: sequence[str]
    position: sequence[float64]
    velocity: sequence[float64]
    effort: sequence[float64]


signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C, also while it waits
qos = Qos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.History.KeepLast(100))
participant = DomainParticipant(int(os.environ.get("ROS_DOMAIN_ID", "0")))
topic = {
    name: Topic(participant, f"rt/{name}", JointState)
    for name in ("joint_states", "reference", "effort_command")
}
commands = DataWriter(participant, topic["effort_command"], qos=qos)
references = DataReader(participant, topic["reference"], qos=qos)
states = DataReader(participant, topic["joint_states"], qos=qos)
reference, ahead = 0.0, {}  # rad; by stamp
for state in states.take_iter(timeout=duration(seconds=3600)):
    for message in references.take(N=100):
        ahead[str(message.header.stamp)] = message.position[message.name.index("trunk")]
    reference = ahead.pop(str(state.header.stamp), reference)
    trunk = state.name.index("trunk")
    torque = KP * (reference - state.position[trunk]) - KD * state.velocity[trunk]
    torque = max(-LIMIT, min(torque, LIMIT))
    commands.write(JointState(Header(state.header.stamp, ""), ["trunk"], [], [], [torque]))
