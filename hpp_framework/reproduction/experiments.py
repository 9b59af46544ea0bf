"""The experiments of a reproduction, at three scales."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

from hpp_framework.config.team_file import effective_team
from hpp_framework.evaluation.experiment import Experiment
from hpp_framework.evaluation.predictor_study import PredictorStudy
from hpp_framework.plugins.builtin import DEFAULT_CONTROL
from hpp_framework.reproduction.plan import Curves, Planned
from hpp_framework.utils.errors import unknown_name

SIMULATED = ("simple", "wall", "navigation")
SCANNED = ("real-simple", "real-wall", "real-forest", "real-roundabout")

BEST, PAPER = "hpp", "hpp:preset=paper"
CENTRALIZED = ("centralized-mp", "centralized-oa", "centralized-rp")
RRT = ("rrt-mp", "rrt-oa", "rrt-cem")
MAPPED = tuple(f"{name}:known_map=true" for name in RRT)
RULE = "geodesic-midpoint"
"""The strongest rule: it learns and infers nothing."""
LEARNED = "maddpg"
ORACLES = ("full-communication", "perfect-model")

KINDS = ("delta-pose-lidar", "pose-lidar", "delta-general-pose-lidar")
"""The paper's motion models; its own first."""

FREQUENCIES = tuple(f"hpp:plan_every={steps}" for steps in (5, 10, 15))
HORIZONS = tuple(f"hpp:horizon={steps}" for steps in (5, 2, 10, 20))
SAMPLING = (
    "hpp", "hpp:cem.iterations=5", "hpp:cem.iterations=30", "hpp:cem.samples=30", "hpp:cem.elites=10",
    "hpp:cem.elites=15",
)  # fmt: skip
SWITCHES = (
    BEST, "hpp:respond=false", "hpp:mixture=false", "hpp:likelihood_weight=0",
    "hpp:occlusion_penalty=0", "hpp:patience=0", "hpp:uncertainty_penalty=0",
    "hpp:hysteresis=0.4", "hpp:terminal=0", "hpp:shared=false",
    "hpp:horizon=5",
)  # fmt: skip
SWITCHED_WORLDS = ("wall", "navigation", "real-roundabout")
MODELS = (
    BEST, "hpp:predictor=constant-velocity:horizon=75", "hpp:predictor=delta-pose-lidar:horizon=25",
)  # fmt: skip
"""A model that knows nothing of goals, 15 s ahead, and the paper's own, 5 s ahead."""
TRAINED = "p2p"
"""The skill of all weights."""
DISTURBED = (BEST, RULE, PAPER, "centralized-oa")
STACKS = {
    "none": ("no control layers", "none"),
    "stop": ("stop on success alone", "stop-on-success"),
    "safe": ("stop on success and safety", "stop-on-success,separation,safety-filter,watchdog"),
    "approach": (
        "all layers but rotate-to-path",
        "terminal-approach,yield-together,stop-on-success,separation,safety-filter,watchdog",
    ),
    "all": ("all layers", DEFAULT_CONTROL),
}
"""Control stacks by what they leave out."""
STACKED = (BEST, RULE, "centralized-oa", "centralized-mp")
STACKED_WORLDS = ("wall", "navigation", "real-roundabout", "real-forest")

SKILLS = {
    "skill-early": ("p2p after 1.5 million steps of training", "p2p-early"),
    "skill-dwa": ("the dynamic window approach", "dwa"),
}
"""Skills other than the one that motion models were trained with, and which they go on to predict."""

MISTAKES: Mapping[str, tuple[str, tuple[Mapping[str, Any], ...]]] = {
    "mistaken-robot": (
        "each robot takes the other for one of its own kind",
        ({"believes": {"freight": "fetch"}}, {"believes": {"fetch": "freight"}}),
    ),
    "mistaken-skill": (
        "Freight drives by dwa, Fetch takes it for p2p",
        (
            {"believes": {"freight": {"skill": TRAINED}}},
            {"skill": "dwa", "believes": {"freight": {"skill": TRAINED}}},
        ),
    ),
    "mistaken-will": (
        "Freight has a goal of its own and keeps it, Fetch takes it for one that wants to agree",
        ({}, {"planner": "stubborn"}),
    ),
}
"""What Fetch and Freight are wrong about: entries of a team file."""

LABORATORY = "ideal"
"""Profile of what the paper asks: its figures know no disturbances."""

DISTURBANCES = {
    "field": ("all of the profile field", "field"),
    "harsh": ("all of the profile harsh", "harsh"),
    "pose-noise-0.2": (
        "poses off by 20 cm and 0.2 rad, white", "ideal:position_std=0.2:heading_std=0.2",
    ),
    "pose-bias-0.3": ("each robot's map is off by 30 cm", "ideal:position_bias=0.3"),
    "pose-jumps": ("poses jump by 30 cm every 20 s", "ideal:jump_rate=0.05:jump_size=0.3"),
    "message-delay-1": ("the others' poses come 1 s late", "ideal:message_delay=1.0"),
    "message-delay-3": ("the others' poses come 3 s late", "ideal:message_delay=3.0"),
    "message-loss-0.9": ("nine of ten of the others' poses are lost", "ideal:message_loss=0.9"),
    "command-delay-0.2": ("commands act 0.2 s late", "ideal:command_delay=0.2"),
    "command-delay-0.4": ("commands act 0.4 s late", "ideal:command_delay=0.4"),
    "blind": (
        "the lidar sends no hit for 2 s, every 10 s", "field:fault=blind:fault_rate=0.1:fault_time=2.0",
    ),
    "frozen": (
        "the lidar sends its last scan for 2 s, every 10 s",
        "field:fault=frozen:fault_rate=0.1:fault_time=2.0",
    ),
}  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Scale:
    """How much is run.

    Attributes:
        episodes: a cell of the main comparison.
        ablation: episodes per cell of everything else.
        trajectories: a world, on which motion models are asked.
        worlds: the first so many of each experiment's worlds.
        arms: the first so many planners of each ablation.
        disturbances: the first so many of each kind.
        stacks: the last so many control stacks.
    """

    episodes: int
    ablation: int
    trajectories: int
    worlds: int | None = None
    arms: int | None = None
    disturbances: int | None = None
    stacks: int = len(STACKS)


SCALES = {
    "smoke": Scale(episodes=2, ablation=2, trajectories=4, worlds=2, arms=2, disturbances=1, stacks=1),
    "standard": Scale(episodes=100, ablation=100, trajectories=200),
    "full": Scale(episodes=500, ablation=500, trajectories=1000),
}


def experiments(scale: str, seed: int) -> list[Planned]:
    """Return everything that is run, the longest first.

    Args:
        scale: name of one of :data:`SCALES`.
        seed: of worlds, starts and agents; all experiments share their episodes.

    Raises:
        UnknownNameError: if there is no such scale.
    """
    if scale not in SCALES:
        raise unknown_name("scale", scale, SCALES)
    size = SCALES[scale]
    main = Planned(
        name="main", title="All planners in all worlds", figure="figures 4, 5 and 7",
        work=Experiment(
            worlds=(*SIMULATED[: size.worlds], *SCANNED[: size.worlds and size.worlds - 1]),
            planners=(BEST, RULE, PAPER, *CENTRALIZED, *RRT, *MAPPED, LEARNED, *ORACLES),
            episodes=size.episodes, seed=seed, disturbances=LABORATORY,
        ),
    )  # fmt: skip
    parts = (
        _faithful(size, seed),
        _ours(size, seed),
        _stacks(size, seed),
        _disturbed(size, seed),
        _mistaken(size, seed),
        _models(size, seed),
    )
    return [main, *chain(*parts)]


def _faithful(size: Scale, seed: int) -> list[Planned]:
    """Return the paper's ablations, of its own planner."""

    def ablation(
        name: str, title: str, figure: str, planners: Sequence[str], *, worlds: Sequence[str] = SIMULATED,
        preset: str = "paper", task: str = "rendezvous",
    ) -> Planned:  # fmt: skip
        work = Experiment(
            worlds=tuple(worlds[: size.worlds]), planners=tuple(planners[: size.arms]), preset=preset,
            episodes=size.ablation, seed=seed, task=task, disturbances=LABORATORY,
        )  # fmt: skip
        return Planned(name=name, title=title, figure=figure, work=work)

    return [
        ablation("frequency", "Planning every 5, 10 or 15 steps", "figure 10", FREQUENCIES),
        ablation("horizon", "How far plans look ahead, in steps", "figure 11", HORIZONS),
        ablation("sampling", "Iterations, samples and elites of CEM", "appendix C.1", SAMPLING),
        ablation(
            "prediction", "What motion models predict", "figure 9",
            [f"hpp:predictor={kind}" for kind in KINDS], worlds=SIMULATED[1:2],
        ),
        ablation(
            "accumulated", "The reward that the paper rejected", "appendix A", ["hpp"],
            task="rendezvous-accumulated",
        ),
        ablation("plain-rrt", "RRT paths as they are, without tuning", "figure 5", RRT),
    ]  # fmt: skip


def _ours(size: Scale, seed: int) -> list[Planned]:
    """Return what the paper does not ask: which parts of preset best matter, and how good models must be."""

    def work(planners: Sequence[str]) -> Experiment:
        return Experiment(
            worlds=SWITCHED_WORLDS[: size.worlds], planners=tuple(planners[: size.arms]),
            episodes=size.ablation, seed=seed, disturbances=LABORATORY,
        )  # fmt: skip

    return [
        Planned(
            name="switches", title="Preset best without each of its parts", figure=None, work=work(SWITCHES)
        ),
        Planned(
            name="models", title="Preset best with poorer motion models", figure=None, work=work(MODELS)
        ),
    ]  # fmt: skip


def _stacks(size: Scale, seed: int) -> list[Planned]:
    """Return what control layers add to each planner, one stack after another."""
    chosen = list(STACKS.items())[-size.stacks :]
    return [
        Planned(
            name=f"control-{name}", title=f"Control stack: {words}", figure=None,
            work=Experiment(
                worlds=STACKED_WORLDS[: size.worlds], planners=STACKED[: size.arms], control=control,
                episodes=size.ablation, seed=seed, disturbances=LABORATORY,
            ),
        )
        for name, (words, control) in chosen
    ]  # fmt: skip


def _disturbed(size: Scale, seed: int) -> list[Planned]:
    chosen = list(DISTURBANCES.items())[: size.disturbances]
    return [
        Planned(
            name=name, title=f"Disturbances: {words}", figure=None,
            work=Experiment(
                worlds=SWITCHED_WORLDS[: size.worlds], planners=DISTURBED[: size.arms],
                episodes=size.ablation, seed=seed, disturbances=text,
            ),
        )
        for name, (words, text) in chosen
    ]  # fmt: skip


def _mistaken(size: Scale, seed: int) -> list[Planned]:
    """Return other skills than the models predict, and robots that are wrong about each other."""

    def planned(name: str, title: str, fetch: Mapping[str, Any], freight: Mapping[str, Any]) -> Planned:
        entries = [
            {"id": "fetch", "robot": "fetch", **fetch},
            {"id": "freight", "robot": "freight", **freight},
        ]
        work = Experiment(
            worlds=SWITCHED_WORLDS[: size.worlds], planners=DISTURBED[: size.arms],
            episodes=size.ablation, seed=seed, disturbances=LABORATORY,
            members=effective_team({"members": entries}, Path(name)),
        )  # fmt: skip
        return Planned(name=name, title=title, figure=None, work=work)

    believes = {"believes": {id_: {"skill": TRAINED} for id_ in ("fetch", "freight")}}
    skills = [
        planned(name, f"Skills that the models do not know: {words}", *[{"skill": skill, **believes}] * 2)
        for name, (words, skill) in list(SKILLS.items())[: size.disturbances]
    ]
    return skills + [
        planned(name, f"Wrong about the other: {words}", *entries)
        for name, (words, entries) in list(MISTAKES.items())[: size.disturbances]
    ]


def _models(size: Scale, seed: int) -> list[Planned]:
    worlds = ("training", *SIMULATED)[: size.worlds]
    study = PredictorStudy(
        predictors=(*KINDS, "far-sighted"), worlds=worlds, trajectories=size.trajectories, seed=seed
    )
    return [
        Planned(name="predictors", title="Errors of the motion models", figure="appendix C.3", work=study),
        Planned(
            name="losses", title="Training losses of the motion models", figure="figure 12",
            work=Curves(source="predictors", predictors=(*KINDS, "far-sighted")),
        ),
        Planned(
            name="maddpg-training", title="Training curves of MADDPG", figure="figure 8",
            work=Curves(source="maddpg"),
        ),
    ]  # fmt: skip
