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

from hpp_framework.envs import (
    EpisodeConfig,
    HierarchyConfig,
    PointToPointEnv,
    PointToPointVectorEnv,
    RendezvousEnv,
    TeamEnv,
)
from hpp_framework.sensing import NoiseModel
from hpp_framework.team import Team

NOISE = NoiseModel(position_std=0.02, heading_std=0.02, scan_std=None, dropout=0.01)

Step = tuple[Any, ...]


def team_steps(team: Team, seed: int) -> Iterator[Step]:
    env = TeamEnv(team, config=EpisodeConfig(noise=NOISE))
    rng = np.random.default_rng(seed)
    for episode in range(2):
        yield env.reset(seed=seed if episode == 0 else None)
        while env.agents:
            yield env.step({agent: rng.uniform((0, -1), (1, 1)) for agent in env.agents})


def single_steps(team: Team, seed: int) -> Iterator[Step]:
    env = PointToPointEnv(pool_size=3, noise=NOISE)
    yield from gym_steps(env, seed)


def rendezvous_steps(team: Team, seed: int) -> Iterator[Step]:
    config = HierarchyConfig(episode=EpisodeConfig(noise=NOISE))
    env = RendezvousEnv(team, teammates="centralized-rp", config=config)
    yield from gym_steps(env, seed)


def gym_steps(env: Any, seed: int) -> Iterator[Step]:
    rng = np.random.default_rng(seed)
    for episode in range(2):
        yield env.reset(seed=seed if episode == 0 else None)
        over = False
        while not over:
            step = env.step(rng.uniform(-1, 1, 2))
            over = step[2] or step[3]
            yield step


def vector_steps(team: Team, seed: int) -> Iterator[Step]:
    env = PointToPointVectorEnv(6, robots_per_world=2, pool_size=3, noise=NOISE)
    rng = np.random.default_rng(seed)
    yield env.reset(seed=seed)
    for _ in range(160):
        yield env.step(rng.uniform((0, -1), (1, 1), (6, 2)).astype(np.float32))


KINDS: dict[str, Callable[[Team, int], Iterator[Step]]] = {
    "team": team_steps,
    "point-to-point": single_steps,
    "rendezvous": rendezvous_steps,
    "vector": vector_steps,
}


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


def digest_of(kind: str, team: Team, seed: int) -> str:
    """Return a digest of everything an environment returns over whole episodes."""
    digest = hashlib.sha256()
    for step in KINDS[kind](team, seed):
        feed(digest, step)
    return digest.hexdigest()


@pytest.fixture(scope="module")
def first(straight_team) -> dict[str, str]:
    return {kind: digest_of(kind, straight_team, 7) for kind in KINDS}


@pytest.mark.parametrize("kind", KINDS)
def test_episodes_replay_in_one_process(kind, straight_team, first):
    assert digest_of(kind, straight_team, 7) == first[kind]


@pytest.mark.parametrize("kind", KINDS)
def test_another_seed_is_another_episode(kind, straight_team, first):
    assert digest_of(kind, straight_team, 8) != first[kind]


def test_episodes_replay_in_another_process(first):
    done = subprocess.run([sys.executable, __file__], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout.splitlines()[-1]) == first


@pytest.mark.parametrize("kind", KINDS)
def test_returned_arrays_stay_as_they_were(kind, straight_team):
    """Nothing that was handed out changes, or shares memory with what is handed out, later."""
    kept, copies = [], []
    for number, step in enumerate(KINDS[kind](straight_team, 3)):
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
    print(json.dumps({kind: digest_of(kind, make_straight_team(), 7) for kind in KINDS}))
