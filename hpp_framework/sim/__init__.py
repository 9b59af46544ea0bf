"""Simulators and the pictures of them; see ``hpp_framework.sim.simulator`` for the interface."""

from hpp_framework.sim.factory import BACKENDS, make_simulator
from hpp_framework.sim.sapien_render import rendering_problem
from hpp_framework.sim.simulator import CONTROL_PERIOD, Simulator

__all__ = ["BACKENDS", "CONTROL_PERIOD", "Simulator", "make_simulator", "rendering_problem"]
