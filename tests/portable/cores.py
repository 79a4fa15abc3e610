"""The pure cores in closed loop, and the elementary functions: SHA-256 of what they return.

python -m tests.portable.cores [STEPS]     needs NumPy alone
"""

import json
import struct
import sys
from dataclasses import replace
from hashlib import sha256

from trunk_control.computed_torque import ComputedTorqueConfig
from trunk_control.controller import Controller
from trunk_control.decide import Reading
from trunk_control.fuzzy_pid import FuzzyPidConfig
from trunk_control.law import Hip
from trunk_control.lqr import LqrConfig
from trunk_control.pid import PidConfig
from trunk_sim.config import TrunkSimulator
from trunk_sim.disturbance_config import DisturbanceConfig
from trunk_sim.disturbances import disturbance_at
from trunk_sim.noise import Noise
from trunk_sim.simulation import Simulation

from . import vectors

RATE = 1000.0
PLANT = TrunkSimulator(
    update_rate=RATE,
    substeps=1,
    initial_position=(0.0, 0.1),
    position_noise=1e-3,
    velocity_noise=1e-2,
    seed=7,
)
DISTURBED = DisturbanceConfig(
    noise_rms=0.3, sine_amplitude=0.2, sine_frequency=0.7, pulse_magnitude=1.0
)
# With a sine as reference, and what else reaches the elementary functions.
CONTROLLERS = (
    PidConfig(update_rate=RATE, reference_profile="sine", reference_amplitude=0.1),
    FuzzyPidConfig(update_rate=RATE, consequents="log"),
    LqrConfig(update_rate=RATE, reference_profile="sine", reference_amplitude=0.1),
    ComputedTorqueConfig(update_rate=RATE),
)


def fingerprints(steps: int) -> dict[str, str]:
    """Return the SHA-256 of this many steps, a quarter of them with each controller."""
    found = {name: sha256() for name in ("states", "commands", "noise")}
    for index, config in enumerate(CONTROLLERS):
        simulation = Simulation(replace(PLANT, seed=index))
        controller, noise = Controller(config), Noise(index)
        signals = replace(DISTURBED, noise_seed=index).signals
        for _ in range(steps // len(CONTROLLERS)):
            stamp_ns = simulation.stamp_ns
            acting = disturbance_at(stamp_ns, signals)
            measured = simulation.measure(acting)
            (x, theta), (x_dot, theta_dot) = measured.position, measured.velocity
            answer = controller.decide(Reading(stamp_ns, theta, theta_dot, Hip(x, x_dot)))
            simulation.step(answer.effort, acting)
            found["states"].update(struct.pack("<4d", *simulation.state))
            found["commands"].update(struct.pack("<d", answer.effort))
            found["noise"].update(struct.pack("<2d", *noise.pair(simulation.step_index)))
    found["elementary"] = sha256("".join(vectors.lines(steps // 4)).encode())
    return {name: digest.hexdigest() for name, digest in found.items()}


if __name__ == "__main__":
    print(json.dumps(fingerprints(int(sys.argv[1]) if len(sys.argv) > 1 else 100_000)))
