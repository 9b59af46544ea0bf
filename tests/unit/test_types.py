"""The data types, and that array shapes are checked while tests run."""

from __future__ import annotations

import dataclasses

import jaxtyping
import pytest
import torch
from hpp_tasks.rendezvous import Rendezvous

from hpp_framework.core.types import Observation, State, Trajectories
from hpp_framework.perception.sensing import Sensing


def observation(**changes):
    fields = {
        "agent": 1,
        "poses": torch.arange(2 * 5 * 3 * 3.0).reshape(2, 5, 3, 3),
        "scans": torch.arange(2 * 5 * 7.0).reshape(2, 5, 7),
        "velocity": torch.zeros(2, 2),
    }
    return Observation(**(fields | changes))


def test_observation_names_the_newest_entries():
    seen = observation()
    assert torch.equal(seen.pose, seen.poses[:, 4, 1])
    assert torch.equal(seen.team_poses, seen.poses[:, 4])
    assert torch.equal(seen.scan, seen.scans[:, 4])


def test_types_are_frozen():
    with pytest.raises(dataclasses.FrozenInstanceError):
        observation().agent = 0


@pytest.mark.parametrize(
    "changes",
    [
        {"poses": torch.zeros(2, 5, 3, 2)},
        {"poses": torch.zeros(2, 5, 3)},
        {"scans": torch.zeros(2, 7)},
        {"scans": torch.zeros(1, 5, 7)},
        {"velocity": torch.zeros(2, 2, dtype=torch.int64)},
        {"velocity": torch.zeros(3, 2)},
    ],
    ids=["poses of 2 numbers", "no history", "scan for scans", "other batch", "integers", "other batch size"],
)
def test_wrong_shapes_are_refused_by_dataclasses(changes):
    with pytest.raises(jaxtyping.TypeCheckError):
        observation(**changes)


def test_wrong_shapes_are_refused_by_functions():
    task = Rendezvous(0.5)
    with pytest.raises(jaxtyping.TypeCheckError):
        task.reward(torch.zeros(4, 2, 2))
    with pytest.raises(jaxtyping.TypeCheckError):
        task.success(torch.zeros(4, 2, 3), torch.zeros(4, 3, 2))


def test_wrong_kinds_are_refused(fetch):
    with pytest.raises(jaxtyping.TypeCheckError):
        Sensing([fetch], 7)
    with pytest.raises(jaxtyping.TypeCheckError):
        State(
            poses=torch.zeros(1, 1, 3),
            velocities=torch.zeros(1, 1, 2),
            scans=torch.zeros(1, 1, 4),
            touched_obstacle=[False],
            touched_robot=torch.zeros(1, 1, dtype=torch.bool),
        )


def test_trajectories_agree_on_the_number_of_times():
    Trajectories(poses=torch.zeros(2, 4, 5, 3, 3), times=torch.arange(5.0))
    with pytest.raises(jaxtyping.TypeCheckError):
        Trajectories(poses=torch.zeros(2, 4, 5, 3, 3), times=torch.arange(4.0))
