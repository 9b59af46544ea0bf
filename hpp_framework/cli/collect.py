"""``hpp collect``: gather motion data of a team."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from rich.progress import Progress

from hpp_framework.cli.options import check_positive
from hpp_framework.utils.run_folder import RunFolder


@dataclass(frozen=True, kw_only=True)
class Collect:
    """Let a team drive to common random goals in random rooms and record it, to train predictors from.

    Resumes or extends a folder that holds the same collection.
    """

    team: str = "fetch,freight"
    """Robots, separated by commas; or a team file (.yaml), of which robots and skills count."""
    trajectories: int = 10_000
    """How many (50,000 in the paper)."""
    steps: int = 100
    """Control steps of 0.2 s a trajectory (100 in the paper)."""
    world: str = "training"
    """Registered world that rooms are drawn from, or a world file (.yaml)."""
    skill: str = "p2p"
    """Registered skill of every robot."""
    seed: int = 0
    """Seed of rooms, starts and goals."""
    workers: int | None = None
    """Processes, one thread each (default: as many as there are cores); the data do not depend on it."""
    out: Path = Path("data/fetch,freight")
    """Folder to write to."""

    def run(self) -> None:
        """Collect with a progress bar."""
        import torch

        from hpp_framework.config.team_file import resolve_team
        from hpp_framework.prediction.collect import Collection, collect
        from hpp_framework.utils.executor import available_cores
        from hpp_framework.worlds.loader import resolve_world

        workers = available_cores() if self.workers is None else self.workers
        check_positive(workers=workers, steps=self.steps)

        resolve_world(self.world)
        team = resolve_team(self.team, skill=self.skill)
        config = Collection(
            trajectories=self.trajectories, steps=self.steps, world=self.world, seed=self.seed
        )
        torch.set_num_threads(1)
        total = config.chunks * config.chunk
        told = 0
        with RunFolder(self.out).locked(), Progress() as progress:
            bar = progress.add_task("trajectories", total=total)
            for done in collect(team, config, self.out, workers=workers):
                progress.update(bar, completed=done)
                # a log file shows no bar
                if not progress.console.is_terminal and done - told >= total / 10:
                    progress.console.print(f"{done} of {total} trajectories", highlight=False)
                    told = done
        print(f"data: {self.out}")
