"""Names of the Gymnasium environments. ``import hpp_framework.envs`` registers them."""

from __future__ import annotations

import gymnasium as gym

POINT_TO_POINT = "hpp/PointToPoint-v0"
RENDEZVOUS = "hpp/Rendezvous-v0"


def register_envs() -> None:
    """Register the ids with Gymnasium; calling it again changes nothing."""
    if POINT_TO_POINT not in gym.registry:
        gym.register(
            POINT_TO_POINT,
            entry_point="hpp_framework.envs.single:PointToPointEnv",
            vector_entry_point="hpp_framework.envs.point_to_point:PointToPointVectorEnv",
            kwargs={"unit_actions": True},
        )
    if RENDEZVOUS not in gym.registry:
        gym.register(RENDEZVOUS, entry_point="hpp_framework.envs.rendezvous:RendezvousEnv")
