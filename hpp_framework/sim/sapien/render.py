"""Whether SAPIEN can draw pictures here, asked in a child process because a broken driver kills the asker.

``python -m hpp_framework.sim.sapien.render`` prints the answer and exits with 1 if there is a problem.
"""

from __future__ import annotations

import os
import subprocess
import sys
from functools import cache

TIMEOUT = 90.0
"""Seconds the probe may take; some drivers hang."""

REMEDY = (
    "3-D pictures need a Vulkan driver; the software renderer Mesa lavapipe is enough. On Debian or Ubuntu "
    "type `make vulkan` as root (or `scripts/install-vulkan.sh`): it installs mesa-vulkan-drivers and "
    "libvulkan1, on Debian 12 from bookworm-backports, because the plain ones are too old. "
    "Everything else works without."
)

_PROBE = """
import os, warnings
warnings.simplefilter("ignore")
import sapien
sapien.render.set_camera_shader_dir("trivial")
renderer = sapien.render.RenderSystem()
scene = sapien.Scene([renderer])
material = sapien.render.RenderMaterial()
material.set_base_color([1, 0, 0, 1])
body = sapien.render.RenderBodyComponent()
body.attach(sapien.render.RenderShapeBox([0.5, 0.5, 0.5], material))
entity = sapien.Entity()
entity.add_component(body)
scene.add_entity(entity)
camera = scene.add_camera("probe", 16, 16, 1.0, 0.1, 10.0)
camera.entity.set_pose(sapien.Pose([-3, 0, 0]))
scene.update_render()
camera.take_picture()
pixel = camera.get_picture("Color")[8, 8]
print("PROBE", renderer.device.name if pixel[0] > 0.5 > pixel[1] else "", flush=True)
os._exit(0)
"""


@cache
def rendering_problem() -> str | None:
    """Return None if SAPIEN can draw here, else what is missing and how to get it; asked once a process."""
    try:
        done = subprocess.run(
            [sys.executable, "-c", _PROBE],
            capture_output=True,
            text=True,
            timeout=TIMEOUT,
            check=False,
            env={**os.environ, "PYTHONWARNINGS": "ignore"},
        )
    except subprocess.TimeoutExpired:
        return f"SAPIEN's renderer did not answer within {TIMEOUT:.0f} s. {REMEDY}"
    except OSError as error:
        return f"SAPIEN's renderer could not be tried: {error}. {REMEDY}"
    answers = [line[len("PROBE") :].strip() for line in done.stdout.splitlines() if line.startswith("PROBE")]
    if answers and answers[0]:
        return None
    return f"SAPIEN cannot draw on this machine ({_reason(done)}). {REMEDY}"


def _reason(done: subprocess.CompletedProcess[str]) -> str:
    if "PROBE" in done.stdout:
        return "the picture came out wrong"
    if done.returncode < 0:
        return f"the graphics driver crashed with signal {-done.returncode}"
    lines = [line.strip() for line in done.stderr.splitlines() if line.strip()]
    return lines[-1] if lines else f"exit code {done.returncode}"


if __name__ == "__main__":
    problem = rendering_problem()
    print(problem or "SAPIEN can draw on this machine.")
    sys.exit(1 if problem else 0)
