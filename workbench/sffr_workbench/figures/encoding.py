"""Moving pictures as files: GIF by Pillow, MP4 by PyAV with whatever encoder its FFmpeg has."""

from __future__ import annotations

import io
import tempfile
import warnings
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from sffr_gym import ConfigError

GIF_COLOURS = 96
SAMPLES = 12  # pictures from which a GIF's colours are chosen
# By preference, with its settings: x264, what the system calls H.264, Cisco's, and FFmpeg's own, which is always there.
CODECS: dict[str, dict[str, str]] = {"libx264": {"crf": "20"}, "h264": {}, "libopenh264": {}, "mpeg4": {}}
BITS = 0.2  # for a pixel, of encoders without a setting of the quality


class Pictures(Protocol):
    """Pictures (height, width, 3), uint8, drawn when they are asked for."""

    def __len__(self) -> int: ...
    def __iter__(self) -> Iterator[np.ndarray]: ...
    def __getitem__(self, k: int, /) -> np.ndarray: ...


def gif(pictures: Pictures, fps: int, progress: Callable[[int], Any]) -> bytes:
    """Encode pictures (height, width, 3) as a GIF that repeats for ever, in colours chosen once for all of them."""
    from PIL import Image  # optional

    chosen = np.unique(np.linspace(0, len(pictures) - 1, SAMPLES).round().astype(int))
    sample = Image.fromarray(np.vstack([pictures[k] for k in chosen]))
    palette = sample.quantize(GIF_COLOURS, Image.Quantize.MEDIANCUT)

    def quantized() -> Iterator[Image.Image]:
        for k, picture in enumerate(pictures):
            progress(k)
            yield Image.fromarray(picture).quantize(palette=palette, dither=Image.Dither.NONE)

    each, file = quantized(), io.BytesIO()
    next(each).save(file, "GIF", save_all=True, append_images=each, duration=1000 // fps, loop=0, optimize=True)
    return file.getvalue()


def choose_codec(height: int, width: int, fps: int) -> str:
    """Return the first encoder of ``CODECS`` that encodes a picture of this size; before anything is simulated.

    Raises:
        ConfigError: if PyAV cannot be loaded, or none does.
    """
    try:
        import av  # optional
    except ImportError as error:
        raise ConfigError(f"an MP4 needs PyAV, which cannot be loaded: {error}; a GIF needs Pillow alone") from None
    black, reasons = np.zeros((height, width, 3), dtype=np.uint8), []
    for codec in CODECS:
        try:
            mp4([black], fps, lambda _: None, codec)
        except (av.FFmpegError, ValueError, RuntimeError) as error:
            reasons.append(f"{codec}: {error}")
            continue
        if codec == "mpeg4":
            warnings.warn("this FFmpeg has no encoder of H.264: browsers may not play the film", stacklevel=2)
        return codec
    raise ConfigError(f"no encoder of PyAV's FFmpeg makes an MP4 of {width} x {height} pixels ({'; '.join(reasons)})")


def mp4(pictures: Iterable[np.ndarray], fps: int, progress: Callable[[int], Any], codec: str) -> bytes:
    """Encode pictures (height, width, 3) as an MP4 that browsers start to play while they load it."""
    import av  # optional

    with tempfile.TemporaryDirectory() as folder:  # moving the index to the front takes a file
        file = Path(folder) / "movie.mp4"
        with av.open(str(file), "w", options={"movflags": "faststart"}) as container:
            stream: Any = container.add_stream(codec, rate=fps, options=CODECS[codec])
            for k, picture in enumerate(pictures):
                progress(k)
                height, width = (side // 2 * 2 for side in picture.shape[:2])  # the format wants even sides
                if k == 0:
                    stream.pix_fmt, stream.height, stream.width = "yuv420p", height, width
                    if not CODECS[codec]:
                        stream.bit_rate = round(BITS * height * width * fps)
                even = np.ascontiguousarray(picture[:height, :width])
                container.mux(stream.encode(av.VideoFrame.from_ndarray(even, format="rgb24")))
            container.mux(stream.encode())
        return file.read_bytes()
