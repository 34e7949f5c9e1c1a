"""The page on which a plan is edited in the browser."""

from crowd_env.rendering.editor.page import editor_page

__all__ = ["editor_page"]
