"""ROS 2's lifecycle as the virtual library has it."""

from __future__ import annotations

from .base import Handle, Node, real
from .endpoints import Service

_STATES = {1: "unconfigured", 2: "inactive", 3: "active", 4: "finalized", 10: "configuring",
           11: "cleaningup", 12: "shuttingdown", 13: "activating", 14: "deactivating",
           15: "errorprocessing"}  # fmt: skip
# (state, transition's id, label, next state), as ROS 2's design has them.
_GRAPH = [
    (1, 1, "configure", 10), (2, 2, "cleanup", 11), (2, 3, "activate", 13),
    (3, 4, "deactivate", 14), (1, 5, "shutdown", 12), (2, 6, "shutdown", 12),
    (3, 7, "shutdown", 12),
    *((state, 10 * state + i, f"transition_{word}", then)
      for state, ends in ((10, (2, 1, 15)), (11, (1, 2, 15)), (12, (4, 4, 15)),
                          (13, (3, 2, 15)), (14, (2, 3, 15)), (15, (1, 4, 4)))
      for i, (word, then) in enumerate(zip(("success", "failure", "error"), ends, strict=True))),
]  # fmt: skip


class LifecycleStateMachine(Handle):
    def __init__(self, node: Node, communicates: bool) -> None:
        super().__init__()
        self.initialized = True
        self._state = 1
        for name in ("change_state", "get_state", "get_available_states",
                     "get_available_transitions", "get_transition_graph"):  # fmt: skip
            setattr(self, f"service_{name}", Service(node, None, f"~/{name}", None))

    @property
    def current_state(self) -> tuple[int, str]:
        return self._state, _STATES[self._state]

    @property
    def available_states(self) -> list[tuple[int, str]]:
        return list(_STATES.items())

    @property
    def transition_graph(self) -> list[tuple[int, str, int, str, int, str]]:
        return [(number, label, a, _STATES[a], b, _STATES[b]) for a, number, label, b in _GRAPH]

    @property
    def available_transitions(self) -> list[tuple[int, str, int, str, int, str]]:
        return [one for one in self.transition_graph if one[2] == self._state]

    def get_transition_by_label(self, label: str) -> int:
        for number, known, *_ in self.available_transitions:
            if known == label:
                return number
        raise real().RCLError(f"no transition {label!r} from {_STATES[self._state]}")

    def trigger_transition_by_id(self, number: int, publish: bool) -> None:
        for known, _, _, _, after, _ in self.available_transitions:
            if known == number:
                self._state = after
                return
        raise real().RCLError(f"no transition {number} from {_STATES[self._state]}")

    def trigger_transition_by_label(self, label: str, publish: bool) -> None:
        self.trigger_transition_by_id(self.get_transition_by_label(label), publish)
