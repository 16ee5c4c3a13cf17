"""Pictures into files: PNG, GIF and MP4, whole or not at all."""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from motion import console, files
from motion.errors import UserError

Image = NDArray[np.uint8]

FORMATS = (".png", ".gif", ".mp4")
_H264 = {
    "crf": "18",
    "preset": "veryfast",
}  # nothing is seen to be missing, and it takes half of a frame's time
_PALETTE_OF = 4  # pictures, spread over the first ones, that tell a GIF's colours
_AHEAD, _BYTES = 60, 200_000_000  # pictures that are looked at for that, and what they may take


def suffix(path: str | os.PathLike[str]) -> str:
    """The format that a name asks for; another one is a UserError."""
    found = Path(path).suffix.lower()
    if found not in FORMATS:
        known = ", ".join(f"*{form}" for form in FORMATS)
        raise UserError("no picture or film is named so", path=path, remedy=f"name it {known}")
    return found


def write(path: str | os.PathLike[str], pictures: Iterator[Image], *, fps: float = 30.0) -> int:
    """Write pictures uint8 [H, W, 3] of one size as path's suffix says; returns how many there were.

    A PNG is the first of them. Frames of a GIF last whole hundredths of a second, which differ so that all of
    them last as long as they should. Errors: UserError without the extra viewer for MP4.
    """
    form = suffix(path)
    if form == ".mp4":
        check_mp4()
    with files.atomic(path) as stream:
        if form == ".png":
            _save(next(pictures), stream)
            return 1
        return _mp4(stream, pictures, fps) if form == ".mp4" else _gif(stream, pictures, fps)


@console.needs("viewer", "av")
def check_mp4() -> None:
    """A UserError before the work, not after it."""


def _save(picture: Image, stream: IO[bytes]) -> None:
    from PIL import Image as pillow

    pillow.fromarray(picture).save(stream, format="png")


def _gif(stream: IO[bytes], pictures: Iterator[Image], fps: float) -> int:
    from PIL import Image as pillow

    first = [next(pictures)]
    first += itertools.islice(pictures, min(_AHEAD, _BYTES // first[0].nbytes))
    some = np.concatenate(first[:: max(1, len(first) // _PALETTE_OF)], axis=0)
    palette = pillow.fromarray(some).quantize(256, method=pillow.Quantize.MEDIANCUT)
    count = 0

    def frames() -> Iterator[Any]:
        nonlocal count
        for picture in itertools.chain(first, pictures):
            count += 1
            yield pillow.fromarray(picture).quantize(palette=palette, dither=pillow.Dither.NONE)

    shown = frames()
    # Many more durations than there are frames do no harm.
    ends = np.round(np.arange(10_001) * 100 / fps).astype(int) * 10
    next(shown).save(
        stream, format="gif", save_all=True, append_images=shown, duration=np.diff(ends).tolist(), loop=0
    )
    return count


def _mp4(stream: IO[bytes], pictures: Iterator[Image], fps: float) -> int:
    import av

    try:
        with av.open(stream, "w", format="mp4") as container:
            return _encoded(container, pictures, fps)
    except av.FFmpegError as error:
        # What the stream could not write is raised, then that the end of the film could not be, either.
        if isinstance(error.__context__, OSError):
            raise error.__context__ from None
        raise


def _encoded(container: Any, pictures: Iterator[Image], fps: float) -> int:
    import av

    count, video = 0, None
    for picture in pictures:
        picture = _even(picture)
        if video is None:
            rate = Fraction(fps).limit_denominator(1001)
            video = container.add_stream("libx264", rate=rate, options=_H264)
            video.height, video.width = picture.shape[:2]
            video.pix_fmt = "yuv420p"
            video.thread_count = 1
        container.mux(video.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        count += 1
    if video is not None:
        container.mux(video.encode())
    return count


def _even(picture: Image) -> Image:
    """The picture with an even width and height, as films have them: its last column or row twice."""
    height, width = picture.shape[:2]
    if height % 2 or width % 2:
        picture = np.pad(picture, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
    return np.ascontiguousarray(picture)
