"""One episode to look at: runs it, keeps it, films it, and plots the distance over time."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import torch

from hpp_framework.errors import ConfigError
from hpp_framework.evaluation import folder
from hpp_framework.evaluation.experiment import Experiment, check_experiment, draw_episode, make_agents
from hpp_framework.evaluation.figures import plot_distance
from hpp_framework.evaluation.film import FRAMES_PER_STEP, Camera, frames
from hpp_framework.evaluation.marks import WHITE, robot_colors
from hpp_framework.evaluation.record import EpisodeRecord, Recorder
from hpp_framework.evaluation.record_file import FILE, save_record
from hpp_framework.evaluation.rollout import Episodes, median_ms, run_episodes
from hpp_framework.evaluation.video import write_video
from hpp_framework.files import read_json
from hpp_framework.registry import hub
from hpp_framework.seeding import child_seed
from hpp_framework.sim import make_simulator
from hpp_framework.sim.simulator import CONTROL_PERIOD
from hpp_framework.task import Task
from hpp_framework.team import Team, parse_team
from hpp_framework.worlds.loader import WorldFactory, resolve_world
from hpp_framework.worlds.world import World

CROSS = 0.22
"""Half the width of a goal's cross on the floor, metres."""


def showcase(
    experiment: Experiment, out: Path, *, episode: int = 0, say: Callable[[str], None] = print
) -> dict[str, Any]:
    """Run one episode of the first world and planner of an experiment and write what happened into ``out``.

    Writes ``config.json``, ``summary.json``, ``episode.npz``, ``distance.png`` and ``episode.mp4``.

    Args:
        experiment: one world, one planner.
        out: run folder.
        episode: its number in an evaluation with the same seed: same world, same start.
        say: called with lines for the user.

    Returns:
        What ``summary.json`` holds.

    Raises:
        HppError: if the experiment names something wrong (nothing is written then), or ``out`` holds an
            evaluation or cannot be written.
    """
    experiment = replace(
        experiment, worlds=experiment.worlds[:1], planners=experiment.planners[:1], episodes=1
    )
    factories = {experiment.worlds[0]: resolve_world(experiment.worlds[0])}
    configs = check_experiment(experiment, factories)
    config = folder.record(folder.RUN, {**asdict(experiment), "episode": episode}, configs)
    folder.open_run(out, config)
    shown = _simulate(experiment, factories[experiment.worlds[0]], episode)
    return _write(shown, config, out, say)


def recorded_episode(file: Path) -> int:
    """Return the number of the episode that a ``config.json`` of ``hpp run`` describes.

    Raises:
        ConfigError: if the file is damaged, or the number is none.
    """
    episode = read_json(file).get("episode", 0)  # older versions had no other
    if isinstance(episode, bool) or not isinstance(episode, int) or episode < 0:
        raise ConfigError(f"'{file}' is damaged: 'episode' must be 0 or more, got {episode!r}.")
    return episode


@dataclass(frozen=True)
class _Shown:
    """One episode with all that is written of it."""

    team: Team
    task: Task
    world: World
    episodes: Episodes
    recorder: Recorder


def _simulate(experiment: Experiment, factory: WorldFactory, episode: int) -> _Shown:
    name, planner = experiment.worlds[0], experiment.planners[0]
    team = parse_team(experiment.team, skill=experiment.skill)
    task: Task = hub().tasks.create(experiment.task, team.robots)
    world, start = draw_episode(experiment, name, factory, episode)
    seed = child_seed(experiment.seed, name, episode)
    agents = make_agents(experiment, planner, team, task, world.bounds, seed=seed)
    recorder = Recorder()
    with make_simulator(experiment.backend, team.robots) as simulator:
        episodes = run_episodes(
            simulator, [world], torch.from_numpy(start).float()[None], agents, task, noise=experiment.noise,
            seed=child_seed(experiment.seed, name, episode, "noise"), watch=recorder,
        )  # fmt: skip
    return _Shown(team, task, world, episodes, recorder)


def _write(shown: _Shown, config: dict[str, Any], out: Path, say: Callable[[str], None]) -> dict[str, Any]:
    """Write summary, record, plot and video, and return the summary."""
    planner, episodes = config["planners"][0], shown.episodes
    about = {
        "world": config["worlds"][0], "planner": planner,
        **{name: config[name] for name in ("preset", "team", "backend", "seed", "episode")},
    }  # fmt: skip
    more = {"config": config, "planner_config": config["planner_configs"].get(planner)}
    record = shown.recorder.record(
        {**about, **more}, shown.world, shown.team, episodes, period=CONTROL_PERIOD
    )
    ended = {name: value for name, value in record.about.items() if name not in more}
    summary = {**ended, "plan_ms_median": round(median_ms(episodes.plan_seconds), 3)}
    (out / folder.SUMMARY).write_text(json.dumps(summary, indent=2) + "\n")
    save_record(out / FILE, record)
    verdict = f"rendezvous after {summary['time_s']} s" if summary["success"] else "no rendezvous within 20 s"
    number = f", episode {about['episode']}" if about["episode"] else ""
    where = f"{about['world']}, {about['backend']}, seed {about['seed']}{number}"
    say(f"{planner} ({about['preset']}) in {where}: {verdict}")
    _plot(shown, f"{about['world']}: {verdict}", planner, out)
    film = frames(record, lambda size: _camera(shown, record, size, say))
    write_video(out / "episode.mp4", film, FRAMES_PER_STEP / CONTROL_PERIOD)
    say(
        f"video:   {out / 'episode.mp4'}\nplot:    {out / 'distance.png'}\nsummary: {out / folder.SUMMARY}\n"
        f"episode: {out / FILE} (hpp inspect {out})"
    )
    return summary


def _plot(shown: _Shown, title: str, planner: str, out: Path) -> None:
    times = np.arange(shown.episodes.poses.shape[1]) * CONTROL_PERIOD
    radius = shown.task.radius
    plot_distance(
        out / "distance.png", times, {planner: shown.episodes.spread().numpy()},
        2 * radius if radius is not None and len(shown.team) == 2 else None, title=title,
    )  # fmt: skip


def _camera(
    shown: _Shown, record: EpisodeRecord, size: tuple[int, int], say: Callable[[str], None]
) -> Camera | None:
    """Return a 3-D camera, or None after saying why there is none."""
    try:
        from hpp_framework.sim.sapien_camera import SceneCamera, draw_on_floor, team_view
        from hpp_framework.sim.sapien_render import rendering_problem
    except ImportError as error:
        say(f"No 3-D view, the video shows the team from above: SAPIEN cannot be imported ({error}).")
        return None
    problem = rendering_problem()
    if problem is not None:
        say(f"No 3-D view, the video shows the team from above. {problem}")
        return None
    robots, colors = shown.team.robots, robot_colors(shown.team.robots)
    view = team_view(shown.world, record.poses[0], size=size)
    camera = SceneCamera(shown.world, robots, view, size=size)

    def picture(poses: npt.NDArray[np.floating], goals: npt.NDArray[np.floating]) -> npt.NDArray[np.uint8]:
        image = camera.picture(poses)
        for goal, color in zip(goals, colors, strict=True):
            for ink, width in ((WHITE, 7), (color, 4)):
                for turn in ((1, 1), (1, -1)):
                    arm = np.multiply(turn, CROSS)
                    draw_on_floor(image, view, np.stack([goal - arm, goal + arm]), ink, width)
        return image

    return picture
