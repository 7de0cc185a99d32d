"""Animations that redraw only the moving artists."""

from __future__ import annotations

import io
import itertools
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import matplotlib as mpl
import numpy as np
from matplotlib.animation import FuncAnimation, HTMLWriter, PillowWriter
from matplotlib.backends.backend_agg import FigureCanvasAgg
from PIL import Image

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Scene(Protocol):
    """Interface of animated scenes."""

    figure: Figure

    def show(self, number: int) -> list[Any]:
        """Set what moves to a picture, and give its artists."""


class Video(FuncAnimation):
    """A scene as an animation.

    Parameters
    ----------
    scene : Scene
        The scene to draw.
    frames : int
        Number of pictures.
    fps : float
        Pictures a second.
    """

    def __init__(self, scene: Scene, frames: int, fps: float) -> None:
        self._scene, self._pictures, self._fps = scene, frames, fps
        super().__init__(scene.figure, scene.show, frames=frames, interval=1000.0 / fps, blit=False)

    def save(self, filename: Any, writer: Any = None, *given: Any, **more: Any) -> None:
        """Write the animation, as `matplotlib.animation.Animation.save`.

        A GIF frame lasts a whole number of hundredths of a second; the numbers are chosen so that
        the animation lasts as long as the motion.
        """
        if writer in (None, "pillow") and str(filename).lower().endswith(".gif"):
            made: Any = _Gif  # it is typed for whole numbers
            writer = made(fps=(given[0] if given else more.pop("fps", None)) or self._fps)
            given = (None, *given[1:])
            if not any(given) and more.keys() <= {"dpi", "progress_callback"}:
                self._draw_was_started = True  # it is looked at
                self._write(filename, writer, **more)
                return
        super().save(filename, writer, *given, **more)

    def _write(
        self, filename: Any, writer: Any, dpi: Any = None, progress_callback: Any = None
    ) -> None:
        """Write all frames, of which only the moving artists are drawn."""
        with (
            _Pictures(self._scene, dpi) as pictures,
            writer.saving(pictures, str(filename), dpi=pictures.dpi),
        ):
            for number in range(self._pictures):
                pictures.number = number
                if progress_callback is not None:
                    progress_callback(number, self._pictures)
                writer.grab_frame()

    def to_jshtml(
        self, fps: int | None = None, embed_frames: bool = True, default_mode: str | None = None
    ) -> str:
        """Return a page with buttons, as `matplotlib.animation.Animation.to_jshtml`."""
        if not embed_frames:
            text: str = super().to_jshtml(fps, embed_frames, default_mode)
            return text
        self._draw_was_started = True  # it is looked at
        mode = default_mode or ("loop" if getattr(self, "_repeat", True) else "once")
        made: Any = HTMLWriter  # it is not typed, and takes any rate
        writer = made(fps=fps or self._fps, embed_frames=True, default_mode=mode)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "video.html")
            self._write(path, writer)
            return path.read_text()


class _Gif(PillowWriter):
    """Writes GIFs whose frame durations add up to the duration of the motion."""

    _frames: list[Any]

    def grab_frame(self, **settings: Any) -> None:
        """Store a frame; a `_Pictures` has it as an image."""
        if isinstance(self.fig, _Pictures):
            self._frames.append(self.fig.image())
        else:
            super().grab_frame(**settings)
            self._frames[-1] = self._frames[-1].convert("RGB")

    def finish(self) -> None:
        """Write all pictures, each with its duration (ms)."""
        # one palette for all frames: a palette for each takes longer
        palette = _palette(self._frames[0], self._frames[-1])
        plain = Image.Dither.NONE
        first, *others = (it.quantize(palette=palette, dither=plain) for it in self._frames)
        ends = [round(100.0 * k / self.fps) for k in range(len(self._frames) + 1)]
        durations = [10 * (after - before) for before, after in itertools.pairwise(ends)]
        settings = {"save_all": True, "append_images": others, "duration": durations, "loop": 0}
        first.save(self.outfile, **settings)


def _palette(*frames: Image.Image) -> Image.Image:
    """Return a picture whose palette has the most frequent colours of frames, well separated."""
    found: list[Any] = []
    for frame in frames:
        found += frame.getcolors(frame.width * frame.height) or []
    chosen: list[Any] = []
    for _, colour in sorted(found, reverse=True):
        if all(np.abs(np.subtract(colour, it)).max() > 8 for it in chosen):
            chosen.append(colour)
        if len(chosen) == 256:
            break
    palette = Image.new("P", (1, 1))
    palette.putpalette([value for colour in chosen for value in colour])
    return palette


class _Pictures:
    """A figure of which only what moves is drawn for each picture."""

    def __init__(self, scene: Scene, dpi: float | str | None = None) -> None:
        self._scene, self.number = scene, 0
        self._shown_in = scene.figure.canvas
        wanted: Any = mpl.rcParams["savefig.dpi"] if dpi is None else dpi
        self.dpi: float = self._shown_in.figure.dpi if wanted == "figure" else wanted
        self._dpi_before = scene.figure.dpi

    def __enter__(self) -> _Pictures:
        figure = self._scene.figure
        figure.set_dpi(self.dpi)
        made: Any = FigureCanvasAgg
        self._canvas = made(figure)
        self._moving = sorted(self._scene.show(0), key=_depth)
        for artist in self._moving:
            artist.set_animated(True)
        self._canvas.draw()
        self._still = self._canvas.copy_from_bbox(figure.bbox)
        return self

    def __exit__(self, *error: object) -> None:
        for artist in self._moving:
            artist.set_animated(False)
        self._scene.figure.set_dpi(self._dpi_before)
        self._scene.figure.set_canvas(self._shown_in)

    def get_size_inches(self) -> Any:
        """Return width and height, as a figure."""
        return self._scene.figure.get_size_inches()

    def image(self) -> Image.Image:
        """Draw the picture of the present number."""
        self._canvas.restore_region(self._still)
        self._scene.show(self.number)
        for artist in self._moving:
            artist.axes.draw_artist(artist)
        return Image.fromarray(np.asarray(self._canvas.buffer_rgba())).convert("RGB")

    def savefig(self, file: io.BytesIO, **settings: Any) -> None:
        """Write the picture of the present number as PNG."""
        self.image().save(file, "png")


def _depth(artist: Any) -> tuple[float, int]:
    """Return the place in which axes draw an artist."""
    return artist.zorder, artist.axes.get_children().index(artist)
