"""`Metrics`: how well a run held the trunk."""

from __future__ import annotations

from dataclasses import dataclass, fields

from ..analysis import metrics as analysis
from ._paths import AnyPath
from ._run import Run
from ._shown import html_table, text_table
from ._simulate import run_of


@dataclass(frozen=True)
class Metrics(analysis.RunMetrics):
    """Quantities of the true error ``e = reference - theta``; None where a run has no such value.

    ::

        overshoot_deg                  beyond the last level of the reference       deg
        settling_time_6deg_s           until |e| stays within 6 deg                s
        steady_state_error_mean_deg,
        steady_state_error_rms_deg     of e over the last 2 s                       deg
        iae, ise, itae                 integrals of |e|, e^2, t |e|                 rad s, rad^2 s, rad s^2
        effort                         integral of the squared torque               N^2 m^2 s
        peak_torque                    largest magnitude of the torque              N m
        theta_min_deg, theta_max_deg   smallest and largest angle                   deg

    Made by `metrics`. ``as_dict()`` returns them by name; ``print`` shows a table with units.
    """

    def _rows(self) -> list[tuple[str, str, str]]:
        values = self.as_dict()
        return [
            (q.label, q.missing if values[key] is None else f"{values[key]:.6g}", q.unit)
            for key, q in analysis.QUANTITIES.items()
        ]

    def __str__(self) -> str:
        return text_table(self._rows())

    def _repr_html_(self) -> str:
        return html_table("Metrics", ("quantity", "value", "unit"), self._rows())


def metrics(run: Run | AnyPath) -> Metrics:
    """Return the metrics of a `Run`, or of the recording at a path.

    Raises RecordingError if it cannot be read, or has no true states or no reference.
    """
    from ..analysis.run_table import recorded_metrics

    values = recorded_metrics(run_of(run)._recorded)
    return Metrics(*(getattr(values, field.name) for field in fields(values)))
