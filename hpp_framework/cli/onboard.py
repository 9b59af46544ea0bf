"""``hpp onboard``: everything that teams must learn of a new robot or a new skill."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from hpp_framework.cli.options import check_positive, names
from hpp_framework.cli.progress import cell_bars
from hpp_framework.utils.run_folder import RunFolder


@dataclass(frozen=True, kw_only=True)
class Onboard:
    """Check a robot or a skill, train what it lacks and what teams must know of it, and judge all of it.

    A robot gets weights of its skill; then it drives with every teammate and with another of its kind, and
    motion models of all these are trained. For a new skill, all robots that are named drive with it. An
    interrupted onboarding resumes.
    """

    name: Annotated[str, tyro.conf.Positional]
    """Registered robot or skill, e.g. my-pkg/rover."""
    teammates: Annotated[str, tyro.conf.arg(name="with")] = "fetch,freight"
    """Registered robots, separated by commas: teammates of a robot, or those that a skill must drive."""
    skill: str = "p2p"
    """Registered skill of every robot, if the newcomer is a robot."""
    predictor: str = "far-sighted"
    """Registered predictor to train; far-sighted is what planner hpp uses."""
    scale: str = "standard"
    """standard, or smoke: every stage within minutes, to see that all works; it teaches next to nothing."""
    set: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME=VALUE ...")] = ()
    """Numbers of the scale, e.g. skill_steps=3000000 trajectories=20000 predictor_steps=20000."""
    init: str = "auto"
    """Robot whose weights a skill training starts from; auto: one with as many beams; none: from nothing."""
    seed: int = 0
    """Seed of everything."""
    workers: int | None = None
    """Processes that collect and train, one thread each (default: as many as there are cores)."""
    out: Path | None = None
    """Folder to write to (default: runs/NAME)."""

    def run(self) -> None:
        """Show the plan, do it, and say what to do with what came out."""
        from hpp_framework.config.settings import altered, parse_settings
        from hpp_framework.onboarding.config import make_onboarding
        from hpp_framework.onboarding.run import onboard
        from hpp_framework.onboarding.scale import find_scale
        from hpp_framework.onboarding.stages import WEIGHTS
        from hpp_framework.utils.executor import available_cores

        workers = available_cores() if self.workers is None else self.workers
        check_positive(workers=workers)
        scale = altered(find_scale(self.scale), parse_settings(self.set, "--set"), f"scale '{self.scale}'")
        others: dict[str, Any] = {"predictor": self.predictor, "seed": self.seed, "init": self.init}
        teammates = names(self.teammates, "--with") if self.teammates else ()
        onboarding = make_onboarding(self.name, teammates, self.skill, scale, **others)
        out = self.out or Path("runs") / self.name.replace("/", ".")
        with RunFolder(out).locked():
            card = onboard(onboarding, out, workers=workers, bars=cell_bars, say=print)
        print(f"\n{card.read_text(encoding='utf-8')}")
        print(f"card:    {card}\nweights: {out / WEIGHTS}")
        print(_what_next(out / WEIGHTS, _own_folder(self.name)))


def _own_folder(newcomer: str) -> Path | None:
    """Return the one folder of weights that the newcomer's package registers; None if there is none such."""
    from hpp_framework.plugins.registry import hub

    registry = hub().robots if newcomer in hub().robots else hub().skills
    package = registry.entry(newcomer).distribution
    own = [entry for entry in hub().checkpoints if package and entry.distribution == package]
    return own[0].factory()() if len(own) == 1 else None


def _what_next(weights: Path, own: Path | None) -> str:
    here = Path.cwd()
    if own is None:
        into, target = "a folder that your package registers (hub.checkpoints)", "MY_PKG/weights"
    else:
        into = "the folder that your package registers"
        target = shlex.quote(str(own.relative_to(here) if own.is_relative_to(here) else own))
    return (
        f"To use them, copy them into {into}:\n"
        f"  cp -r {shlex.quote(str(weights))}/. {target}/\n"
        f"or name them for a while:\n"
        f"  export HPP_WEIGHTS={shlex.quote(str(weights.absolute()))}"
    )
