"""Checks of what a law does when something changes: a reset, a takeover, parameters, the rate."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from trunk_control.controller import Controller
from trunk_control.controller_config import ControllerConfig
from trunk_control.law import Law, Sample
from trunk_msgs_util.parameters.declarations import ParameterError, build, declarations, values_of

from .finding import Driven, LawFinding, name_of
from .samples import DT, steady, swinging


def reset(law: Law) -> Iterator[LawFinding]:
    """Yield a finding where a controller behaves differently after a reset than a new one."""
    controllers = [Controller(law.config(), law) for _ in range(2)]
    for k, sample in enumerate(swinging(0.5, amplitude=0.9)):
        controllers[0].update(5_000_000 * k, sample.measurement, sample.rate)
    controllers[0].forget()
    efforts: list[list[Any]] = [
        [
            controller.update(5_000_000 * k, s.measurement, s.rate).effort
            for k, s in enumerate(swinging(0.2))
        ]
        for controller in controllers
    ]
    if efforts[0] != efforts[1]:
        k = next(k for k, (a, b) in enumerate(zip(*efforts, strict=True)) if a != b)
        yield LawFinding(
            "reset",
            name_of(law.update),
            f"update {k} after a reset gives {efforts[0][k]!r}, a new controller's {efforts[1][k]!r}",
            "keep nothing outside the memory",
        )


def transfers(law: Law) -> Iterator[LawFinding]:
    """Yield a finding where a bumpless transfer moves the command by more than one step."""
    for acting in (-12.5, 0.0, 20.0):
        controller = Controller(law.config(u_clamp_min=-30.0, u_clamp_max=30.0), law)
        controller.deactivate()
        controller.update(5_000_000, 0.05, 0.1)
        controller.activate()
        step, last = controller.config.handover_step, acting
        for k in range(2, 6):
            answer = controller.update(
                5_000_000 * k, 0.05 + 0.001 * k, 0.1, effort=acting if k == 2 else last
            )
            if abs(answer.effort - last) > step * (1.0 + 1e-12):
                yield LawFinding(
                    "transfer",
                    name_of(law.transfer),
                    f"from {last:g} N m its command is {answer.effort!r} N m, one step may be {step:g} N m",
                    "keep to the limits given, which are narrowed during a bumpless transfer",
                )
                return
            if not controller.state.transfer.transferring:
                break
            last = answer.effort


def reconfigures(law: Law) -> Iterator[LawFinding]:
    """Yield a finding where new parameters move the command more than with the memory left alone."""
    driven = Driven(law, 1e9)
    driven.run(steady(200))
    before = driven.memory.effort
    where = name_of(law.reconfigure)
    same = law.reconfigure(driven.memory, steady(1)[0], driven.constants, driven.constants)
    if repr(same) != repr(driven.memory):
        yield LawFinding(
            "reconfigure",
            where,
            f"unchanged constants change the memory from {driven.memory!r} to {same!r}",
            "return the memory",
        )
        return
    sample = Sample(*steady(1)[0][:3], 1e-9, steady(1)[0].hip)
    for name, value in _tunable(law).items():
        try:
            changed = build(law.config, {**values_of(driven.config), name: 1.25 * value})
        except ParameterError:
            continue

        def jump(memory: Any, constants: Any = changed.constants) -> float:
            _, terms = law.update(memory, sample, constants, driven.limits)
            return float(abs(terms.effort - before))

        left = jump(driven.memory)
        taken = jump(
            law.reconfigure(driven.memory, steady(1)[0], driven.constants, changed.constants)
        )
        if not taken <= left * (1.0 + 1e-9) + 1e-9:
            yield LawFinding(
                "reconfigure",
                where,
                f"{name} = {1.25 * value:g} moves the command by {taken:.3g} N m at once, "
                f"by {left:.3g} N m with the memory left alone",
                "choose the memory so that the command stays",
            )
            return


def _tunable(law: Law) -> dict[str, float]:
    """Return the law's own parameters of one number that may change while it runs."""
    shared = set(declarations(ControllerConfig))
    values = values_of(law.config())
    return {
        name: float(value)
        for name, declared in declarations(law.config).items()
        if name not in shared
        and not declared.fixed
        and isinstance(value := values[name], float)
        and value != 0.0
    }


def keeps_time(law: Law) -> Iterator[LawFinding]:
    """Yield if the command depends on how many samples were taken, not on time."""
    efforts = []
    for dt in (DT, DT / 5.0):
        driven = Driven(law, 1e9)
        for sample in steady(round(0.5 / dt), dt):
            driven.update(sample)
        efforts.append(driven.memory.effort)
    coarse, fine = efforts
    if abs(fine - coarse) > 0.05 * (abs(coarse) + 1.0):
        yield LawFinding(
            "time",
            name_of(law.update),
            f"0.5 s at an error of 0.2 rad give {coarse:.6g} N m with dt = {DT:g} s, {fine:.6g} N m with "
            f"dt = {DT / 5.0:g} s",
            "multiply what is added up by sample.dt, divide differences by it",
        )
