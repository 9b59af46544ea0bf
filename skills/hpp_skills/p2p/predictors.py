"""Where the weights of the motion models of this skill lie."""

from __future__ import annotations

from pathlib import Path


def folder() -> Path:
    """Return the folder with the shipped predictor weights."""
    return Path(__file__).parent / "predictors"
