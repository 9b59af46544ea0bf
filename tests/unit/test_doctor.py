"""``hpp doctor``: every problem comes with a remedy that can be copied."""

from __future__ import annotations

import sys
from types import SimpleNamespace

import pytest

from hpp_framework.cli import doctor
from hpp_framework.cli.doctor import COUNTED, HEADLESS, Doctor, Finding
from hpp_framework.plugins.registry import hub
from hpp_framework.plugins.weights import WEIGHTS_VARIABLE

BUILD = "\n  GUI:                           {gui}\n    QT:                          YES\n"


@pytest.fixture
def opencv(monkeypatch):
    """Return a function that pretends that ``cv2`` was built with a GUI, and what is installed."""

    def pretend(gui, *distributions):
        cv2 = SimpleNamespace(__version__="5.0", getBuildInformation=lambda: BUILD.format(gui=gui))
        monkeypatch.setitem(sys.modules, "cv2", cv2)
        versions = {name: "5.0" if name in distributions else None for name in doctor.OPENCV}
        monkeypatch.setattr(doctor, "installed", lambda names: versions)
        return doctor._opencv()

    return pretend


def test_an_opencv_that_cannot_be_imported_has_a_remedy(monkeypatch):
    monkeypatch.setitem(sys.modules, "cv2", None)
    finding = doctor._opencv()
    assert not finding.fine
    assert "cannot be imported: " in finding.detail
    assert finding.remedy == HEADLESS == "pip install --force-reinstall --no-deps opencv-python-headless"


@pytest.mark.parametrize(
    ("gui", "distributions", "fine"),
    [
        ("NONE", ("opencv-python-headless",), True),
        ("QT5", ("opencv-python",), True),
        ("NONE", ("opencv-python", "opencv-python-headless"), True),
        ("QT5", ("opencv-python", "opencv-python-headless"), False),
    ],
)
def test_windows_are_a_problem_only_where_they_lie_over_the_headless_files(opencv, gui, distributions, fine):
    finding = opencv(gui, *distributions)
    assert finding.fine == fine
    assert finding.remedy == ("" if fine else HEADLESS)
    assert ("without windows" in finding.detail) == (gui == "NONE")


def test_remedies_are_printed_on_one_line(monkeypatch, capsys):
    remedy = "pip install " + " ".join(f"package-{number}" for number in range(30))

    def sick():
        return Finding("sick", "a long story " * 10, fine=False, remedy=remedy)

    for check in ("_batch", "_sapien", "_pictures"):
        monkeypatch.setattr(doctor, check, sick)
    Doctor().run()
    assert f"      {remedy}\n" in capsys.readouterr().out


def test_all_kinds_that_the_docs_promise_are_counted():
    shown = doctor._plugins().detail
    assert set(COUNTED) <= set(hub().registries())
    for name in ("robots", "skills", "tasks", "worlds", "planners", "predictors"):
        assert f" {name}" in shown


def test_a_folder_of_weights_that_is_not_there_is_found(monkeypatch, tmp_path):
    assert doctor._weights().fine
    monkeypatch.setenv(WEIGHTS_VARIABLE, str(tmp_path / "nowhere"))
    finding = doctor._safely(doctor._weights)
    assert not finding.fine
    assert "nowhere" in finding.detail
