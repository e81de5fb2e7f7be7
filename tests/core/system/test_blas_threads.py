import os
import subprocess
import sys

import pytest
from perfanim.core.system.blas_threads import blas_function, bundled_blas

SCRIPT = """
from perfanim.core.system.blas_threads import blas_function, bundled_blas, use_one_blas_thread
libraries = bundled_blas()
for path in libraries:
    blas_function(path, "set_num_threads")(3)
changed = use_one_blas_thread()
print(changed, [blas_function(path, "get_num_threads")() for path in libraries])
"""


def threads(**chosen):
    environment = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}
    command = [sys.executable, "-c", SCRIPT]
    done = subprocess.run(command, env=environment | chosen, capture_output=True, text=True, check=True)
    return done.stdout.strip()


def test_a_script_gets_one_thread():
    count = len(bundled_blas())
    assert count > 0
    assert threads() == f"{count} {[1] * count}"


@pytest.mark.parametrize("name", ["OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"])
def test_the_choice_of_the_user_stands(name):
    assert threads(**{name: "2"}) == f"0 {[3] * len(bundled_blas())}"


def test_a_library_without_the_function_is_left(tmp_path):
    (tmp_path / "libopenblas.so").write_bytes(b"no library")
    assert blas_function(tmp_path / "libopenblas.so", "set_num_threads") is None
