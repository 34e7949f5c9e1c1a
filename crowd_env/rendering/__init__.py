"""Frames, films and figures of evacuations; the drawing libraries are loaded when something is drawn."""

from crowd_env.rendering.canvas import save_figure
from crowd_env.rendering.figures import effect_figure, egress_curves, learning_curve
from crowd_env.rendering.film import write_film, write_still, write_strip
from crowd_env.rendering.forces import force_network, forces_of
from crowd_env.rendering.frames import Renderer
from crowd_env.rendering.survival import survival_curves
from crowd_env.rendering.window import Window

__all__ = [
    "Renderer",
    "Window",
    "effect_figure",
    "egress_curves",
    "force_network",
    "forces_of",
    "learning_curve",
    "save_figure",
    "survival_curves",
    "write_film",
    "write_still",
    "write_strip",
]
