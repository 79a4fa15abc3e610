"""Clocks, timers, guard conditions and wait sets of the virtual library."""

from __future__ import annotations

from typing import Any

from .base import Context, Handle, real, world


class Clock(Handle):
    def __init__(self, clock_type: Any) -> None:
        super().__init__()
        self._type = int(clock_type)

    def get_now(self) -> Any:
        return real().rcl_time_point_t(world().look(), self._type)

    def get_ros_time_override_is_enabled(self) -> bool:
        return False

    def set_ros_time_override_is_enabled(self, enabled: bool) -> None:
        pass

    def set_ros_time_override(self, *_: Any) -> None:
        pass

    def add_clock_callback(self, *_: Any) -> None:
        pass

    def remove_clock_callback(self, *_: Any) -> None:
        pass


class Timer(Handle):
    def __init__(self, clock: Clock, context: Context, period_ns: int, autostart: bool) -> None:
        super().__init__()
        self.period_ns, self.canceled = int(period_ns), not autostart
        self.due_ns = world().now_ns + self.period_ns

    def is_timer_ready(self) -> bool:
        return not self.canceled and world().now_ns >= self.due_ns

    def call_timer(self) -> None:
        if self._destroyed:
            raise real().InvalidHandle("destroyed")
        self.due_ns += self.period_ns
        if self.due_ns < world().now_ns:  # what was missed is missed
            behind = (world().now_ns - self.due_ns) // max(self.period_ns, 1) + 1
            self.due_ns += behind * self.period_ns

    def cancel_timer(self) -> None:
        self.canceled = True

    def reset_timer(self) -> None:
        self.canceled = False
        self.due_ns = world().now_ns + self.period_ns

    def is_timer_canceled(self) -> bool:
        return self.canceled

    def change_timer_period(self, period_ns: int) -> None:
        self.period_ns = int(period_ns)

    def get_timer_period(self) -> int:
        return self.period_ns

    def time_until_next_call(self) -> int:
        return self.due_ns - world().now_ns


class GuardCondition(Handle):
    def __init__(self, context: Context) -> None:
        super().__init__()
        self.triggered = False

    def trigger_guard_condition(self) -> None:
        self.triggered = True


class EventHandle(Handle):
    """An event of the middleware; none happens here."""

    def __init__(self, parent: Handle, kind: Any) -> None:
        super().__init__()


class WaitSet(Handle):
    def __init__(self, *_: Any) -> None:
        super().__init__()
        self._kinds: dict[str, list[Any]] = {}
        self._ready: dict[str, list[int]] = {}

    def clear_entities(self) -> None:
        self._kinds = {
            kind: [] for kind in ("subscription", "timer", "guard_condition", "service", "client")
        }

    def _add(self, kind: str, one: Handle) -> int:
        with one:
            self._kinds[kind].append(one)
        return len(self._kinds[kind]) - 1

    def add_subscription(self, one: Handle) -> int:
        return self._add("subscription", one)

    def add_timer(self, one: Handle) -> int:
        return self._add("timer", one)

    def add_guard_condition(self, one: Handle) -> int:
        return self._add("guard_condition", one)

    def add_service(self, one: Handle) -> int:
        return self._add("service", one)

    def add_event(self, one: Handle) -> int:
        return 0

    def is_ready(self, kind: str, index: int) -> bool:
        return False

    def _look(self) -> dict[str, list[int]]:
        kinds = self._kinds
        return {
            "subscription": [s.pointer for s in kinds["subscription"] if s.reader.queue],
            "timer": [t.pointer for t in kinds["timer"] if t.is_timer_ready()],
            "guard_condition": [g.pointer for g in kinds["guard_condition"] if g.triggered],
            "service": [s.pointer for s in kinds["service"] if s.requests],
            "client": [],
        }

    def wait(self, limit_ns: int) -> None:
        """Wait until something is ready, or for a time; below 0 for ever."""
        found = self._look()
        if limit_ns and not any(found.values()):
            left = [t.time_until_next_call() for t in self._kinds["timer"] if not t.canceled]
            if left:
                soonest = max(min(left), 1)
                limit_ns = soonest if limit_ns < 0 else min(limit_ns, soonest)
            world().block(limit_ns, lambda: any(self._look().values()))
            found = self._look()
        for guard in self._kinds["guard_condition"]:
            guard.triggered = False
        self._ready = found

    def get_ready_entities(self, kind: str) -> list[int]:
        return self._ready.get(kind, [])
