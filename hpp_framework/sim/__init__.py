"""Simulators and the pictures of them; see ``hpp_framework.sim.simulator`` for the interface."""

from hpp_framework.sim.factory import BACKENDS, make_simulator
from hpp_framework.sim.sapien.render import rendering_problem
from hpp_framework.sim.simulator import Simulator

__all__ = ["BACKENDS", "Simulator", "make_simulator", "rendering_problem"]
