from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from growing_client import grown, wide

N = 60


def grown_elsewhere(**switches):
    """Return what another process grows that is told to have another processor."""
    narrow = {
        "NPY_DISABLE_CPU_FEATURES": " ".join(wide()),
        "OPENBLAS_CORETYPE": "Prescott",
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX,-AVX2,-FMA,-AVX512F,-AVX_Usable,-AVX2_Usable,-FMA_Usable",
    }
    client = Path(__file__).with_name("growing_client.py")
    command = [sys.executable, str(client), str(N)]
    done = subprocess.run(command, env={**os.environ, **narrow, **switches}, capture_output=True, text=True, check=True)
    told = json.loads(done.stdout)
    assert told["wide"] == []
    return told["grown"]


@pytest.mark.client
def test_what_is_grown_has_the_same_bytes_where_numpy_blas_and_libm_have_no_wide_vectors():
    assert grown_elsewhere() == grown(N)


@pytest.mark.slow
@pytest.mark.client
def test_what_is_grown_has_the_same_bytes_with_kernels_for_any_processor(tmp_path):
    assert grown_elsewhere(NUMBA_CPU_NAME="generic", NUMBA_CPU_FEATURES="", NUMBA_CACHE_DIR=str(tmp_path)) == grown(N)
