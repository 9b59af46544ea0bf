"""The same work in each simulator: a function that builds it and returns how to run it.

Every contender has 2 robots with 222 beams over 220 degrees and 25 m, 20 boxes with sides of 0.2 to 0.6 m in
20 x 20 m, random commands, control periods of 0.2 s, contact between robots and boxes, and no pictures.
``python contenders.py NAME`` serves one: it prints ``ready``, then a line of JSON for each line it reads.
"""

from __future__ import annotations

import json
import math
import sys
import tempfile
import time
from collections.abc import Callable

import numpy as np

ROBOTS, BEAMS, BOXES = 2, 222, 20
SPAN, REACH, RADIUS, PERIOD = math.radians(220), 25.0, 0.28, 0.2
SECONDS = 2.0
"""About how long one round of one contender lasts."""

Work = Callable[[], int]
"""Does some work and returns how many agent-steps (or rays) it was."""


def room(seed: int = 0) -> list[list[float]]:
    """Return x, y, width, depth, yaw of the boxes."""
    rng = np.random.default_rng(seed)
    return rng.uniform((-9, -9, 0.2, 0.2, -math.pi), (9, 9, 0.6, 0.6, math.pi), (BOXES, 5)).tolist()


def ours() -> Work:
    """Return batch agent-steps: 1,024 episodes, 32 walled rooms, 4 substeps, acceleration limits."""
    from hpp_framework.bench.measurement import Settings
    from hpp_framework.bench.simulators import Case, Loop

    loop = Loop(Case(robots=ROBOTS, beams=BEAMS), Settings())

    def work() -> int:
        loop.drive()
        return loop.steps * loop.case.worlds * ROBOTS

    return work


def our_rays() -> Work:
    """Return batch rays: the same without physics."""
    from hpp_framework.bench.measurement import Settings
    from hpp_framework.bench.simulators import Case, Loop

    loop = Loop(Case(robots=ROBOTS, beams=BEAMS), Settings())

    def work() -> int:
        loop.look()
        return loop.steps * loop.case.worlds * ROBOTS * BEAMS

    return work


def vmas(environments: int) -> Work:
    """Return VMAS agent-steps: vectorised lidars, one substep, Euler integration, no gradients, no reward."""
    import torch
    from vmas import make_env
    from vmas.simulator.core import Agent, Box, Landmark, Sphere, World
    from vmas.simulator.dynamics.diff_drive import DiffDrive
    from vmas.simulator.scenario import BaseScenario
    from vmas.simulator.sensors import Lidar

    class Scenario(BaseScenario):
        def make_world(self, batch_dim: int, device: torch.device, **options: object) -> World:
            world = World(batch_dim, device, dt=PERIOD, substeps=1, x_semidim=10.0, y_semidim=10.0)
            for index in range(ROBOTS):
                lidar = Lidar(
                    world,
                    angle_start=-SPAN / 2,
                    angle_end=SPAN / 2,
                    n_rays=BEAMS,
                    max_range=REACH,
                    render=False,
                )
                world.add_agent(
                    Agent(
                        name=f"robot_{index}", collide=True, shape=Sphere(RADIUS), sensors=[lidar],
                        dynamics=DiffDrive(world, integration="euler"), u_range=[1, 1], u_multiplier=[1, 1],
                    )
                )  # fmt: skip
            for index, (_, _, width, depth, _) in enumerate(room()):
                world.add_landmark(
                    Landmark(name=f"box_{index}", collide=True, movable=False, shape=Box(width, depth))
                )
            return world

        def reset_world_at(self, env_index: int | None = None) -> None:
            for landmark, (x, y, _, _, yaw) in zip(self.world.landmarks, room(), strict=True):
                landmark.set_pos(torch.tensor([x, y], dtype=torch.float32), batch_index=env_index)
                landmark.set_rot(torch.tensor([yaw], dtype=torch.float32), batch_index=env_index)
            for index, agent in enumerate(self.world.agents):
                agent.set_pos(torch.tensor([2.0 * index - 1, 0.0]), batch_index=env_index)

        def observation(self, agent: Agent) -> torch.Tensor:
            return torch.cat([agent.state.pos, agent.state.vel, agent.sensors[0].measure()], -1)

        def reward(self, agent: Agent) -> torch.Tensor:
            return torch.zeros(self.world.batch_dim)

    env = make_env(Scenario(), num_envs=environments, seed=0)
    env.reset()
    generator = torch.Generator().manual_seed(0)
    scale, shift = torch.tensor([1.0, 2.0]), torch.tensor([0.0, 1.0])
    actions = [
        [torch.rand(environments, 2, generator=generator) * scale - shift for _ in range(ROBOTS)]
        for _ in range(8)
    ]
    step = _cycle(lambda index: env.step(actions[index % 8]))
    return _fill(step, environments * ROBOTS)


def irsim() -> Work:
    """Return IR-SIM agent-steps: headless, collisions checked (the comparison runs one process per core)."""
    import irsim as package
    import yaml

    lidar = {
        "name": "lidar2d", "range_min": 0.0, "range_max": REACH, "angle_range": SPAN, "number": BEAMS,
        "noise": False,
    }  # fmt: skip
    world = {
        "world": {
            "height": 20, "width": 20, "offset": [-10, -10], "step_time": PERIOD, "sample_time": PERIOD,
            "collision_mode": "stop",
        },
        "robot": [
            {
                "kinematics": {"name": "diff"}, "shape": {"name": "circle", "radius": RADIUS},
                "state": [2.0 * index - 1, 0.0, 0.0], "vel_max": [1.0, 1.8], "sensors": [lidar],
            }
            for index in range(ROBOTS)
        ],
        "obstacle": [
            {"shape": {"name": "rectangle", "length": width, "width": depth}, "state": [x, y, yaw]}
            for x, y, width, depth, yaw in room()
        ],
    }  # fmt: skip
    with tempfile.NamedTemporaryFile("w", suffix=".yaml") as file:
        yaml.safe_dump(world, file)
        file.flush()
        env = package.make(file.name, headless=True, log_level="ERROR")
    rng = np.random.default_rng(0)
    actions = rng.uniform((0, -1), (1, 1), (64, ROBOTS, 2))
    step = _cycle(lambda index: env.step(list(actions[index % 64]), action_id=list(range(ROBOTS))))
    return _fill(step, ROBOTS)


def sapien() -> Work:
    """Return SAPIEN agent-steps: walled room, 20 ticks, rays one by one (one process per core)."""
    import torch

    simulator = _sapien()
    command = torch.tensor([[[0.5, 0.3]] * ROBOTS])
    return _fill(lambda: simulator.step(command), ROBOTS)


def sapien_rays() -> Work:
    """Return SAPIEN rays one by one, walled room, robots at rest (one process per core)."""
    simulator = _sapien()
    return _fill(simulator.state, ROBOTS * BEAMS)


def _sapien():  # noqa: ANN202  # the class lives in a package that may be missing
    import torch

    from hpp_framework.bench.measurement import Settings
    from hpp_framework.bench.rooms import robots_of
    from hpp_framework.core.world import Box, World
    from hpp_framework.sim.sapien.simulator import SapienSimulator

    boxes = tuple(Box(center=(x, y), size=(w, d), yaw=yaw) for x, y, w, d, yaw in room())
    simulator = SapienSimulator(robots_of(Settings(), ROBOTS, BEAMS))
    simulator.reset([World(name="room", boxes=boxes)], torch.tensor([[[-1.0, 0, 0], [1.0, 0, 0]]]))
    return simulator


def _cycle(step: Callable[[int], object]) -> Callable[[], object]:
    index = -1

    def following() -> object:
        nonlocal index
        index += 1
        return step(index)

    return following


def _fill(step: Callable[[], object], amount: int) -> Work:
    """Return work that repeats a step for about :data:`SECONDS`."""
    step()
    began = time.perf_counter()
    step()
    count = max(1, int(SECONDS / (time.perf_counter() - began)))

    def work() -> int:
        for _ in range(count):
            step()
        return count * amount

    return work


CONTENDERS: dict[str, Callable[[], Work]] = {
    "ours": ours,
    "our rays": our_rays,
    **{f"vmas {count}": (lambda n=count: vmas(n)) for count in (32, 128, 512, 2048)},
    "irsim": irsim,
    "sapien": sapien,
    "sapien rays": sapien_rays,
}


def serve(name: str) -> None:
    """Build a contender, then run it once for each line of input and answer with work and seconds."""
    work = CONTENDERS[name]()
    work()
    print("ready", flush=True)
    for _ in sys.stdin:
        began = time.perf_counter()
        amount = work()
        print(json.dumps({"amount": amount, "seconds": time.perf_counter() - began}), flush=True)


if __name__ == "__main__":
    sys.path.pop(0)  # this folder, where the name of a module could hide a package
    serve(sys.argv[1])
