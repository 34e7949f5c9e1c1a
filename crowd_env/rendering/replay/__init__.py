"""A recording as one web page that plays offline, from a file, in any current browser."""

from crowd_env.rendering.replay.page import write_page

__all__ = ["write_page"]
