"""The paper's figures: what each shows by its caption and text, and what of ours stands beside it."""

from __future__ import annotations

from dataclasses import dataclass

CITATION = (
    "Wang et al., “Model-based Reinforcement Learning for Decentralized Multiagent Rendezvous”, CoRL 2020"
)


@dataclass(frozen=True, kw_only=True)
class PaperFigure:
    """A figure of the paper with results.

    Attributes:
        number: in the paper.
        title: what it is about.
        caption: of the paper, without its layout.
        reading: what the paper's text reads from it.
        worlds: of ours that stand beside it; empty for all that ran.
        planners: of the main comparison that stand beside it, their registered names; empty for all.
    """

    number: int
    title: str
    caption: str
    reading: str
    worlds: tuple[str, ...] = ()
    planners: tuple[str, ...] = ()


SIMULATED = ("simple", "wall", "navigation")
SCANNED = ("real-simple", "real-wall", "real-forest", "real-roundabout")
_HEURISTICS = ("centralized-mp", "centralized-oa", "centralized-rp")
_LOWER = "Lower is better."

FIGURES = (
    PaperFigure(
        number=4, title="HPP against centralised heuristics",
        caption=f"Distance between agents over planning time in unseen simulation environments. {_LOWER}",
        reading="HPP brings agents closer than RP everywhere, and than MP at the wall, which MP does not "
        "overcome. OA agents get close but chase each other without a rendezvous.",
        worlds=SIMULATED, planners=("hpp", *_HEURISTICS),
    ),
    PaperFigure(
        number=5, title="HPP against RRT and MADDPG",
        caption=f"Distance between agents over planning time in unseen simulation environments. {_LOWER}",
        reading="HPP is similar to RRT in the simple world and better elsewhere. MADDPG is better than HPP "
        "in the simple world, similar at the wall, and fails in navigation.",
        worlds=SIMULATED, planners=("hpp", "rrt-mp", "rrt-oa", "rrt-cem", "maddpg"),
    ),
    PaperFigure(
        number=7, title="Rooms made from scans",
        caption=f"Distance between agents in environments reconstructed from scans of a real room. {_LOWER}",
        reading="All are alike in the simple room, MP struggles at the wall, MADDPG roams in circles as "
        "rooms get harder, and HPP itself struggles among the tables' legs.",
        worlds=SCANNED, planners=("hpp", "rrt-oa", *_HEURISTICS, "maddpg"),
    ),
    PaperFigure(
        number=8, title="Training of MADDPG",
        caption="MADDPG training curves: the standard deviation across a batch of training runs, and the "
        "best trained model, which is the baseline.",
        reading="It takes a million steps to converge, and 3 of 10 seeds failed to.",
    ),
    PaperFigure(
        number=9, title="Kinds of prediction",
        caption=f"HPP in the wall world with three prediction models. {_LOWER}",
        reading="delta-pose-lidar does best; the other two do equally well.",
    ),
    PaperFigure(
        number=10, title="Planning frequency",
        caption=f"How often the planner chooses a new goal, in three worlds. {_LOWER}",
        reading="Planning every 5 steps completes the task faster than every 10 or 15, and the more so the "
        "more complex the world.",
    ),
    PaperFigure(
        number=11, title="Planning horizon",
        caption=f"How far the planner looks ahead, in three worlds. {_LOWER}",
        reading="It matters less than the planning frequency, and should be tuned once a predictor.",
    ),
    PaperFigure(
        number=12, title="Training of the predictors",
        caption="Training losses of the three kinds of prediction models, of oneself and of the other robot.",
        reading="All converge, and predicting oneself is easier than predicting another.",
    ),
)  # fmt: skip
