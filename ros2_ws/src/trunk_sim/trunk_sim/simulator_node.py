"""The ``simulator`` node: the plant at a set rate, its true and measured state as JointState."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence

from std_srvs.srv import SetBool, Trigger

from trunk_msgs_util import topics
from trunk_msgs_util.events import Event
from trunk_msgs_util.node import discovery
from trunk_msgs_util.node.managed import ENDING
from trunk_msgs_util.node.run import main_for
from trunk_msgs_util.node.strangers import near_misses
from trunk_msgs_util.units import seconds

from .plant_node import PlantNode

_STARTED_BY = {
    topics.EFFORT_COMMAND: "a controller (such as ros2 run trunk_control fuzzy_pid)",
    topics.DISTURBANCE: "the disturbance (ros2 run trunk_sim disturbance)",
    topics.REFERENCE: "the reference (ros2 run trunk_control reference)",
    "recorder": "the recorder (ros2 run trunk_msgs_util recorder)",
}


# Without a controller for so long, and then every so often, the simulator looks for what goes astray.
_LOOK_AFTER_S, _LOOK_EVERY_S = 10.0, 5.0


class SimulatorNode(PlantNode):
    """Owns the run: waits for the participants, begins, holds and resets."""

    def _forget(self) -> None:
        super()._forget()
        self._missing: Sequence[str] = ()
        self._pause_asked = False
        self._looked_s = math.inf
        self._seen_instead = ""
        self._truth_published = False

    def set_up(self) -> None:
        """Put the plant into its initial state and open the topics."""
        self._forget()
        self.run_stamp_ns = -1
        self._create_topics(self.config)
        self.create_service(Trigger, "~/reset", self._on_reset)
        self.create_service(SetBool, "~/pause", self._on_pause)
        self._start_timer = self.every(0.02, self._try_start)
        self._start_timer.cancel()

    def activate(self) -> None:
        """Wait for the participants and begin; or resume where the run was held."""
        if self._running:
            self._hold(self._pause_asked)
        else:
            self._start_timer.reset()
            self._looked_s = time.monotonic() + _LOOK_AFTER_S - _LOOK_EVERY_S

    def deactivate(self) -> None:
        """Hold the run, or the wait for it: the plant stands still."""
        self._start_timer.cancel()
        if self._running:
            self._hold(True)

    def tear_down(self) -> None:
        """Forget the run; the record says how far it got."""
        self.stopping()

    # Start: hold state 0 until every participant is matched in both directions.

    def _try_start(self) -> None:
        if self.ending:
            return  # nothing would report how that run ended
        missing = self._participants.missing(time.monotonic())
        if not missing and self.may_be_second():
            return
        if not missing and not self._truth_published:
            self._outputs.clock(self._simulation.stamp_ns)
            self._outputs.truth(self._simulation.truth())
            self._truth_published = True
        # The first measurement carries its disturbance too, and follows its reference.
        ahead = {topics.DISTURBANCE: bool(self._disturbances), topics.REFERENCE: self._referred}
        missing = missing or [t for t in self.config.wait_for if not ahead.get(t, True)]
        self._missing = missing
        if missing:
            return
        if self._participants.unsettled(time.monotonic()):
            return
        self._start_timer.cancel()
        if self._only_one_controller():
            self._begin()

    def waits_for(self) -> str:
        """Return the participants that are missing, and how to start them."""
        missing = ", ".join(_STARTED_BY.get(name, name) for name in self._missing)
        if topics.EFFORT_COMMAND not in self._missing or self._running:
            return missing
        now = time.monotonic()
        if now - self._looked_s >= _LOOK_EVERY_S:
            self._looked_s = now
            answers, states = map(
                self.resolve_topic_name, (topics.EFFORT_COMMAND, topics.JOINT_STATES)
            )
            misses = near_misses(self, answers, states, topics.JOINT_STATE_TYPE, self._own_names())
            self._seen_instead = "; ".join(misses) or "nothing like it"
        return f"{missing}; seen instead: {self._seen_instead}" if self._seen_instead else missing

    def _own_names(self) -> list[str]:
        """Return the nodes that publish events of a run: none of them is a controller that goes astray."""
        return sorted(discovery.publishers(self, topics.RUN_EVENTS))

    # Services.

    def _on_reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self.ending:
            response.message = ENDING
            return response
        self._simulation.reset()
        self.event(Event.RESET)
        response.success = True
        response.message = "the plant is in its initial state " + (
            f"at t = {seconds(self.run_stamp_ns):g} s"
            if self.run_stamp_ns >= 0
            else "before the first state"
        )
        return response

    def _on_pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        response.success = self._running and self.active and not self.ending
        if response.success:
            self._pause_asked = request.data
            self._hold(request.data)
        if self.ending:
            response.message = ENDING
        else:
            response.message = self._state() if self.active else "inactive: activate the simulator"
        return response

    def _hold(self, hold: bool) -> None:
        if hold != self._pacing.paused:
            self.event(Event.PAUSED if hold else Event.RESUMED)
            if hold:
                self._pacing.paused = True
            else:
                self._pacing.begin(time.monotonic_ns())


main = main_for(SimulatorNode, "simulator")
