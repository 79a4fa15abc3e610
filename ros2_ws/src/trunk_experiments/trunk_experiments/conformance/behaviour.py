"""Checks of what a law does with one sample after another."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from time import perf_counter

from trunk_control.law import Law
from trunk_control.limits import limited

from .finding import Driven, LawFinding, finite, given, name_of
from .samples import DT, extreme, swinging, unusable

SLOWEST_US = 200.0
_LIMIT = 5.0


def types(law: Law) -> Iterator[LawFinding]:
    """Yield a finding where an update returns other types than the law declares."""
    driven, update = Driven(law), name_of(law.update)
    sample = swinging(DT)[0]
    returned = law.update(driven.memory, sample, driven.constants, driven.limits)
    if not (type(returned) is tuple and len(returned) == 2):
        yield LawFinding("types", update, f"returns {returned!r}", "return (memory, terms)")
        return
    for part, record, kind in zip(
        ("memory", "terms"), returned, (type(law.memory), law.terms), strict=True
    ):
        if type(record) is not kind:
            yield LawFinding(
                "types",
                update,
                f"returns a {type(record).__name__} as {part}",
                f"return the {kind.__name__} that the law declares",
            )
            continue
        for field, value in zip(record._fields, record, strict=True):
            declared = getattr(law.memory, field) if part == "memory" else 0.0
            wanted = bool if field == "held" or isinstance(declared, bool) else type(declared)
            if type(value) is not wanted:
                yield LawFinding(
                    "types",
                    update,
                    f"{part}.{field} = {value!r} is {type(value).__name__}",
                    f"it is declared as {wanted.__name__}; compiled code needs one type",
                )


def pure(law: Law) -> Iterator[LawFinding]:
    """Yield a finding where outputs depend on more than the inputs, or inputs are changed."""
    update, samples = name_of(law.update), swinging(1.0)
    driven = Driven(law)
    before = copy.deepcopy((driven.memory, driven.constants))
    first = driven.run(samples)
    if repr(before) != repr((law.memory, driven.constants)):
        yield LawFinding(
            "pure",
            update,
            "changes the memory or the constants that it is given",
            "return new ones",
        )
    Driven(law).run(swinging(0.7, amplitude=1.1))
    for k, (terms, repeated) in enumerate(zip(first, Driven(law).run(samples), strict=True)):
        if repr(terms) != repr(repeated):
            yield LawFinding(
                "pure",
                update,
                f"sample {k} of the same series gives {terms!r} once and {repeated!r} later",
                "take everything from memory, sample, constants and limits",
            )
            return


def finite_always(law: Law) -> Iterator[LawFinding]:
    """Yield a finding where an input makes the command or the memory not finite, or raises."""
    update = name_of(law.update)
    for sample in extreme():
        driven = Driven(law)
        driven.run(swinging(5 * DT))
        try:
            terms = driven.update(sample)
        except Exception as error:
            yield LawFinding(
                "finite",
                update,
                f"{given(sample)} raises {type(error).__name__}: {error}",
                "test `usable` first, and hold",
            )
            return
        if not (finite(driven.memory) and finite((terms.effort,))):
            yield LawFinding(
                "finite",
                update,
                f"{given(sample)} gives effort {terms.effort!r}, memory {tuple(driven.memory)!r}",
                "hold where a result is not finite: return the memory as it was, and held = True",
            )
            return


def holds(law: Law) -> Iterator[LawFinding]:
    """Yield a finding where a sample that is not usable changes the memory or the command."""
    update = name_of(law.update)
    for sample in unusable():
        driven = Driven(law)
        driven.run(swinging(5 * DT))
        before = driven.memory
        try:
            terms = driven.update(sample)
        except Exception:
            return  # `finite_always` reports it
        wanted = limited(before.effort, driven.limits)
        if not (terms.held and repr(driven.memory) == repr(before) and terms.effort == wanted):
            if not driven.config.uses_rate and finite(sample[:2]) and sample.dt > 0.0:
                continue  # a law that ignores the rate may go on
            yield LawFinding(
                "holds",
                update,
                f"{given(sample)} gives held = {terms.held}, effort {terms.effort!r}, and "
                f"{'the same' if repr(driven.memory) == repr(before) else 'another'} memory",
                f"return the memory as it was, the command {wanted!r} and held = True",
            )
            return


def within_limits(law: Law) -> Iterator[LawFinding]:
    """Yield a finding where a command is not the unlimited one, limited, or the memory lacks it."""
    update = name_of(law.update)
    for limit in (_LIMIT, 0.01, 1e9):
        driven = Driven(law, limit)
        for sample in swinging(1.0, amplitude=1.5):
            terms = driven.update(sample)
            if not -limit <= terms.effort <= limit:
                yield LawFinding(
                    "limits",
                    update,
                    f"{given(sample)} within +-{limit:g} N m gives effort {terms.effort!r}",
                    "effort = limited(unsaturated, limits)",
                )
                return
            if not terms.held and (
                terms.effort != limited(terms.unsaturated, driven.limits)
                or driven.memory.effort != terms.effort
            ):
                yield LawFinding(
                    "limits",
                    update,
                    f"{given(sample)} gives unsaturated {terms.unsaturated!r}, effort {terms.effort!r}, "
                    f"memory.effort {driven.memory.effort!r}",
                    "effort = limited(unsaturated, limits), and memory.effort = effort",
                )
                return


def quick(law: Law) -> Iterator[LawFinding]:
    """Yield if the quickest of many updates takes too much of a control period."""
    driven, samples = Driven(law), swinging(0.2)
    best = float("inf")
    for _ in range(20):
        for sample in samples:
            begun = perf_counter()
            driven.update(sample)
            best = min(best, perf_counter() - begun)
    if best * 1e6 > SLOWEST_US:
        yield LawFinding(
            "quick",
            name_of(law.update),
            f"an update takes {best * 1e6:.0f} us at best, {SLOWEST_US:.0f} us is allowed",
            "move what does not depend on the sample into the configuration's constants",
        )
