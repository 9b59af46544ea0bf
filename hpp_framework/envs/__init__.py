"""Environments. Importing this package registers their ids with Gymnasium."""

from hpp_framework.envs.episode import EpisodeConfig
from hpp_framework.envs.point_to_point import PointToPointVectorEnv
from hpp_framework.envs.problem import PointToPoint
from hpp_framework.envs.registration import register_envs
from hpp_framework.envs.rendezvous import HierarchyConfig, RendezvousEnv
from hpp_framework.envs.single import PointToPointEnv
from hpp_framework.envs.team import TeamEnv

register_envs()

__all__ = [
    "EpisodeConfig",
    "HierarchyConfig",
    "PointToPoint",
    "PointToPointEnv",
    "PointToPointVectorEnv",
    "RendezvousEnv",
    "TeamEnv",
    "register_envs",
]
