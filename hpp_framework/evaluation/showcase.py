"""One episode to look at: runs it, films it from above and in 3-D, and plots the distance over time."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import torch

from hpp_framework.agent import Agent
from hpp_framework.evaluation import folder
from hpp_framework.evaluation.experiment import Experiment, check_experiment, draw_episode
from hpp_framework.evaluation.figures import plot_distance
from hpp_framework.evaluation.rollout import Episodes, build_agents, median_ms, run_episodes
from hpp_framework.evaluation.topdown import Rollouts, TopDown, close_view
from hpp_framework.evaluation.video import side_by_side, write_video
from hpp_framework.planner import Belief
from hpp_framework.registry import hub
from hpp_framework.seeding import child_seed
from hpp_framework.sim import make_simulator
from hpp_framework.sim.simulator import CONTROL_PERIOD
from hpp_framework.task import Task
from hpp_framework.team import Team, parse_team
from hpp_framework.types import Observation, State
from hpp_framework.worlds.loader import WorldFactory, resolve_world
from hpp_framework.worlds.world import World

if TYPE_CHECKING:
    from hpp_framework.sim.sapien_camera import SceneCamera

FRAMES_PER_STEP = 2
SHOWN_ROLLOUTS = 24
LAST_FRAMES = 15
SIZE_3D = (960, 720)
SIZE_TOP = (720, 720)

Frame = npt.NDArray[np.uint8]


@dataclass(frozen=True)
class Moment:
    """What is drawn of one control step."""

    poses: npt.NDArray[np.float64]
    scans: list[npt.NDArray[np.float32]]
    goals: npt.NDArray[np.float32]
    beliefs: tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]
    rollouts: list[Rollouts | None]


def showcase(experiment: Experiment, out: Path, *, say: Callable[[str], None] = print) -> dict[str, Any]:
    """Run episode 0 of the first world and planner of an experiment and write what happened into ``out``.

    Writes ``config.json``, ``summary.json``, ``distance.png`` and ``episode.mp4``.

    Args:
        experiment: one world, one planner.
        out: run folder.
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
    folder.open_run(out, folder.record(folder.RUN, asdict(experiment), configs))
    filmed = _simulate(experiment, factories[experiment.worlds[0]])
    return _write(experiment, filmed, out, say)


@dataclass(frozen=True)
class _Filmed:
    """One episode with everything that is drawn of it."""

    team: Team
    task: Task
    world: World
    episodes: Episodes
    moments: list[Moment]


def _simulate(experiment: Experiment, factory: WorldFactory) -> _Filmed:
    name, planner = experiment.worlds[0], experiment.planners[0]
    team = parse_team(experiment.team, skill=experiment.skill)
    task: Task = hub().tasks.create(experiment.task, team.robots)
    world, start = draw_episode(experiment, name, factory, 0)
    agents = build_agents(
        team, planner, task, preset=experiment.preset, bounds=world.bounds,
        seed=child_seed(experiment.seed, name, 0), weights=tuple(map(Path, experiment.weights)),
    )  # fmt: skip
    moments: list[Moment] = []

    def watch(step: int, state: State, team_agents: Sequence[Agent], seen: Sequence[Observation]) -> None:
        del step
        moments.append(_moment(state, team_agents, seen))

    with make_simulator(experiment.backend, team.robots) as simulator:
        episodes = run_episodes(
            simulator, [world], torch.from_numpy(start).float()[None], agents, task, noise=experiment.noise,
            seed=child_seed(experiment.seed, name, 0, "noise"), watch=watch,
        )  # fmt: skip
    return _Filmed(team, task, world, episodes, moments)


def _write(experiment: Experiment, filmed: _Filmed, out: Path, say: Callable[[str], None]) -> dict[str, Any]:
    """Write summary, plot and video, and return the summary."""
    name, planner, episodes = experiment.worlds[0], experiment.planners[0], filmed.episodes
    summary = _summary(experiment, episodes)
    (out / folder.SUMMARY).write_text(json.dumps(summary, indent=2) + "\n")
    verdict = f"rendezvous after {summary['time_s']} s" if summary["success"] else "no rendezvous within 20 s"
    say(f"{planner} ({experiment.preset}) in {name}, {experiment.backend}, seed {experiment.seed}: {verdict}")
    times = np.arange(episodes.poses.shape[1]) * CONTROL_PERIOD
    radius = filmed.task.radius
    plot_distance(
        out / "distance.png", times, {planner: episodes.spread().numpy()},
        2 * radius if radius is not None and len(filmed.team) == 2 else None, title=f"{name}: {verdict}",
    )  # fmt: skip
    title = f"{planner} ({experiment.preset}): {verdict}"
    write_video(out / "episode.mp4", _frames(filmed, title, say), 1 / CONTROL_PERIOD * FRAMES_PER_STEP)
    say(f"video:   {out / 'episode.mp4'}\nplot:    {out / 'distance.png'}\nsummary: {out / folder.SUMMARY}")
    return summary


def _summary(experiment: Experiment, episodes: Episodes) -> dict[str, Any]:
    done, contact = int(episodes.done_step[0]), int(episodes.contact_step[0])
    return {
        "world": experiment.worlds[0],
        "planner": experiment.planners[0],
        "preset": experiment.preset,
        "team": experiment.team,
        "backend": experiment.backend,
        "seed": experiment.seed,
        "success": done >= 0,
        "time_s": round(done * CONTROL_PERIOD, 2) if done >= 0 else None,
        "first_contact_s": round(contact * CONTROL_PERIOD, 2) if contact >= 0 else None,
        "collided": bool(episodes.collided[0]),
        "final_distance_m": round(float(episodes.spread()[0, -1]), 3),
        "plan_ms_median": round(median_ms(episodes.plan_seconds), 3),
    }


def _moment(state: State, agents: Sequence[Agent], observations: Sequence[Observation]) -> Moment:
    beliefs = [agent.belief for agent in agents if agent.belief is not None]
    return Moment(
        poses=state.poses[0].double().cpu().numpy(),
        scans=[o.scan[0].cpu().numpy() for o in observations],
        goals=np.stack([agent.goal[0].cpu().numpy() for agent in agents]),
        beliefs=(
            np.stack([b.mean[0].cpu().numpy() for b in beliefs]),
            np.stack([b.std[0].cpu().numpy() for b in beliefs]),
        ),
        rollouts=[_best_rollouts(b) for b in beliefs],
    )


def _best_rollouts(belief: Belief) -> Rollouts | None:
    """Return the best imagined trajectories of one agent, at most ``SHOWN_ROLLOUTS`` of them."""
    if belief.imagination is None:
        return None
    scores = belief.imagination.scores[0].cpu()
    kept = scores.topk(min(SHOWN_ROLLOUTS, len(scores))).indices
    paths = belief.imagination.trajectories.poses[0, kept, :, :, :2].cpu().numpy()
    return Rollouts(paths, scores[kept].numpy())


def _frames(filmed: _Filmed, title: str, say: Callable[[str], None]) -> Iterator[Frame]:
    world, team, moments = filmed.world, filmed.team, filmed.moments
    every_pose = np.stack([m.poses for m in moments])
    view = TopDown(world, team.robots, size=SIZE_TOP, view=close_view(world, every_pose, around=2.5))
    camera = _camera(world, team, moments[0].poses, say)
    trail: list[npt.NDArray[np.float64]] = []
    frame: Frame | None = None
    for index, (clock, moment) in enumerate(_in_between(moments)):
        trail.append(moment.poses)
        frame = view.frame(
            moment.poses, scans=moment.scans, goals=moment.goals, beliefs=moment.beliefs,
            rollouts=moment.rollouts, trails=np.stack(trail), clock=clock,
            title=title if camera is None or index < 1 else None,
        )  # fmt: skip
        if camera is not None:
            frame = side_by_side(camera.picture(moment.poses), frame)
        yield frame
    if frame is not None:
        yield from [frame] * LAST_FRAMES


def _camera(
    world: World, team: Team, start: npt.NDArray[np.float64], say: Callable[[str], None]
) -> SceneCamera | None:
    """Return a 3-D camera, or None after saying why there is none."""
    try:
        from hpp_framework.sim.sapien_camera import SceneCamera, team_view
        from hpp_framework.sim.sapien_render import rendering_problem
    except ImportError as error:
        say(f"No 3-D view, the video shows the top-down view only: SAPIEN cannot be imported ({error}).")
        return None
    problem = rendering_problem()
    if problem is not None:
        say(f"No 3-D view, the video shows the top-down view only. {problem}")
        return None
    return SceneCamera(world, team.robots, team_view(world, start, size=SIZE_3D), size=SIZE_3D)


def _in_between(moments: Sequence[Moment]) -> Iterator[tuple[float, Moment]]:
    """Yield moments with their times, poses interpolated between control steps for smooth motion."""
    for index, moment in enumerate(moments):
        following = moments[min(index + 1, len(moments) - 1)]
        for part in range(FRAMES_PER_STEP if index + 1 < len(moments) else 1):
            share = part / FRAMES_PER_STEP
            change = following.poses - moment.poses
            change[:, 2] = (change[:, 2] + np.pi) % (2 * np.pi) - np.pi
            yield (index + share) * CONTROL_PERIOD, replace(moment, poses=moment.poses + share * change)
