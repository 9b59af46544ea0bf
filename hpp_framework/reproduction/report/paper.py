"""The paper's figures: what each shows by its caption and text, and what of ours stands beside it."""

from __future__ import annotations

from typing import NamedTuple

from hpp_framework.reproduction.experiments import CENTRALIZED, RRT, SCANNED, SIMULATED

CITATION = (
    "Wang et al., “Model-based Reinforcement Learning for Decentralized Multiagent Rendezvous”, CoRL 2020"
)


class PaperFigure(NamedTuple):
    """A figure of the paper with results: its caption, and what the paper's text reads from it.

    Of ours, ``worlds`` and ``planners`` (registered names) stand beside it; empty for all that ran.
    """

    number: int
    title: str
    caption: str
    reading: str
    worlds: tuple[str, ...] = ()
    planners: tuple[str, ...] = ()


FIGURES = (
    PaperFigure(
        4, "HPP against centralised heuristics",
        "Distance between agents over planning time in unseen simulation environments. Lower is better.",
        "HPP brings agents closer than RP everywhere, and than MP at the wall, which MP does not overcome. "
        "OA agents get close but chase each other without a rendezvous.",
        SIMULATED, ("hpp", *CENTRALIZED),
    ),
    PaperFigure(
        5, "HPP against RRT and MADDPG",
        "Distance between agents over planning time in unseen simulation environments. Lower is better.",
        "HPP is similar to RRT in the simple world and better elsewhere. MADDPG is better than HPP in the "
        "simple world, similar at the wall, and fails in navigation.",
        SIMULATED, ("hpp", *RRT, "maddpg"),
    ),
    PaperFigure(
        7, "Rooms made from scans",
        "Distance between agents in environments reconstructed from scans of a real room. Lower is better.",
        "All are alike in the simple room, MP struggles at the wall, MADDPG roams in circles as rooms get "
        "harder, and HPP itself struggles among the tables' legs.",
        SCANNED, ("hpp", "rrt-oa", *CENTRALIZED, "maddpg"),
    ),
    PaperFigure(
        8, "Training of MADDPG",
        "MADDPG training curves: the standard deviation across a batch of training runs, and the best "
        "trained model, which is the baseline.",
        "It takes a million steps to converge, and 3 of 10 seeds failed to.",
    ),
    PaperFigure(
        9, "Kinds of prediction", "HPP in the wall world with three prediction models. Lower is better.",
        "delta-pose-lidar does best; the other two do equally well.",
    ),
    PaperFigure(
        10, "Planning frequency",
        "How often the planner chooses a new goal, in three worlds. Lower is better.",
        "Planning every 5 steps completes the task faster than every 10 or 15, and the more so the more "
        "complex the world.",
    ),
    PaperFigure(
        11, "Planning horizon", "How far the planner looks ahead, in three worlds. Lower is better.",
        "It matters less than the planning frequency, and should be tuned once per predictor.",
    ),
    PaperFigure(
        12, "Training of the predictors",
        "Training losses of the three kinds of prediction models, of oneself and of the other robot.",
        "All converge, and predicting oneself is easier than predicting another.",
    ),
)  # fmt: skip
