"""Videos: what comes out is what browsers play, and what goes wrong is said."""

import errno

import av
import numpy as np
import pytest

from hpp_framework.utils.errors import ConfigError, HppError
from hpp_framework.viz import video
from hpp_framework.viz.video import side_by_side, write_video


def moving_square(count, height=96, width=128):
    for i in range(count):
        frame = np.full((height, width, 3), 230, np.uint8)
        frame[20:60, 2 * i : 2 * i + 40] = (255, 120, 0)
        yield frame


def decode(file):
    with av.open(str(file)) as container:
        stream = container.streams.video[0]
        context = stream.codec_context
        return (
            context.name,
            context.pix_fmt,
            stream.average_rate,
            [f.to_ndarray(format="rgb24") for f in container.decode(stream)],
        )


def test_video_plays_back_with_every_frame(tmp_path):
    file = write_video(tmp_path / "new folder" / "episode.mp4", moving_square(23), 5)
    codec, pixel_format, rate, frames = decode(file)
    assert (codec, pixel_format, rate, len(frames)) == ("h264", "yuv420p", 5, 23)
    difference = np.abs(frames[10].astype(int) - list(moving_square(11))[10])
    assert difference.mean() < 4
    assert [path.name for path in file.parent.iterdir()] == ["episode.mp4"]


def test_index_stands_before_the_data(tmp_path):
    content = write_video(tmp_path / "episode.mp4", moving_square(5), 10).read_bytes()
    assert 0 < content.index(b"moov") < content.index(b"mdat")


def test_odd_sizes_are_padded(tmp_path):
    frames = decode(write_video(tmp_path / "odd.mp4", moving_square(3, 97, 131), 30))[3]
    assert frames[0].shape == (98, 132, 3)


def test_single_frame_and_fractional_rate(tmp_path):
    assert len(decode(write_video(tmp_path / "one.mp4", moving_square(1), 12.5))[3]) == 1


def test_no_frames_and_bad_frames_are_refused(tmp_path):
    file = tmp_path / "episode.mp4"
    with pytest.raises(ConfigError, match="no frames"):
        write_video(file, [], 5)
    with pytest.raises(ConfigError, match="fps"):
        write_video(file, moving_square(2), 0)
    with pytest.raises(ConfigError, match="uint8"):
        write_video(file, [np.zeros((8, 8), np.uint8)], 5)
    with pytest.raises(ConfigError, match="one size"):
        write_video(file, [np.zeros((8, 8, 3), np.uint8), np.zeros((8, 10, 3), np.uint8)], 5)
    assert list(tmp_path.iterdir()) == []


def test_unwritable_place_is_an_error_that_names_it(tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(HppError, match="could not be written"):
        write_video(tmp_path / "file" / "episode.mp4", moving_square(2), 5)
    (tmp_path / "episode.mp4").mkdir()
    with pytest.raises(HppError, match="could not be written"):
        write_video(tmp_path / "episode.mp4", moving_square(2), 5)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["episode.mp4", "file"]


def test_full_disk_leaves_the_old_video_and_no_rest(tmp_path, monkeypatch):
    file = write_video(tmp_path / "episode.mp4", moving_square(2), 5)
    before = file.read_bytes()

    def full(target, *args):
        target.write_bytes(b"half")
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(video, "_encode", full)
    with pytest.raises(HppError, match="No space left"):
        write_video(file, moving_square(2), 5)
    assert file.read_bytes() == before
    assert list(tmp_path.iterdir()) == [file]


def test_side_by_side_keeps_both_pictures():
    left, right = np.full((4, 6, 3), 200, np.uint8), np.full((8, 2, 3), 100, np.uint8)
    both = side_by_side(left, right)
    assert both.shape == (8, 8, 3)
    assert (both[2:6, :6] == 200).all()
    assert (both[:, 6:] == 100).all()
    assert (both[:2, :6] < 50).all()
