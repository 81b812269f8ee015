"""A window that shows the pictures of a running episode."""

import sys
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...draw.style import is_seen


class GymWindow:
    """Shows one picture after the other; without a display it says so and shows nothing.

    Parameters
    ----------
    title : of the window.
    """

    def __init__(self, title: str) -> None:
        self._title = title
        self._figure: Any = None
        self._image: Any = None
        self._seen = False

    def show(self, picture: NDArray[np.uint8], seconds: float) -> None:
        """Show a picture for this time; a window that the user has closed opens again."""
        from matplotlib import pyplot

        if self._figure is None or not pyplot.fignum_exists(self._figure.number):
            self._open(picture)
        self._image.set_data(picture)
        if self._seen:
            pyplot.pause(seconds)

    def close(self) -> None:
        """Close the window, if it is open."""
        if self._figure is not None:
            from matplotlib import pyplot

            pyplot.close(self._figure)
            self._figure = None

    def _open(self, picture: NDArray[np.uint8]) -> None:
        from matplotlib import pyplot

        height, width = picture.shape[:2]
        self._figure = pyplot.figure(self._title, figsize=(width / 100, height / 100), dpi=100)
        self._seen = is_seen(self._figure)
        if not self._seen:
            backend = pyplot.get_backend()
            print(
                f"no window: the backend {backend!r} of matplotlib opens none; set MPLBACKEND to "
                "one that does, or take render_mode='rgb_array'",
                file=sys.stderr,
            )
        axes = self._figure.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.axis("off")
        self._image = axes.imshow(picture)
