"""Registers the bundled skills and the weights that come with them."""

from __future__ import annotations

from hpp_framework.plugins.registry import Hub


def register(hub: Hub) -> None:
    """Add every skill of this package."""
    hub.skills.add("p2p", "hpp_skills.p2p.skill:load", summary="learned point-to-point navigation")
    hub.skills.add(
        "p2p-early",
        "hpp_skills.p2p.skill:load_early",
        summary="p2p after 1.5 M steps of training: a poor skill",
    )
    hub.skills.add("dwa", "hpp_skills.dwa.skill:load", summary="dynamic window approach; needs no training")
    hub.skills.add(
        "pure-pursuit", "hpp_skills.pure_pursuit:load", summary="straight to the goal, avoids nothing"
    )
    hub.skill_trainers.add("p2p", "hpp_skills.p2p.train:train", summary="PPO on random furnished rooms")
    hub.skill_searches.add("p2p", "hpp_skills.p2p.search:search", summary="reward, then network, of p2p")
    hub.checkpoints.add(
        "hpp_skills.p2p", "hpp_skills.p2p.skill:predictor_folder", summary="motion models of p2p"
    )
