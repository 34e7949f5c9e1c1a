"""Plain data, as JSON and TOML hold it."""

from crowd_env.core.checks import Plain

__all__ = ["Plain"]
