"""Without a GPU: the CUDA source of all kernels compiles (Ampere and newer)."""

from __future__ import annotations

import importlib

import pytest
import warp as wp

MODULES = (
    "hpp_framework.sim.batch.drive_kernels",
    "hpp_framework.sim.batch.lidar_kernels",
    "hpp_framework.sim.batch.crowd_kernels",
    "hpp_framework.sim.batch.among_kernels",
    "hpp_framework.prediction.one_step_kernels",
    "hpp_framework.perception.local_map_kernels",
    "hpp_skills.dwa.window_kernels",
)


@pytest.mark.slow
@pytest.mark.parametrize("name", MODULES)
def test_kernels_compile_for_cuda(name, tmp_path):
    module = importlib.import_module(name)
    wp.compile_aot_module(module, arch=[80], module_dir=str(tmp_path))
    # a binary for that card
    assert len(list(tmp_path.glob("*.cubin"))) + len(list(tmp_path.glob("*.ptx"))) == 1
