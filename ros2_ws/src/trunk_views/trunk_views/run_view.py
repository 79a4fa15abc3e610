"""`RunView`: what plots, comparisons and reports show of a recorded run, read once."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise, starmap
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, cast

import numpy as np

from trunk_control.law import ControllerConfig
from trunk_control.laws import law_named
from trunk_control.rule_base import RuleBaseConfig
from trunk_core import topics
from trunk_core.parameters.declarations import ParameterError, values_of
from trunk_core.parameters.shared import PLANT_NAME
from trunk_evidence.evidence import Pulse, Turn, pulses_of, recorded_turns
from trunk_evidence.recorded_run import RecordedRun, name_of_run, place_of
from trunk_evidence.run_table import RunTable, held_at
from trunk_msgs_util.picture.shapes import Geometry
from trunk_recording.reader import Recording
from trunk_runs.nodes import CONTROLLERS
from trunk_sim.config import SimulatorConfig, TrunkSimulator
from trunk_sim.disturbance_config import DisturbanceConfig
from trunk_sim.plant import TRUNK, Plant

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from trunk_core.arrays import Bools, Floats, Integers
    from trunk_core.parameters.declarations import Value
    from trunk_recording.joint_table import Column, JointTable


GAINS = ("kp", "ki", "kd", "alpha")
INPUTS: tuple[Column, ...] = (("position", "error"), ("position", "error_rate"))  # of the inference
_TURNS_IN_TITLE = 4  # more are not spelled out


@dataclass(frozen=True)
class RunView:
    """A recorded run. A configuration is None if it was not recorded or cannot be used.

    If several controllers took turns, ``controller`` is the one whose inference can be shown, or else
    the one with the most updates; ``controllers`` has all whose parameters are known.
    """

    run: RecordedRun
    table: RunTable
    terms: JointTable | None  # what a law infers from, of its ~/state; None if it has no rules
    controller_name: str | None
    controller: ControllerConfig | None
    controllers: Mapping[str, ControllerConfig | None]
    simulator: SimulatorConfig | None
    disturbance: DisturbanceConfig | None
    pulses: tuple[Pulse, ...]
    turns: tuple[Turn, ...]
    warnings: tuple[str, ...]

    @classmethod
    def read(cls, run: RecordedRun) -> RunView:
        """Return the view of a run; ``warnings`` lists what cannot, besides what `Doubts` say.

        Raises RecordingError if there are no true states, nor those of another robot.
        """
        warnings = run.recording.further_warnings

        def config(node: str) -> object:
            if node not in run.parameters:
                return None
            try:
                return run.config(node)
            except ParameterError as error:
                warnings.append(f"{node}: recorded parameters cannot be used: {error}")
                return None

        controllers = {
            node: cast("ControllerConfig | None", config(node) if node in CONTROLLERS else None)
            for node in run.controllers
        }
        fuzzy = [node for node, c in controllers.items() if isinstance(c, RuleBaseConfig)]
        name = fuzzy[0] if fuzzy else run.controller
        disturbance = cast("DisturbanceConfig | None", config("disturbance"))
        needed = {} if run.another_robot else RunTable.needed(run)
        for node in run.controllers:
            state = topics.controller_state(node)
            terms = [("position", term) for term in own_terms_of(node)]
            inputs = INPUTS if node in fuzzy else ()
            needed[state] = [*needed.get(state, ()), *inputs, *terms]
        if disturbance:
            needed[topics.DISTURBANCE] = []
        run.keep_series(needed)  # in one pass, without what is not shown
        view = cls(
            run=run,
            table=RunTable.of_run(run),
            terms=run.series({topics.controller_state(fuzzy[0]): INPUTS}).popitem()[1]
            if fuzzy
            else None,
            controller_name=name,
            controller=controllers.get(name or ""),
            controllers=controllers,
            simulator=cast("SimulatorConfig | None", config("simulator")),
            disturbance=disturbance,
            pulses=tuple(pulses_of(run)) if disturbance else (),
            turns=recorded_turns(run),
            warnings=tuple(warnings),
        )
        needed.pop(topics.EFFORT_COMMAND, None)  # which had the last torque
        needed.pop(topics.DISTURBANCE, None)  # and the pulses
        run.keep_series(needed)
        return view

    def acts(self, t: Floats) -> Bools:
        """Return at which times, s [N], the controller acts whose inference is shown."""
        turn = np.searchsorted([turn.start for turn in self.turns], t, side="right") - 1
        acting = [turn.controller == self.controller_name for turn in self.turns]
        return np.append(acting, False)[turn]

    @property
    def recording(self) -> Recording:
        """The recording of the run."""
        return self.run.recording

    @property
    def path(self) -> Path:
        """The recording's file."""
        return self.run.path

    @property
    def limits(self) -> tuple[float, float]:
        """Bounds of the applied torque in N m: the controllers' and the actuator's."""
        low, high = -inf, inf
        known = [c for c in self.controllers.values() if c is not None]
        if known:
            low = min(c.u_clamp_min for c in known)
            high = max(c.u_clamp_max for c in known)
        if self.simulator is not None:
            low, high = max(low, -self.simulator.max_effort), min(high, self.simulator.max_effort)
        return low, high

    @property
    def plant(self) -> Plant | None:
        """The plant, by default the trunk; None for one that is not installed here."""
        if self.simulator is None and self.unknown_plant:
            return None
        return (self.simulator or TrunkSimulator()).kind

    @property
    def unknown_plant(self) -> str:
        """The name of a plant that is not installed here; empty otherwise."""
        name = self.parameters.get("simulator", {}).get(PLANT_NAME, "")
        return str(name) if self.simulator is None else ""

    @property
    def pictured(self) -> bool:
        """True if the plant's picture is known."""
        return not self.run.another_robot and self.plant is not None

    @cached_property
    def geometry(self) -> Geometry:
        """The plant's; the default one's where it is not known."""
        return Geometry.from_parameters(values_of(self.simulator or TrunkSimulator()))

    @property
    def parameters(self) -> Mapping[str, Mapping[str, Value]]:
        """Every node's parameters at the start, without the run's namespace."""
        return self.run.parameters

    @property
    def title(self) -> str:
        """The controllers in words: ``Fuzzy-PID``, ``PID (60, 36, 9), from 4 s Fuzzy-PID``."""
        words = {name: _in_words(name, config) for name, config in self.controllers.items()}
        if theirs := self.run.external:
            words = {theirs: theirs} if len(self.turns) < 2 else {**words, theirs: theirs}
        if not 1 < len(self.turns) <= _TURNS_IN_TITLE:
            return ", then ".join(words.values()) or "no controller"
        first, *others = self.turns
        later = [f"from {turn.start:g} s {words[turn.controller]}" for turn in others]
        return ", ".join([words[first.controller], *later])


def plant_of(views: Sequence[RunView]) -> Plant | None:
    """Return the plant of all runs, if it is the same, and another than the trunk."""
    plants = {view.plant for view in views}
    plant = plants.pop()
    return None if plants or plant is None or plant.name == TRUNK else plant


def of_either_drive(views: Sequence[RunView]) -> bool:
    """Return True if a text about all runs' drives may be about forces as well as about torques."""
    plants = {view.plant for view in views}
    forces = any(plant is None or plant.driven.unit == "m" for plant in plants)
    return forces and (len(plants) > 1 or None in plants)


def words_of(views: Sequence[RunView]) -> Callable[[str], str]:
    """Return the function that puts a text of ours about the trunk into the words of the runs' plant.

    Of a plant that is not installed here it is not known whether its drive makes a force or a torque.
    """
    if of_either_drive(views):
        return _in_either
    plant = plant_of(views)
    return str if plant is None else plant.of_drive


def _in_either(text: str) -> str:
    for ours, either in (
        *(("torque", "effort"), ("Torque", "Effort"), ("N²·m²", "N² or N²·m²")),
        *(("N·m", "N or N·m"), ("N m", "N or N m"), ("Hip path", "Path")),
    ):
        text = text.replace(ours, either)
    return text


def _in_words(name: str, config: ControllerConfig | None) -> str:
    """Return a controller's label with its law's note on the configuration: ``PID (60, 36, 9)``."""
    if name not in CONTROLLERS:
        return name
    law = law_named(name)
    more = law.describe(config) if law.describe is not None and config is not None else ""
    return f"{law.label} ({more})" if more else law.label


def own_terms_of(controller: str) -> tuple[str, ...]:
    """Return the names of a law's terms if it reports no gains, the only ones that are shown."""
    if controller not in CONTROLLERS or tells_gains(controller):
        return ()
    return tuple(n for n in law_named(controller).terms._fields if n not in ("effort", "held"))


def tells_gains(controller: str) -> bool:
    """Return True if a law's terms are a PID's: gains and their shares."""
    return set(GAINS) <= set(law_named(controller).terms._fields)


def on_tracks(views: Sequence[RunView]) -> bool:
    """Return True unless a plant among ours stands on a pivot."""
    ours = [view for view in views if not view.run.another_robot]
    return all(view.geometry.picture.track is not None for view in ours)


def labels(views: Sequence[RunView], name: Callable[[RunView], str] | None = None) -> list[str]:
    """Return one distinct name per run: the file's, plus as much of its path, or a number, as needed.

    ``run.mcap``, which is in every run's folder, goes by the folder's name. ``name`` gives other names to
    start from.
    """
    names = [name(view) if name else name_of_run(view.path) for view in views]
    if name is None and len(set(names)) < len(names):
        names = [f"{place_of(view.path).parent.name}/{name_of_run(view.path)}" for view in views]
    elif len(set(names)) < len(names):
        names = [f"{n}, {name_of_run(view.path)}" for n, view in zip(names, views, strict=True)]
    if len(set(names)) < len(names):
        names = [f"{n} #{i}" for i, n in enumerate(names, 1)]
    return names


def off_scale(values: Floats) -> float | None:
    """Return a half-range that shows all but short spikes; None if everything fits.

    The derivative of a step makes peaks a hundred times their surroundings; an axis that holds them
    shows nothing else.
    """
    finite = np.abs(values[np.isfinite(values)])
    if not len(finite):
        return None
    usual = float(np.quantile(finite, 0.985))
    return 1.25 * usual if 0.0 < 4.0 * usual < float(np.max(finite)) else None


_UNITS = {"unsaturated": "N m"}


class OwnTerm(NamedTuple):
    """A term of a law's own."""

    name: str
    unit: str

    @property
    def title(self) -> str:
        """The name and the unit, for an axis."""
        name = self.name.replace("_", " ")
        return f"{name}, {self.unit}" if self.unit else name


def own_terms(views: Sequence[RunView]) -> list[OwnTerm]:
    """Return the terms of laws that report no gains, in their order, each once."""
    own: dict[str, OwnTerm] = {}
    for view in views:
        for controller in view.controllers:
            for name in own_terms_of(controller):
                units = {**law_named(controller).units, **_UNITS}
                own.setdefault(name, OwnTerm(name, units.get(name, "").replace(" ", "·")))
    return list(own.values())


def gains_told(views: Sequence[RunView]) -> bool:
    """Return True if any run has gains to show, or nothing else is known of its law."""
    known = [name for view in views for name in view.controllers if name in CONTROLLERS]
    return not known or any(map(tells_gains, known))


def values_of_term(view: RunView, term: OwnTerm) -> Floats:
    """Return a term at the run's states: of the last update, NaN before it and where a law has none."""
    t_ns = np.rint(view.table.t * 1e9).astype(np.int64)
    values: Floats = np.full(len(t_ns), np.nan)
    for controller in view.controllers:
        if controller in CONTROLLERS and term.name in law_named(controller).terms._fields:
            state, column = topics.controller_state(controller), ("position", term.name)
            recorded = view.run.series({state: [column]})[state]
            held = held_at(t_ns, recorded.stamp_ns, recorded.column(*column))
            values = np.where(np.isnan(values), held, values)
    return values


_AT_ONCE = 1 << 16  # updates: those of an hour at once would take 400 MB


def rule_use(view: RunView) -> list[list[int]]:
    """Return how many updates fired each rule (weight above 0), [label of e][label of e_dot]."""
    if not isinstance(view.controller, RuleBaseConfig):
        return []
    counts = [times_fired(errors, rates, *peaks) for _, (errors, rates), peaks in _inferences(view)]
    table: list[list[int]] = np.sum(np.array(counts), axis=0).tolist() if counts else []
    return table


def times_fired(
    errors: Floats, rates: Floats, error_peaks: Sequence[float], rate_peaks: Sequence[float]
) -> list[list[int]]:
    """Return how many of the inputs [rad, rad/s] fire each rule: `fired_rules` of all at once."""
    counts = np.zeros((len(error_peaks), len(rate_peaks)), np.int64)
    i, a = _located(errors, error_peaks)
    j, b = _located(rates, rate_peaks)
    both = a * b
    later = b - both
    for rows, columns, weights in (
        (i, j, 1.0 - a - later),
        (i, j + 1, later),
        (i + 1, j, a - both),
        (i + 1, j + 1, both),
    ):
        fired = weights > 0.0
        at = np.ravel_multi_index((rows[fired], columns[fired]), counts.shape)
        counts += np.bincount(at, minlength=counts.size).reshape(counts.shape)
    table: list[list[int]] = counts.tolist()
    return table


def _inferences(
    view: RunView,
) -> Iterator[tuple[slice, tuple[Floats, Floats], tuple[Sequence[float], Sequence[float]]]]:
    """Yield at most `_AT_ONCE` updates between changes of parameters, their inputs and the peaks in force.

    Those with other labels than at the start are left out.
    """
    if view.terms is None:
        return
    name, stamps = view.controller_name or "", view.terms.stamp_ns
    timeline = view.run.timeline(name)
    changed = sorted({change.stamp_ns for change in view.run.changes(name)})
    errors, rates = (view.terms.column(*column) for column in INPUTS)
    labels = timeline.config.axes
    edges = np.searchsorted(stamps, changed, side="right").tolist()
    begins = sorted({0, *edges, *range(0, len(stamps), _AT_ONCE), len(stamps)})
    for rows in starmap(slice, pairwise(begins)):
        timeline.advance(int(stamps[rows.start]))
        if timeline.config.axes == labels:
            yield rows, (errors[rows], rates[rows]), timeline.config.peaks


def rule_places(view: RunView, axis: int) -> Floats:
    """Return one input's places among its peaks in force: 1.25 is a quarter beyond the second.

    NaN where an input is, or where there are other labels than at the start.
    """
    assert view.terms is not None
    places = np.full(len(view.terms.stamp_ns), np.nan)
    for rows, inputs, peaks in _inferences(view):
        low, weights = _located(inputs[axis], peaks[axis])
        places[rows] = np.where(np.isnan(inputs[axis]), np.nan, low + weights)
    return places


def _located(values: Floats, peaks: Sequence[float]) -> tuple[Integers, Floats]:
    """Return the results of `locate` for all values at once."""
    at = np.asarray(peaks, np.float64)
    inside = np.where(values > at[0], np.minimum(values, at[-1]), at[0])  # NaN to the first peak
    low: Integers = np.minimum(np.searchsorted(at, inside, side="right") - 1, len(at) - 2)
    weights: Floats = (inside - at[low]) / (at[low + 1] - at[low])
    return low, weights
