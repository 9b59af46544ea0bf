"""Pictures of worlds: as many tiles as worlds and seeds, four in a row."""

import cv2
import pytest

from hpp_framework.utils.errors import HppError
from hpp_framework.viz.world_pictures import draw_rooms, draw_worlds


def test_worlds_are_drawn_in_rows_of_four(tmp_path):
    five = cv2.imread(str(draw_worlds(tmp_path / "new" / "five.png", ("simple",), seeds=range(5), side=80)))
    assert five.shape == (160, 320, 3)
    assert (five[80:, 80:] == 255).all()
    assert not (five[80:, :80] == 255).all()
    two = cv2.imread(str(draw_worlds(tmp_path / "two.png", ("simple", "wall"), side=80)))
    assert two.shape == (80, 160, 3)


def test_the_catalogue_is_drawn(tmp_path):
    assert draw_worlds(tmp_path / "worlds.png", side=120).stat().st_size > 1000


def test_a_folder_that_cannot_be_written_is_told(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(HppError, match="could not be written"):
        draw_worlds(tmp_path / "file" / "worlds.png", ("simple",), side=80)


@pytest.mark.sapien
def test_rooms_are_drawn_in_three_dimensions(tmp_path):
    camera = pytest.importorskip("hpp_framework.sim.sapien.camera")
    if camera.rendering_problem() is not None:
        pytest.skip("SAPIEN cannot draw here")
    rooms = cv2.imread(str(draw_rooms(tmp_path / "rooms.png", ("simple", "real-wall"), size=(96, 64))))
    assert rooms.shape == (64, 192, 3)
    assert rooms[:, :96].std() > 5
    assert rooms[:, 96:].std() > 5
