"""Evacuations by the rule, from the reset to the end."""

from crowd_env import CrowdEnv


def evacuated(*args, seed=0, **options):
    """Return the environment that these arguments make, once every evacuation in it has ended."""
    env = CrowdEnv(*args, **options)
    env.reset(seed=seed)
    while not env.finished.all():
        env.step(None)
    return env
