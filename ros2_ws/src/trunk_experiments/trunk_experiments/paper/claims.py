"""What the paper claims, sentence by sentence, and whether our runs confirm it.

A claim is data: the sentence, and the comparisons that it amounts to. Its verdict is a function of the
numbers only, so that none can be written by hand.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import isinf
from typing import Final, Literal

from ..analysis.metrics import SETTLING_BAND_DEG
from .runs import CONTENDERS, Case, Runs

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
