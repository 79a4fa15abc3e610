"""The controllers that rest on a model of the plant, sample by sample: LQR and computed torque."""

from __future__ import annotations

from .computed_torque import Hip, computed_torque_update, inverse_dynamics
from .controller import Controller
from .controller_config import ControllerConfig
from .lqr import lqr_update
from .model_config import ComputedTorqueConfig, LqrConfig
from .pid import Gains, PidState, Terms


class LqrController(Controller):
    """State feedback with the gains of a Riccati equation."""

    config: LqrConfig

    def _configure(self, config: ControllerConfig) -> None:
        super()._configure(config)
        self._lqr_gains = self.config.gains

    def _gains(self) -> Gains:
        return self._lqr_gains

    def _update(
        self, reference: float, measurement: float, rate: float, hip: Hip, dt: float
    ) -> tuple[PidState, Terms]:
        return lqr_update(
            self.state,
            reference,
            measurement,
            rate,
            dt,
            self._lqr_gains,
            self.config.gravity_torque,
            self._law,
        )


class ComputedTorqueController(Controller):
    """Inverse dynamics of a model, fed with the measured motion of trunk and hip."""

    config: ComputedTorqueConfig

    def __init__(self, config: ControllerConfig) -> None:
        self._seen = (Hip(), 0.0, 0.0)  # hip, angle, rate at the last sample
        super().__init__(config)

    def _configure(self, config: ControllerConfig) -> None:
        super()._configure(config)
        self._wanted = self.config.gains
        self._model = self.config.model

    def _gains(self) -> Gains:
        inertia, _ = inverse_dynamics(*self._seen, self._model)
        return Gains(*(inertia * gain for gain in self._wanted))

    def _update(
        self, reference: float, measurement: float, rate: float, hip: Hip, dt: float
    ) -> tuple[PidState, Terms]:
        state, terms = computed_torque_update(
            self.state, reference, measurement, rate, dt, hip, self._wanted, self._model, self._law
        )
        if state is not self.state:
            self._seen = hip, measurement, rate
        return state, terms
