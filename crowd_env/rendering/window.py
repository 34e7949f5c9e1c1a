"""Frames on the screen, in real time."""

import time

import numpy as np
from numpy.typing import NDArray

from crowd_env.rendering.libraries import drawing_library


class Window:
    """A window that shows frames; it opens with the first one.

    Parameters
    ----------
    title : of the window.
    fps : frames per second of real time; ``show`` waits until a frame is due.  0 never waits.

    Raises
    ------
    ValueError
        If ``fps`` is negative.

    Examples
    --------
    >>> with Window("room-v0", fps=10) as window:
    ...     for frame in frames:
    ...         if not window.show(frame):
    ...             break
    """

    def __init__(self, title: str = "crowd_env", *, fps: float = 10.0) -> None:
        if not fps >= 0:
            raise ValueError(f"fps is {fps!r}; it must be >= 0")
        self.title = title
        self.fps = fps
        self.is_open = True  # until it is closed by the user or by `close`
        self._size = (0, 0)
        self._due = 0.0

    def show(self, frame: NDArray[np.uint8]) -> bool:
        """Show ``frame`` (H, W, 3) when it is due; return False, and show nothing, once the window was closed."""
        if not self.is_open:
            return False
        with drawing_library():
            import pygame
        size = (frame.shape[1], frame.shape[0])
        if size != self._size or pygame.display.get_surface() is None:
            if not pygame.display.get_init():
                pygame.display.init()
            self._surface = pygame.display.set_mode(size)
            pygame.display.set_caption(self.title)
            self._size = size
        if any(event.type == pygame.QUIT for event in pygame.event.get()):
            self.close()
            return False
        self._wait()
        image = pygame.image.frombuffer(np.ascontiguousarray(frame).tobytes(), size, "RGB")
        self._surface.blit(image, (0, 0))
        pygame.display.flip()
        return True

    def close(self) -> None:
        """Close the window; a second time does nothing."""
        self.is_open = False
        if self._size != (0, 0):
            with drawing_library():
                import pygame
            pygame.display.quit()
            self._size = (0, 0)

    def __enter__(self) -> "Window":
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def _wait(self) -> None:
        if not self.fps:
            return
        now = time.monotonic()
        time.sleep(max(self._due - now, 0.0))
        # A late frame hastens no other: the next frame is due one interval from when this one was shown.
        self._due = max(self._due, now) + 1.0 / self.fps
