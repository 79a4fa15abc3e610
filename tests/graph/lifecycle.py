"""A node's lifecycle state, queried and changed through its services."""

from __future__ import annotations

from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetAvailableTransitions, GetState

from .peer import Peer

_GOALS = {
    "configure": "inactive",
    "cleanup": "unconfigured",
    "activate": "active",
    "deactivate": "inactive",
}


class Life:
    """The lifecycle services of one node."""

    def __init__(self, peer: Peer, node: str) -> None:
        self._peer = peer
        self._node = node

    def state(self) -> str:
        label: str = self._peer.call(GetState, f"/{self._node}/get_state").current_state.label
        return label

    def change(self, label: str) -> bool:
        """Ask for a transition by its number, as ``ros2 lifecycle set`` does.

        If the first answer is lost, the peer asks again, and is refused what has been done.
        """
        before = self.state()
        request = Transition(id=getattr(Transition, f"TRANSITION_{label.upper()}"))
        success: bool = self._peer.call(
            ChangeState, f"/{self._node}/change_state", transition=request
        ).success
        goal = _GOALS.get(label)
        return success or (goal is not None and before != goal and self.state() == goal)

    def available(self) -> set[str]:
        found = self._peer.call(
            GetAvailableTransitions, f"/{self._node}/get_available_transitions"
        ).available_transitions
        return {f.transition.label for f in found}
