"""Random worlds: the furnished room that skills and predictors are trained in."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hpp_framework.core.world import Box, Cylinder, SpawnRule, World


@dataclass(frozen=True, kw_only=True)
class Furniture:
    """How much and what furniture a random room holds.

    Attributes:
        side: of the square room, in metres (20 in the paper's appendix C).
        pieces: fewest and most pieces of furniture.
        keep_free: radius in metres around the room's centre that stays empty of furniture centres.
    """

    side: float = 20.0
    pieces: tuple[int, int] = (12, 40)
    keep_free: float = 0.0


def training(rng: np.random.Generator, furniture: Furniture | None = None) -> World:
    """Furnish a room at random: cupboards, tables, chairs, pillars, screens and thin walls.

    Args:
        rng: source of randomness; one room a state.
        furniture: how much of it.
    """
    furniture = furniture or Furniture()
    half = furniture.side / 2
    boxes: list[Box] = []
    cylinders: list[Cylinder] = []
    for _ in range(int(rng.integers(furniture.pieces[0], furniture.pieces[1] + 1))):
        center = rng.uniform(-half + 0.3, half - 0.3, 2)
        if math.hypot(*center) < furniture.keep_free:
            continue
        _PIECES[int(rng.choice(len(_PIECES), p=_SHARES))](rng, center, boxes, cylinders)
    return World(
        name="training",
        bounds=(-half, -half, half, half),
        boxes=tuple(boxes),
        cylinders=tuple(cylinders),
        spawn=SpawnRule(),
    )


def _cupboard(rng: np.random.Generator, center: np.ndarray, boxes: list[Box], _: list[Cylinder]) -> None:
    boxes.append(_box(center, rng.uniform(0.4, 2.0, 2), rng.uniform(-math.pi, math.pi)))


def _wall(rng: np.random.Generator, center: np.ndarray, boxes: list[Box], _: list[Cylinder]) -> None:
    yaw = rng.integers(4) * math.pi / 2 if rng.random() < 0.5 else rng.uniform(-math.pi, math.pi)
    boxes.append(_box(center, np.array([rng.uniform(1.5, 5.0), rng.uniform(0.1, 0.3)]), yaw))


def _corner(rng: np.random.Generator, center: np.ndarray, boxes: list[Box], _: list[Cylinder]) -> None:
    yaw = float(rng.uniform(-math.pi, math.pi))
    for turn, length in zip((0.0, math.pi / 2), rng.uniform(1.0, 3.0, 2), strict=True):
        direction = np.array([math.cos(yaw + turn), math.sin(yaw + turn)])
        boxes.append(_box(center + direction * length / 2, np.array([length, 0.15]), yaw + turn))


def _pillar(rng: np.random.Generator, center: np.ndarray, _: list[Box], cylinders: list[Cylinder]) -> None:
    x, y = center.tolist()
    cylinders.append(Cylinder(center=(x, y), radius=float(rng.uniform(0.1, 0.5))))


def _table(rng: np.random.Generator, center: np.ndarray, boxes: list[Box], cylinders: list[Cylinder]) -> None:
    yaw = float(rng.uniform(-math.pi, math.pi))
    length, width = rng.uniform(0.8, 2.0), rng.uniform(0.6, 1.2)
    axis = np.array([math.cos(yaw), math.sin(yaw)])
    side = np.array([-axis[1], axis[0]])
    for along in (-0.5, 0.5):
        for across in (-0.5, 0.5):
            x, y = (center + axis * length * along + side * width * across).tolist()
            cylinders.append(Cylinder(center=(x, y), radius=0.04))


def _box(center: np.ndarray, size: np.ndarray, yaw: float) -> Box:
    return Box(
        center=(float(center[0]), float(center[1])), size=(float(size[0]), float(size[1])), yaw=float(yaw)
    )


_PIECES = (_cupboard, _wall, _corner, _pillar, _table)
_SHARES = (0.35, 0.2, 0.1, 0.2, 0.15)
