"""What the paper claims, sentence by sentence, the runs that judge it, and whether they confirm it.

The runs are figures x controllers x profiles, offline and in the graph. A claim is data: the sentence, and
the comparisons that it amounts to. Its verdict is a function of the numbers only, so that none can be
written by hand.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import degrees, inf, isinf
from pathlib import Path
from typing import Final, Literal, NamedTuple

import numpy as np

from trunk_evidence.differences import diff
from trunk_evidence.recorded_run import RecordedRun
from trunk_evidence.run_metrics import SETTLING_BAND_DEG, Metrics
from trunk_evidence.run_table import RunTable, metrics
from trunk_runs.graph import run_graph
from trunk_runs.offline_recording import record_offline
from trunk_runs.plan import RunPlan, make_plan
from trunk_runs.processes import claimed_domain
from trunk_runs.run_files import RunFiles
from trunk_sim.simulation import DivergedError

FIGURES = ("fig6", "fig7", "fig8", "fig9")
PROFILES = ("profile_paper", "profile_practical")


class PaperController(NamedTuple):
    """A controller with its gains: node, parameter file, label, short label for a legend."""

    node: str
    params: tuple[str, ...]
    title: str
    short: str = ""


# The controllers that the paper compares, and others worth comparing with them.
OF_THE_PAPER = {
    "pid_as_printed": PaperController(
        "pid", ("pid_as_printed",), "PID, gains as printed", "PID, printed"
    ),
    "pid_ziegler_nichols": PaperController(
        "pid", ("pid_ziegler_nichols",), "PID, Ziegler–Nichols", "PID, Z–N"
    ),
    "fuzzy_as_printed": PaperController(
        "fuzzy_pid", ("fuzzy_as_printed",), "Fuzzy-PID, printed tables", "Fuzzy, printed"
    ),
    "fuzzy_zhao_1993": PaperController(
        "fuzzy_pid", ("fuzzy_zhao_1993",), "Fuzzy-PID, 1993 tables", "Fuzzy, 1993"
    ),
}
BASELINES = {
    "pid_fixed_from_box": PaperController(
        "pid", ("pid_fixed_from_box",), "PID, fixed, from the gain box"
    ),
    "lqr": PaperController("lqr", (), "LQR with integral"),
    "computed_torque": PaperController("computed_torque", (), "Computed torque"),
}
CONTENDERS = {**OF_THE_PAPER, **BASELINES}


class Case(NamedTuple):
    """One run's name."""

    profile: str
    figure: str
    contender: str

    @property
    def stem(self) -> str:
        """Its recording's name."""
        return f"{self.figure}-{self.contender}-{self.profile.removeprefix('profile_')}"

    def plan(self, **everywhere: object) -> RunPlan:
        """Return its plan."""
        contender = CONTENDERS[self.contender]
        params = (*contender.params, self.profile)
        return make_plan(self.figure, contender.node, params, everywhere=everywhere)


@dataclass(frozen=True)
class PaperRun:
    """The result of a case. ``metrics`` is None if the plant diverged; then ``failure`` says when."""

    case: Case
    metrics: Metrics | None
    undershoot_deg: float  # the swing back across the reference after the overshoot
    failure: str = ""
    graph_differs: str | None = None  # a graph run: "" if it has the offline run's bits

    def value(self, key: str) -> float:
        """Return a metric; infinity if it does not exist (never settled, diverged)."""
        if key == "undershoot_deg":
            return self.undershoot_deg
        if key == "largest_deg":  # either way
            return max(abs(self.value("theta_min_deg")), abs(self.value("theta_max_deg")))
        value = None if self.metrics is None else getattr(self.metrics, key)
        return inf if value is None else float(value)


Runs = dict[Case, PaperRun]


def cases(contenders: tuple[str, ...] = tuple(CONTENDERS)) -> Iterator[Case]:
    """Yield every case of the table."""
    for profile in PROFILES:
        for figure in FIGURES:
            for contender in contenders:
                yield Case(profile, figure, contender)


def undershoot(table: RunTable) -> float:
    """Return by how many degrees the angle swings back past the last level of the reference.

    0 if it never crosses it. Counts from the last change of the reference.
    """
    changes = np.flatnonzero(np.diff(table.reference)) + 1
    start = int(changes[-1]) if len(changes) else 0
    past = table.theta[start:] - table.reference[-1]
    side = np.sign(past[0])
    crossed = np.flatnonzero(side * past < 0.0)
    return max(0.0, degrees(np.max(side * past[crossed[0] :]))) if len(crossed) else 0.0


def run_offline(case: Case, folder: Path) -> PaperRun:
    """Run a case without ROS, into a recording in the folder."""
    path = folder / f"{case.stem}.mcap"
    try:
        record_offline(case.plan(), path, overwrite=True)
    except DivergedError as error:
        return PaperRun(case, None, inf, str(error))
    return _judged(case, path)


def run_in_graph(case: Case, folder: Path, offline: Path) -> PaperRun:
    """Run a case in the node graph, in lock-step and composed, and compare its bits with the offline run's.

    Raises RunError if the graph fails.
    """
    files = RunFiles(folder / case.stem)
    files.recording.unlink(missing_ok=True)
    with claimed_domain():
        run_graph(case.plan(**{"lockstep.enabled": True}), files, lambda t: None, composed=True)
    first = diff(RecordedRun.open(offline), RecordedRun.open(files.recording)).first
    return _judged(case, files.recording, "" if first is None else first.describe())


def _judged(case: Case, path: Path, graph_differs: str | None = None) -> PaperRun:
    table = RunTable.from_run(RecordedRun.open(path))
    return PaperRun(case, metrics(table), undershoot(table), graph_differs=graph_differs)


ANGLE = 0.5  # deg: counts as none, on a figure that spans 30 to 100 degrees
FALLEN = 90.0  # deg
FUZZY = ("fuzzy_as_printed", "fuzzy_zhao_1993")
PRINTED, TABLE_1 = "pid_as_printed", "pid_ziegler_nichols"
_ABOVE = " above Fuzzy-PID's"
ClaimWord = Literal["reproduced", "partly", "not reproduced"]
REPRODUCED: Final = "reproduced"
PARTLY: Final = "partly"
NOT: Final = "not reproduced"


@dataclass(frozen=True)
class ClaimCheck:
    """One comparison ``value relation bound``, true or not."""

    figure: str
    contender: str
    quantity: str
    value: float
    relation: str  # "<=" or ">"
    bound: float
    unit: str
    against: str = ""  # whose run gives the bound, if one does

    @property
    def label(self) -> str:
        """Figure, contender, and what is compared."""
        return f"{self.figure} {self.contender}, {self.quantity}"

    @property
    def title(self) -> str:
        """The contender and what is compared, in words."""
        return f"{CONTENDERS[self.contender].title}: {self.quantity.removesuffix(_ABOVE)}"

    @property
    def holds(self) -> bool:
        """True if the comparison holds."""
        return self.value <= self.bound if self.relation == "<=" else self.value > self.bound

    @property
    def value_text(self) -> str:
        """The value with its unit; ``never`` for an infinite time."""
        return _with_unit(self.value, self.unit)

    @property
    def wanted(self) -> str:
        """What the value is compared with."""
        word = {"<=": "at most", ">": "more than"}[self.relation]
        whose = "Fuzzy-PID's " if self.against else ""
        return f"{word} {whose}{_with_unit(self.bound, self.unit)}"


def _with_unit(value: float, unit: str) -> str:
    return _shown(value) if isinf(value) else f"{_shown(value)}{'' if unit == '°' else ' '}{unit}"


def _shown(value: float) -> str:
    return "never" if isinf(value) else f"{value:.4g}"


@dataclass(frozen=True)
class Claim:
    """A sentence of the paper and its comparisons. ``checks`` takes the runs and a profile."""

    key: str
    figures: str
    quote: str
    paper: str  # what it says, in short
    tolerance: str
    why: str  # what causes the result; no verdict, and no number of a run
    checks: Callable[[Runs, str], list[ClaimCheck]]
    see: tuple[str, str] | None = None  # a part of the report that says more: its id and its name


@dataclass(frozen=True)
class ClaimVerdict:
    """The result of a claim for one set of runs."""

    claim: Claim
    checks: tuple[ClaimCheck, ...]

    @property
    def word(self) -> ClaimWord:
        """``reproduced``, ``partly`` or ``not reproduced``."""
        held = sum(check.holds for check in self.checks)
        return REPRODUCED if held == len(self.checks) else PARTLY if held else NOT

    @property
    def short(self) -> str:
        """The verdict in two words."""
        return {REPRODUCED: "holds here", PARTLY: "partly holds", NOT: "fails here"}[self.word]

    def text(self) -> str:
        """Return the verdict; a mixed one names what holds and what does not."""
        if self.word != PARTLY:
            return self.word
        holds = "; ".join(check.label for check in self.checks if check.holds)
        fails = "; ".join(check.label for check in self.checks if not check.holds)
        return f"{PARTLY}: holds for {holds}; not for {fails}"


def judge(claim: Claim, runs: Runs, profile: str) -> ClaimVerdict:
    """Return the verdict on a claim by the runs of a profile."""
    return ClaimVerdict(claim, tuple(claim.checks(runs, profile)))


_UNITS = {
    "overshoot_deg": "°",
    "undershoot_deg": "°",
    "steady_state_error_rms_deg": "°",
    "theta_max_deg": "°",
    "largest_deg": "°",
    "settling_time_6deg_s": "s",
    "iae": "rad s",
}
_WORDS = {
    "overshoot_deg": "overshoot",
    "undershoot_deg": "undershoot",
    "steady_state_error_rms_deg": "steady-state error, RMS",
    "theta_max_deg": "largest angle",
    "largest_deg": "largest angle either way",
    "settling_time_6deg_s": "settling time",
    "iae": "IAE",
}


def _within(
    figure: str, contenders: tuple[str, ...], key: str, bound: float, relation: str = "<="
) -> Callable[[Runs, str], list[ClaimCheck]]:
    """Return the checks of a metric against a fixed bound."""

    def checks(runs: Runs, profile: str) -> list[ClaimCheck]:
        return [
            ClaimCheck(
                figure,
                name,
                _WORDS[key],
                runs[Case(profile, figure, name)].value(key),
                relation,
                bound,
                _UNITS[key],
            )
            for name in contenders
        ]

    return checks


def _pid_worse(figure: str, key: str) -> Callable[[Runs, str], list[ClaimCheck]]:
    """Return the checks that each PID's metric is larger than Fuzzy-PID's with the printed tables."""

    def checks(runs: Runs, profile: str) -> list[ClaimCheck]:
        bound = runs[Case(profile, figure, FUZZY[0])].value(key)
        return [
            ClaimCheck(
                figure,
                name,
                f"{_WORDS[key]}{_ABOVE}",
                runs[Case(profile, figure, name)].value(key),
                ">",
                bound,
                _UNITS[key],
                FUZZY[0],
            )
            for name in (PRINTED, TABLE_1)
        ]

    return checks


def _all(
    *parts: Callable[[Runs, str], list[ClaimCheck]],
) -> Callable[[Runs, str], list[ClaimCheck]]:
    return lambda runs, profile: [check for part in parts for check in part(runs, profile)]


_PIDS = (PRINTED, TABLE_1)
_COMPARED = "none: the two numbers are compared"

CLAIMS = (
    Claim(
        "fuzzy-overshoot",
        "6",
        "the Fuzzy control strategy have not any overshoot and undershoot",
        "overshoot 0, undershoot 0",
        f"{ANGLE:g}°",
        "Eq. 9 puts no force on the hip: it rolls in its trough with a period of about 3.2 s "
        "and shakes the trunk for ever. A controller that does not look at the hip cannot "
        "prevent that; computed torque, which does, is in the table of all runs.",
        _all(
            _within("fig6", FUZZY, "overshoot_deg", ANGLE),
            _within("fig6", FUZZY, "undershoot_deg", ANGLE),
        ),
    ),
    Claim(
        "fuzzy-steady",
        "6",
        "and has steady behavior in the response of zero reference input",
        "steady",
        f"{ANGLE:g}° RMS over the last 2 s",
        "The hip rolls on, and keeps a trunk swinging by some degrees whose controller does not "
        "look at it.",
        _within("fig6", FUZZY, "steady_state_error_rms_deg", ANGLE),
    ),
    Claim(
        "pid-steady-state",
        "6",
        "while the PID controller has not only steady state error",
        "PID's error stays, Fuzzy-PID's does not",
        _COMPARED,
        "The printed PID gains are a conversion error: Ki = Kp·Ti and Kd = Kp/Td give the "
        "printed 36 and 400, the paper's eq. 13 asks for Kp/Ti = 100 and Kp·Td = 9. With Kd = "
        "400 the trunk creeps and is still on its way when the run ends.",
        _pid_worse("fig6", "steady_state_error_rms_deg"),
    ),
    Claim(
        "pid-overshoot",
        "6",
        "but also some overshoot in the process",
        "PID overshoots",
        f"{ANGLE:g}°",
        "The rolling hip takes the trunk past the upright with either set of gains.",
        _within("fig6", _PIDS, "overshoot_deg", ANGLE, ">"),
    ),
    Claim(
        "pid-overshoot-more",
        "6",
        "It can be seen that proposed control method has fast response, low overshoot and error",
        "Fuzzy-PID is the faster, with less overshoot and error",
        _COMPARED,
        "It depends on which PID is meant: the one with the printed gains, which are a "
        "conversion error, or the one with the gains that the paper's own Table 1 gives.",
        _all(
            _pid_worse("fig6", "settling_time_6deg_s"),
            _pid_worse("fig6", "overshoot_deg"),
            _pid_worse("fig6", "iae"),
        ),
    ),
    Claim(
        "fuzzy-balances",
        "7",
        "It is illustrated clearly in Fig.7 that the PID-fuzzy controllers is balanced the unstable "
        "system as well",
        "the trunk stays up",
        f"{SETTLING_BAND_DEG:g}° RMS over the last 2 s",
        "No limit of the torque is printed, so whatever the step asks for is given; what "
        "remains is the hip's rolling.",
        _within("fig7", FUZZY, "steady_state_error_rms_deg", SETTLING_BAND_DEG),
    ),
    Claim(
        "pid-70-80",
        "7",
        "the PID controller in comparison of Fuzzy-PID strategy has great overshoot at abrupt changing "
        "of input around 70-80 degree",
        "PID reaches 70 to 80°",
        "above 70°, and above Fuzzy-PID's overshoot; at 1 kHz: the printed PID depends on the rate",
        "The derivative of the reference's step is a torque of hundreds of kN·m for one "
        "period: how far it throws the trunk depends on the sampling. The paper does not say "
        "how it sampled, so that a number at one rate confirms nothing.",
        _all(
            _within("fig7", _PIDS, "theta_max_deg", 70.0, ">"), _pid_worse("fig7", "overshoot_deg")
        ),
        see=("rates", "its numbers at six rates"),
    ),
    Claim(
        "fuzzy-tracks",
        "7",
        "is results accurate tracking of the reference input for the trunk angle",
        "accurate, better than PID",
        f"{ANGLE:g}° RMS over the last 2 s; IAE compared",
        "The hip's rolling leaves an error of some degrees; and the PID with the printed "
        "gains is the easier one to beat.",
        _all(
            _within("fig7", FUZZY, "steady_state_error_rms_deg", ANGLE), _pid_worse("fig7", "iae")
        ),
    ),
    Claim(
        "fuzzy-robust",
        "8, 9",
        "According of Fig 8-9, the Fuzzy-PID controller provides a more robust system against the "
        "external disturbances and human body walks appropriately",
        "Fuzzy-PID errs less under pulses, and does not fall",
        "IAE compared; 90°, where the trunk has fallen",
        "A pulse on the measured angle is differentiated, and so kicks every controller that "
        "differentiates the error. The 1993 tables differ from the printed ones only in cells "
        "that these pulses reach.",
        _all(
            _pid_worse("fig8", "iae"),
            _pid_worse("fig9", "iae"),
            _within("fig8", FUZZY, "largest_deg", FALLEN),
            _within("fig9", FUZZY, "largest_deg", FALLEN),
        ),
    ),
    Claim(
        "pid-nearly-falls",
        "9",
        "Due to poor performance and unstable response of the PID controller on reference changes under "
        "abrupt disturbance, the human body severely is the boundary of instability",
        "PID is close to falling",
        "beyond 90°, where the trunk has fallen, and beyond Fuzzy-PID",
        "The pulse, differentiated, throws the trunk about; its width is our choice, as the "
        "paper prints none.",
        _all(_within("fig9", _PIDS, "largest_deg", FALLEN, ">"), _pid_worse("fig9", "largest_deg")),
    ),
)
