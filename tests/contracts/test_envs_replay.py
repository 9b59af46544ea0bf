"""Whole episodes replay bit for bit, in one process and in another; run as a script it prints the digests."""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hpp_framework.core.disturbances import Disturbances
from hpp_framework.core.team import Team
from hpp_framework.envs import (
    EpisodeConfig,
    HierarchyConfig,
    PointToPoint,
    PointToPointEnv,
    PointToPointVectorEnv,
    RendezvousEnv,
    TeamEnv,
)

NOISE = Disturbances(position_std=0.02, heading_std=0.02, scan_std=None, lost_beams=0.01)
NAMED = "field:scan_std=null"

SHORT = PointToPoint(max_steps=60)

Step = tuple[Any, ...]

MAKERS: dict[str, Callable[[Team], Any]] = {
    "team": lambda team: TeamEnv(team, config=EpisodeConfig(disturbances=NAMED)),
    "point-to-point": lambda team: PointToPointEnv(pool_size=3, disturbances=NOISE, problem=SHORT),
    "rendezvous": lambda team: RendezvousEnv(
        team, teammates="centralized-rp", config=HierarchyConfig(episode=EpisodeConfig(disturbances=NAMED))
    ),
    "shipped skills": lambda team: RendezvousEnv(world="wall"),
    "vector": lambda team: PointToPointVectorEnv(
        6, robots_per_world=2, pool_size=3, disturbances=NOISE, problem=SHORT
    ),
}


def steps_of(env: Any, seed: int) -> Iterator[Step]:
    """Yield everything an environment returns in an episode that is seeded and one that goes on from it."""
    rng = np.random.default_rng(seed)
    if isinstance(env, PointToPointVectorEnv):
        yield env.reset(seed=seed)
        for _ in range(env.problem.max_steps + 10):
            yield env.step(rng.uniform((0, -1), (1, 1), (env.num_envs, 2)).astype(np.float32))
        return
    for start in (seed, None):
        yield env.reset(seed=start)
        over = False
        while not over:
            if isinstance(env, TeamEnv):
                yield env.step({agent: rng.uniform((0, -1), (1, 1)) for agent in env.agents})
                over = not env.agents
            else:
                step = env.step(rng.uniform(-1, 1, 2))
                over = step[2] or step[3]
                yield step


def feed(digest: Any, value: Any) -> None:
    """Add a nested value to a digest: every bit of every array, in a fixed order."""
    if isinstance(value, dict):
        for key in sorted(value):
            digest.update(str(key).encode())
            feed(digest, value[key])
    elif isinstance(value, tuple | list) or (isinstance(value, np.ndarray) and value.dtype == object):
        for item in value:
            feed(digest, item)
    elif isinstance(value, np.ndarray):
        digest.update(f"{value.dtype}{value.shape}".encode())
        digest.update(np.ascontiguousarray(value).tobytes())
    else:
        digest.update(repr(value).encode())


def digest_of(env: Any, seed: int) -> str:
    """Return a digest of everything an environment returns over whole episodes."""
    digest = hashlib.sha256()
    for step in steps_of(env, seed):
        feed(digest, step)
    return digest.hexdigest()


def all_digests(team: Team) -> dict[str, str]:
    """Return a digest of each environment, freshly made."""
    return {kind: digest_of(make(team), 7) for kind, make in MAKERS.items()}


@pytest.fixture(scope="module")
def fresh(straight_team) -> dict[str, str]:
    return all_digests(straight_team)


@pytest.mark.parametrize("kind", MAKERS)
def test_episodes_replay_in_a_used_environment(kind, straight_team, fresh):
    env = MAKERS[kind](straight_team)
    assert digest_of(env, 8) != fresh[kind]
    assert digest_of(env, 7) == fresh[kind]


def test_episodes_replay_in_another_process(fresh):
    done = subprocess.run([sys.executable, __file__], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout.splitlines()[-1]) == fresh


@pytest.mark.sapien
def test_episodes_replay_on_sapien(straight_team):
    pytest.importorskip("sapien")
    config = EpisodeConfig(disturbances=NAMED, backend="sapien", max_steps=12)
    used, unused = (TeamEnv(straight_team, world="wall", config=config) for _ in range(2))
    assert digest_of(used, 8) != digest_of(used, 7)
    assert digest_of(used, 7) == digest_of(unused, 7)


@pytest.mark.parametrize("kind", MAKERS)
def test_returned_arrays_stay_as_they_were(kind, straight_team):
    """Nothing that was handed out changes, or shares memory with what is handed out, later."""
    kept, copies = [], []
    for number, step in enumerate(steps_of(MAKERS[kind](straight_team), 3)):
        arrays = list(_arrays(step))
        for old in kept[-40:]:
            for new in arrays:
                assert not np.shares_memory(old, new)
        kept += arrays
        copies += [array.copy() for array in arrays]
        if number == 25:
            break
    for array, copy in zip(kept, copies, strict=True):
        np.testing.assert_array_equal(array, copy)


def _arrays(value: Any) -> Iterator[np.ndarray]:
    if isinstance(value, dict):
        value = tuple(value.values())
    if isinstance(value, tuple | list) or (isinstance(value, np.ndarray) and value.dtype == object):
        for item in value:
            yield from _arrays(item)
    elif isinstance(value, np.ndarray):
        yield value


if __name__ == "__main__":
    import torch
    from conftest import make_straight_team  # beside this file

    assert Path(sys.path[0]) == Path(__file__).parent
    torch.set_num_threads(1)
    print(json.dumps(all_digests(make_straight_team())))
