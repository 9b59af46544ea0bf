"""hpp run: one episode to look at."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from hpp_framework.cli.options import Pairs, to_experiment
from hpp_framework.cli.progress import cell_bars
from hpp_framework.plugins.builtin import DEFAULT_CONTROL, DEFAULT_DISTURBANCES, DEFAULT_ESTIMATOR
from hpp_framework.utils.run_folder import RunFolder


@dataclass(frozen=True, kw_only=True)
class Run:
    """Run one episode and film it.

    Writes episode.mp4 (a 3-D view, and beside it what each robot sees, weighs and imagines), episode.npz (the
    episode, for 'hpp inspect'), distance.png, summary.json and config.json into --out. Without a Vulkan
    driver the video shows the team from above instead of in 3-D.
    """

    world: Annotated[str, tyro.conf.arg(aliases=("--worlds",))] = "wall"
    """Registered world or YAML file."""
    team: str = "fetch,freight"
    """Robots, separated by commas, 'id=robot' names one; or a team file (.yaml)."""
    planner: str = "hpp"
    """Registered planner of every robot; 'hpp:hysteresis=0.05' gives it a setting."""
    control: str = DEFAULT_CONTROL
    """Control layers of every robot from the skill outwards, e.g. 'terminal-approach:near=1.2,safety-filter',
    or 'none'; 'hpp list layers' shows them."""
    preset: str = "best"
    """Preset of the planner: paper or best."""
    backend: Literal["batch", "sapien"] = "sapien"
    """Simulator."""
    seed: int = 0
    """Seed of world, start and agents."""
    episode: int = 0
    """Number of the episode in an 'hpp evaluate' with the same seed; it runs as it ran there."""
    out: Path = Path("out/run")
    """Folder to write to."""
    config: Path | None = None
    """A config.json of an earlier run to repeat; other options than --out must be left out then."""
    task: str = "rendezvous"
    """Registered task, with settings or without ('formation:shape=ring'), or a YAML file of terms."""
    skill: str = "p2p"
    """Registered skill of every robot."""
    weights: str = ""
    """Extra folders searched for weights of predictors and policies, separated by commas."""
    set: Pairs = ()
    """Settings of every planner that has parameters, e.g. hysteresis=0.05 plan_every=10."""
    people: int = 0
    """Pedestrians who walk between random places, beside those that a world has of its own."""
    disturbances: str = DEFAULT_DISTURBANCES
    """Of sensing and acting: ideal, paper, field or harsh, with settings or without, e.g.
    field:command_delay=0.4:nan_beams=0.01."""
    estimator: str = DEFAULT_ESTIMATOR
    """Registered estimator of all agents, with settings or without, e.g. tracker:noise=2."""

    def run(self) -> None:
        """Run, film, and say where things are."""
        from hpp_framework.evaluation.showcase import recorded_episode, showcase

        experiment = to_experiment(self, "run", worlds=(self.world,), planners=(self.planner,), episodes=1)
        episode = self.episode if self.config is None else recorded_episode(self.config)
        with RunFolder(self.out).locked(), cell_bars(unit=None) as report:
            showcase(experiment, self.out, episode=episode, report=report)
