"""Videos that every browser plays: H.264, yuv420p, index at the front."""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import numpy.typing as npt
from av.error import FFmpegError

from hpp_framework.utils.errors import ConfigError, HppError

Frame = npt.NDArray[np.uint8]

QUALITY = "20"
"""Constant rate factor of x264; 18 to 23 look the same to most eyes."""


def write_video(file: Path, frames: Iterable[Frame], fps: float) -> Path:
    """Write frames to an MP4 file, which appears only once it is complete.

    Args:
        file: the video; its folder is made if need be.
        frames: (height, width, 3) RGB, all of one size; odd sizes are padded by one row or column.
        fps: frames per second.

    Returns:
        The file.

    Raises:
        ConfigError: if there are no frames, their shapes differ or are not RGB, or ``fps`` is not positive.
        HppError: if the file cannot be written (read-only folder, full disk).
    """
    file = Path(file)
    if not 0 < fps <= 240:
        raise ConfigError(f"a video needs 0 < fps <= 240, got {fps}.")
    supply = iter(frames)
    first = next(supply, None)
    if first is None:
        raise ConfigError(f"video '{file}' has no frames. Run at least one step.")
    _check_frame(first, first.shape)
    temporary = file.with_name(f".{file.stem}.{os.getpid()}.mp4")
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        _encode(temporary, itertools.chain([first], supply), first.shape, fps)
        temporary.replace(file)
    except (OSError, FFmpegError) as error:
        reason = error.strerror or str(error)
        raise HppError(
            f"video '{file}' could not be written: {reason}. Choose a folder that is writable and has room."
        ) from error
    finally:
        _remove(temporary)
    return file


def side_by_side(left: Frame, right: Frame) -> Frame:
    """Put two frames (height, width, 3) next to each other; the lower one is centred on a dark ground."""
    height = max(left.shape[0], right.shape[0])
    return np.hstack([_letterbox(left, height), _letterbox(right, height)])


def _encode(file: Path, frames: Iterable[Frame], shape: tuple[int, ...], fps: float) -> None:
    height, width = shape[:2]
    with av.open(str(file), "w", format="mp4", options={"movflags": "+faststart"}) as container:
        stream = container.add_stream("libx264", rate=Fraction(fps).limit_denominator(1001))
        stream.width, stream.height = width + width % 2, height + height % 2
        stream.pix_fmt = "yuv420p"
        stream.options = {"crf": QUALITY, "preset": "veryfast"}
        for frame in frames:
            _check_frame(frame, shape)
            padded = np.pad(frame, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
            picture = av.VideoFrame.from_ndarray(np.ascontiguousarray(padded), format="rgb24")
            container.mux(stream.encode(picture))
        container.mux(stream.encode())


def _check_frame(frame: Frame, shape: tuple[int, ...]) -> None:
    if frame.ndim != 3 or frame.shape[2] != 3 or frame.dtype != np.uint8 or min(frame.shape) < 2:
        raise ConfigError(
            f"a frame must be uint8 of shape (height, width, 3), got {frame.dtype} {frame.shape}."
        )
    if frame.shape != shape:
        raise ConfigError(
            f"all frames of a video must have one size: {shape[:2]} came first, then {frame.shape[:2]}."
        )


def _letterbox(frame: Frame, height: int) -> Frame:
    above = (height - frame.shape[0]) // 2
    below = height - frame.shape[0] - above
    return np.pad(frame, ((above, below), (0, 0), (0, 0)), constant_values=24)


def _remove(file: Path) -> None:
    try:
        file.unlink(missing_ok=True)
    except OSError:
        return  # a folder that takes no file holds none to remove
