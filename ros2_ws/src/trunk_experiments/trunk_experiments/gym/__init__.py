"""The trunk as Gymnasium environments, an optional extra: requirements/gym.txt, docs/gymnasium.md.

Importing this package registers ``trunk/Balance-v0``, and so does
``gymnasium.make("trunk_experiments.gym:trunk/Balance-v0")``.
"""

from trunk_core.errors import NotInstalledError

try:
    from gymnasium.envs.registration import register, registry
except ImportError:
    raise NotInstalledError(
        "gymnasium is not installed; install it with: pip install -r requirements/gym.txt"
    ) from None

ENVIRONMENT = "trunk/Balance-v0"

if ENVIRONMENT not in registry:  # the package may be reloaded
    register(
        ENVIRONMENT,
        entry_point="trunk_experiments.gym.environments:BalanceEnv",
        vector_entry_point="trunk_experiments.gym.environments:BalanceVectorEnv",
    )
