"""hpp evaluate: compare planners over worlds, with intervals; or judge skills."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Literal

import tyro
from rich.console import Console

from hpp_framework.cli.evaluate_predictor import EvaluatePredictor
from hpp_framework.cli.evaluate_skill import EvaluateSkill
from hpp_framework.cli.evaluate_tables import (
    aggregate_table,
    blame_table,
    comparison_table,
    summary_table,
)
from hpp_framework.cli.options import Pairs, names, to_experiment
from hpp_framework.cli.progress import cell_bars
from hpp_framework.plugins.builtin import DEFAULT_CONTROL, DEFAULT_DISTURBANCES, DEFAULT_ESTIMATOR
from hpp_framework.utils.errors import ConfigError
from hpp_framework.utils.run_folder import RunFolder

TABLE_WIDTH = 120


@dataclass(frozen=True, kw_only=True)
class Evaluate:
    """Run many episodes of each planner in each world and report success with 95 % intervals.

    Writes episodes.csv (one row per episode), summary.json, marl_eval.json (the same episodes for marl-eval)
    and config.json into --out. Interrupted runs resume: repeat the same command.
    """

    worlds: str = "simple,wall,navigation"
    """Registered worlds or YAML files, separated by commas."""
    planners: str = "hpp,geodesic-midpoint,centralized-mp,centralized-oa,centralized-rp"
    """Registered planners, separated by commas; 'hpp:hysteresis=0.05:forgetting_factor=0' and
    'hpp:preset=paper' have settings of their own."""
    team: str = "fetch,freight"
    """Robots, separated by commas, 'id=robot' names one; or a team file (.yaml)."""
    control: str = DEFAULT_CONTROL
    """Control layers of every robot from the skill outwards, the same for all planners, e.g.
    'terminal-approach:near=1.2,safety-filter', or 'none'; 'hpp list layers' shows them."""
    preset: str = "best"
    """Preset of the planners: paper or best."""
    backend: Literal["batch", "sapien"] = "batch"
    """Simulator."""
    episodes: int = 100
    """Episodes per world and planner."""
    seed: int = 0
    """Seed of worlds, starts and agents."""
    out: Path = Path("out/evaluate")
    """Folder to write to."""
    config: Path | None = None
    """A config.json of an earlier evaluation to repeat; other options than --out must be left out then."""
    task: str = "rendezvous"
    """Registered task, with settings or without ('formation:shape=ring'), or a YAML file of terms."""
    skill: str = "p2p"
    """Registered skill of every robot."""
    weights: str = ""
    """Extra folders searched for weights of predictors and policies, separated by commas."""
    set: Pairs = ()
    """Settings of every planner that has parameters, e.g. hysteresis=0.05 plan_every=10."""
    save: str = ""
    """Episodes of each world and planner to keep for 'hpp inspect' (run again at the end): numbers, or
    failures, touched, best, median, worst, all; separated by commas."""
    people: int = 0
    """Pedestrians who walk between random places, beside those that a world has of its own."""
    disturbances: str = DEFAULT_DISTURBANCES
    """Of sensing and acting: ideal, paper, field or harsh, with settings or without, e.g.
    field:command_delay=0.4:nan_beams=0.01."""
    estimator: str = DEFAULT_ESTIMATOR
    """Registered estimator of all agents, with settings or without, e.g. tracker:noise=2."""
    judge: tyro.conf.OmitSubcommandPrefixes[
        Annotated[EvaluateSkill, tyro.conf.subcommand("skill")]
        | Annotated[EvaluatePredictor, tyro.conf.subcommand("predictor")]
        | Annotated[None, tyro.conf.subcommand("planners", description="What is described above.")]
    ] = None
    """What to judge; options of skills and predictors come after that word."""

    def run(self) -> None:
        """Run the experiment and print its summary."""
        if self.judge is not None:
            self._check_nothing_else()
            self.judge.run()
            return
        from hpp_framework.evaluation.experiment import run_experiment
        from hpp_framework.evaluation.saving import SAVED, check_choice, save_episodes
        from hpp_framework.evaluation.summary import ALL

        experiment = to_experiment(
            self,
            "evaluate",
            worlds=names(self.worlds, "--worlds"),
            planners=names(self.planners, "--planners"),
            episodes=self.episodes,
        )
        if self.save:
            check_choice(self.save, experiment.episodes)
        with RunFolder(self.out).locked(), cell_bars() as report:
            summary = run_experiment(experiment, self.out, progress=report)
            saved = save_episodes(experiment, self.out, self.save, progress=report) if self.save else []
        console = Console(width=TABLE_WIDTH)
        console.print(summary_table(summary["cells"]))
        if together := [row for row in summary["aggregates"] if row["world"] == ALL]:
            console.print(aggregate_table(together))
        if summary["comparisons"]:
            console.print(comparison_table(summary["comparisons"]))
        if summary["blame"]:
            console.print("\nsuccess lost to", blame_table(summary["blame"]), sep="\n")
        print(f"episodes: {self.out / 'episodes.csv'}\nsummary:  {self.out / 'summary.json'}")
        if self.save:
            print(
                f"saved:    {len(saved)} in {self.out / SAVED}"
                + (f" (hpp inspect {saved[0]})" if saved else "")
            )

    def _check_nothing_else(self) -> None:
        default = Evaluate()
        given = [
            f"--{each.name}"
            for each in fields(self)
            if each.name != "judge" and getattr(self, each.name) != getattr(default, each.name)
        ]
        if given:
            raise ConfigError(
                "options of `hpp evaluate skill` and `hpp evaluate predictor` come after that word: move "
                f"{', '.join(given)}."
            )
