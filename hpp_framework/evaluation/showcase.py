"""One episode to look at: runs it, keeps it, films it, and plots the distance over time."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from hpp_framework.config.task_file import task_name
from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.evaluation import folder
from hpp_framework.evaluation.experiment import Experiment, check_experiment
from hpp_framework.evaluation.figures import plot_distance
from hpp_framework.evaluation.replay import Replay, describe, replay
from hpp_framework.evaluation.rollout import median_ms
from hpp_framework.utils.errors import ConfigError
from hpp_framework.utils.progress import Progress
from hpp_framework.utils.run_folder import read_json, write_json
from hpp_framework.viz.film import FRAMES_PER_STEP, Camera, Frame, frame_count, frames
from hpp_framework.viz.marks import WHITE, robot_colors
from hpp_framework.viz.record import EpisodeRecord
from hpp_framework.viz.record_file import FILE, save_record
from hpp_framework.viz.video import write_video
from hpp_framework.worlds.loader import resolve_world

RUNNING = "running the episode"
"""What is said to be under way before the film."""
CROSS = 0.22
"""Half the width of a goal's cross on the floor, metres."""


Places = npt.NDArray[np.floating]


def _nobody(what: str, done: int, total: int) -> None:
    del what, done, total


def showcase(
    experiment: Experiment,
    out: Path,
    *,
    episode: int = 0,
    say: Callable[[str], None] = print,
    report: Progress = _nobody,
) -> dict[str, Any]:
    """Run one episode of the first world and planner of an experiment and write what happened into ``out``.

    Writes ``config.json``, ``summary.json``, ``episode.npz``, ``distance.png`` and ``episode.mp4``.

    Args:
        experiment: one world, one planner.
        out: run folder.
        episode: its number in an evaluation with the same seed, which runs it in the same way.
        say: called with lines for the user.
        report: is told how far the episode and its film are.

    Returns:
        What ``summary.json`` holds.

    Raises:
        HppError: if the experiment names something wrong (nothing is written then), or ``out`` holds an
            evaluation or cannot be written.
    """
    check_episode(episode)
    experiment = replace(
        experiment, worlds=experiment.worlds[:1], planners=experiment.planners[:1], episodes=1
    )
    factories = {experiment.worlds[0]: resolve_world(experiment.worlds[0])}
    configs = check_experiment(experiment, factories)
    config = folder.record(folder.RUN, {**asdict(experiment), "episode": episode}, configs)
    folder.open_run(out, config)
    factory = factories[experiment.worlds[0]]
    report(RUNNING, 0, 1)
    (shown,) = replay(experiment, factory, [episode])
    report(RUNNING, 1, 1)
    return _write(shown, config, out, say, report)


def recorded_episode(file: Path) -> int:
    """Return which episode a ``config.json`` of ``hpp run`` describes.

    Raises:
        ConfigError: if the file is damaged, or the number is none.
    """
    episode = read_json(file).get("episode", 0)
    if type(episode) is not int:
        raise ConfigError(f"'{file}' is damaged: episode must be a whole number, got {episode}.")
    check_episode(episode)
    return episode


def check_episode(number: int) -> None:
    """Check the number of an episode.

    Raises:
        ConfigError: if it is negative.
    """
    if number < 0:
        raise ConfigError(f"episode must be 0 or more, got {number}.")


def _write(
    shown: Replay, config: dict[str, Any], out: Path, say: Callable[[str], None], report: Progress
) -> dict[str, Any]:
    """Write summary, record, plot and video, and return the summary."""
    about, episodes = describe(config), shown.episodes
    planner = about["planner"]
    record = shown.record(config["episode"], about)
    ended = {name: value for name, value in record.about.items() if name not in ("config", "planner_config")}
    summary = {**ended, "plan_ms_median": round(median_ms(episodes.plan_seconds), 3)}
    write_json(out / folder.SUMMARY, summary)
    save_record(out / FILE, record)
    task = task_name(config["task"])
    verdict = f"{task} after {summary['time_s']} s" if summary["success"] else f"no {task} within 20 s"
    number = f", episode {about['episode']}" if about["episode"] else ""
    where = f"{about['world']}, {about['backend']}, seed {about['seed']}{number}"
    say(f"{planner} ({about['preset']}) in {where}: {verdict}")
    _plot(shown, config["episode"], f"{about['world']}: {verdict}", planner, out)
    film = frames(record, lambda size: _camera(shown, record, size, say))
    write_video(
        out / "episode.mp4", _watched(film, frame_count(record), report), FRAMES_PER_STEP / CONTROL_PERIOD
    )
    say(
        f"video:   {out / 'episode.mp4'}\nplot:    {out / 'distance.png'}\nsummary: {out / folder.SUMMARY}\n"
        f"episode: {out / FILE} (hpp inspect {out})"
    )
    return summary


def _watched(film: Iterable[Frame], total: int, report: Progress) -> Iterator[Frame]:
    for done, frame in enumerate(film, 1):
        yield frame
        report("filming it", done, total)


def _plot(shown: Replay, number: int, title: str, planner: str, out: Path) -> None:
    index = shown.recorders[number].index
    last = int(shown.episodes.last_step()[index])
    times = np.arange(last + 1) * CONTROL_PERIOD
    radius = shown.task.radius
    plot_distance(
        out / "distance.png", times, {planner: shown.episodes.spread()[index, : last + 1].numpy()},
        2 * radius if radius is not None and len(shown.team) == 2 else None, title=title,
    )  # fmt: skip


def _camera(
    shown: Replay, record: EpisodeRecord, size: tuple[int, int], say: Callable[[str], None]
) -> Camera | None:
    """Return a 3-D camera, or None after saying why there is none."""
    try:
        from hpp_framework.sim.sapien.camera import SceneCamera, draw_on_floor, team_view
        from hpp_framework.sim.sapien.render import rendering_problem
    except ImportError as error:
        say(f"No 3-D view, the video shows the team from above: SAPIEN cannot be imported ({error}).")
        return None
    problem = rendering_problem()
    if problem is not None:
        say(f"No 3-D view, the video shows the team from above. {problem}")
        return None
    robots, colors = shown.team.robots, robot_colors(shown.team.robots)
    world = shown.worlds[record.about["episode"]]
    view = team_view(world, record.poses[0], paths=record.poses, size=size)
    camera = SceneCamera(world, robots, view, size=size)

    def picture(poses: Places, goals: Places, people: Places | None, time: float) -> npt.NDArray[np.uint8]:
        image = camera.picture(poses, people=None if people is None else people[:, :3], time=time)
        for goal, color in zip(goals, colors, strict=True):
            for ink, width in ((WHITE, 7), (color, 4)):
                for turn in ((1, 1), (1, -1)):
                    arm = np.multiply(turn, CROSS)
                    draw_on_floor(image, view, np.stack([goal - arm, goal + arm]), ink, width)
        return image

    return picture
