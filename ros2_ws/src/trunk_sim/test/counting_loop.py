"""The loop that pacing drives, without a plant."""

H = 1_000_000  # ns, its period


class CountingLoop:
    """A plant that only counts."""

    def __init__(self, steps=None):
        self.stamp_ns, self.period_ns, self.steps = 0, H, steps
        self.efforts, self.counts = [], {}
        self.finished, self.failure = False, None

    @property
    def at_end(self):
        return self.steps is not None and self.stamp_ns == self.steps * H

    def advance(self, effort):
        self.efforts.append(effort)
        self.stamp_ns += H

    def finish(self):
        self.finished = True

    def fail(self, reason):
        self.failure = reason

    def participant(self, topic):
        return f"/node ({topic})"

    def count(self, kind, number=1):
        assert isinstance(number, int)
        assert number != 0
        self.counts[kind] = self.counts.get(kind, 0) + number

    def refuse(self, kind, why):
        assert why
        self.count(kind)
